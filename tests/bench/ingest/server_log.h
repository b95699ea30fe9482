// What a server's log says about when it solved what.
#pragma once

#include <chrono>
#include <string>
#include <vector>

namespace cairn::bench {

struct LoggedSolve {
  std::chrono::system_clock::time_point ended;
  double milliseconds = 0;
  std::string line;
};

// Lines such as "2026-11-22T06:15:01.123 debug cairn-server: local BA: ..., 35 ms: ..." whose text
// begins with `what`.
std::vector<LoggedSolve> solves_in(const std::string& log, const std::string& what);

}  // namespace cairn::bench
