// SPDX-License-Identifier: MIT
#include "rig/live/live_page.hpp"

#include <boost/asio/post.hpp>

namespace rig {

namespace asio = boost::asio;

LivePage::LivePage(const LiveServer::Options& options) {
  server_ = std::make_unique<LiveServer>(io_.get_executor(), options, [this](const nlohmann::json& command) {
    const std::lock_guard lock(mutex_);
    if (!on_command_) return;
    asio::post(obeying_, [obey = on_command_, command] { obey(command); });
  });
  url_ = server_->url();
  thread_ = std::thread([this] { io_.run(); });
}

LivePage::~LivePage() {
  obey_nobody();
  asio::post(io_, [this] { server_->finish([this] { io_.stop(); }); });
  thread_.join();
}

void LivePage::publish(const nlohmann::json& state) {
  asio::post(io_, [this, state] {
    state_ = state;
    send();
  });
}

void LivePage::show_picture(const std::string& type, const std::string& bytes) {
  asio::post(io_, [this, type, bytes] { server_->show_picture(type, bytes); });
}

void LivePage::show_beside(const std::string& key, const nlohmann::json& value) {
  asio::post(io_, [this, key, value] {
    beside_[key] = value;
    send();
  });
}

void LivePage::obey(const asio::any_io_executor& executor, OnCommand on_command) {
  const std::lock_guard lock(mutex_);
  obeying_ = executor;
  on_command_ = std::move(on_command);
}

void LivePage::obey_nobody() {
  const std::lock_guard lock(mutex_);
  on_command_ = nullptr;
  obeying_ = {};
}

void LivePage::send() {
  nlohmann::json whole = state_.is_object() ? state_ : nlohmann::json::object();
  whole.update(beside_);
  server_->publish(whole);
}

}  // namespace rig
