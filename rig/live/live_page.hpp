// SPDX-License-Identifier: MIT
#pragma once

#include <boost/asio/any_io_executor.hpp>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <functional>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "rig/live/live_server.hpp"

namespace rig {

/// The live page of a program that runs one procedure after the other: in a thread of its own, so that it is
/// there between them as well. All members may be called from any thread.
class LivePage {
 public:
  using OnCommand = LiveServer::OnCommand;

  /// Throws as LiveServer does.
  explicit LivePage(const LiveServer::Options& options);
  /// Lets every browser have the last state.
  ~LivePage();
  LivePage(const LivePage&) = delete;
  LivePage& operator=(const LivePage&) = delete;

  [[nodiscard]] const std::string& url() const { return url_; }
  void publish(const nlohmann::json& state);
  void show_picture(const std::string& type, const std::string& bytes);
  /// A member of every state from now on, beside what publish() says.
  void show_beside(const std::string& key, const nlohmann::json& value);
  /// Commands of the page go to `on_command`, on that executor; without one, nowhere.
  void obey(const boost::asio::any_io_executor& executor, OnCommand on_command);
  void obey_nobody();

 private:
  void send();

  boost::asio::io_context io_{1};
  boost::asio::executor_work_guard<boost::asio::io_context::executor_type> work_{io_.get_executor()};
  std::unique_ptr<LiveServer> server_;
  std::string url_;
  nlohmann::json state_, beside_ = nlohmann::json::object();  ///< Of io_'s thread.
  std::mutex mutex_;
  boost::asio::any_io_executor obeying_;
  OnCommand on_command_;
  std::thread thread_;
};

}  // namespace rig
