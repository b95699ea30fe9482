// How the subcommands of `cairn` fit together. Each stands in its own pair of files and offers
//
//   void add_NAME_command(CLI::App& app, std::function<int()>& run);
//
// which adds the subcommand with its options to `app`; when the user chose that one, parsing sets
// `run` to what it does. main then calls `run`, whose result is the exit code. Results go to
// stdout; what went wrong goes to stderr, as one line by fail().
#pragma once

#include <functional>
#include <iostream>
#include <string_view>

#include <CLI/CLI.hpp>

namespace cairn {

// Exit codes that every command shares.
inline constexpr int kExitOk = 0;
inline constexpr int kExitFailure = 1;
inline constexpr int kExitUsage = 2;

// Says what went wrong and gives back the exit code to return.
inline int fail(std::string_view message, int exit_code = kExitFailure) {
  std::cerr << "cairn: " << message << '\n';
  return exit_code;
}

}  // namespace cairn
