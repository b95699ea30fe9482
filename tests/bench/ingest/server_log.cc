#include "tests/bench/ingest/server_log.h"

#include <cstdio>
#include <ctime>

#include <cmath>
#include <optional>
#include <regex>
#include <sstream>

namespace cairn::bench {
namespace {

using std::chrono::system_clock;

// The log tells local time.
std::optional<system_clock::time_point> stamp_of(const std::string& line) {
  std::tm t{};
  int milliseconds = 0;
  if (std::sscanf(line.c_str(), "%d-%d-%dT%d:%d:%d.%d", &t.tm_year, &t.tm_mon, &t.tm_mday,
                  &t.tm_hour, &t.tm_min, &t.tm_sec, &milliseconds) != 7)
    return std::nullopt;
  t.tm_year -= 1900;
  t.tm_mon -= 1;
  t.tm_isdst = -1;
  return system_clock::from_time_t(std::mktime(&t)) + std::chrono::milliseconds(milliseconds);
}

}  // namespace

std::vector<LoggedSolve> solves_in(const std::string& log, const std::string& what) {
  static const std::regex duration(R"((\d+) ms)");
  std::vector<LoggedSolve> solves;
  std::istringstream lines(log);
  for (std::string line; std::getline(lines, line);) {
    const std::size_t at = line.find(": " + what);
    if (at == std::string::npos) continue;
    const auto stamp = stamp_of(line);
    std::smatch match;
    if (stamp && std::regex_search(line, match, duration))
      solves.push_back({*stamp, std::stod(match[1]), line.substr(at + 2)});
  }
  return solves;
}

}  // namespace cairn::bench
