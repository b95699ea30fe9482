// What a process costs, from /proc.
#pragma once

namespace cairn::bench {

struct Usage {
  double cpu_s = 0;      // user and system time so far
  double memory_mb = 0;  // resident
};

// Zero for a process that is not there.
Usage usage_of(int pid);

}  // namespace cairn::bench
