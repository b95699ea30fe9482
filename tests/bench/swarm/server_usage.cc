#include "tests/bench/swarm/server_usage.h"

#include <unistd.h>

#include <fstream>
#include <sstream>
#include <string>

namespace cairn::bench {

Usage usage_of(int pid) {
  std::ifstream stat("/proc/" + std::to_string(pid) + "/stat");
  std::string line;
  if (!std::getline(stat, line)) return {};
  // Behind the name, which may hold blanks: proc(5) counts the state as field 3, user and system
  // time as 14 and 15, resident pages as 24.
  std::istringstream fields(line.substr(line.rfind(')') + 2));
  std::string skipped;
  double user = 0, system = 0, pages = 0;
  for (int field = 3; field <= 24 && fields; ++field) {
    if (field == 14)
      fields >> user;
    else if (field == 15)
      fields >> system;
    else if (field == 24)
      fields >> pages;
    else
      fields >> skipped;
  }
  const auto ticks = static_cast<double>(sysconf(_SC_CLK_TCK));
  const auto page = static_cast<double>(sysconf(_SC_PAGESIZE));
  return {(user + system) / ticks, pages * page / 1e6};
}

}  // namespace cairn::bench
