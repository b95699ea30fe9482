// A command of the tool as a user types it: arguments in, exit code and text out.
#pragma once

#include <algorithm>
#include <functional>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <CLI/CLI.hpp>

#include "server/tool/command.h"

namespace cairn {

struct Outcome {
  int code = 0;
  std::string out, err;
};

using AddCommand = void (*)(CLI::App& app, std::function<int()>& run);

inline Outcome run_tool(const std::vector<AddCommand>& commands,
                        std::vector<std::string> arguments) {
  CLI::App app("test", "cairn");
  app.require_subcommand(1);
  std::function<int()> run;
  for (const AddCommand add : commands) add(app, run);
  std::reverse(arguments.begin(), arguments.end());  // CLI11 takes them last first
  ::testing::internal::CaptureStdout();
  ::testing::internal::CaptureStderr();
  Outcome outcome;
  try {
    app.parse(arguments);
    outcome.code = run();
  } catch (const CLI::ParseError&) {
    outcome.code = kExitUsage;
  }
  outcome.out = ::testing::internal::GetCapturedStdout();
  outcome.err = ::testing::internal::GetCapturedStderr();
  return outcome;
}

}  // namespace cairn
