// SPDX-License-Identifier: MIT
// A procedure is read or refused with ProcedureError; the planner ends on whatever was read.
#include "rig/procedure/procedure.hpp"

#include <cstdint>
#include <string>

#include "rig/errors.hpp"
#include "rig/procedure/procedure_plan.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const rig::Procedure procedure =
        rig::parse_procedure(std::string(reinterpret_cast<const char*>(data), size), "fuzz.yaml");
    (void)rig::unroll(procedure, fit::Bench{});
  } catch (const rig::UsageError&) {
  } catch (const rig::MeasurementError&) {
  }
  return 0;
}
