// Rows of an image shared out between threads. Plain std::jthread, so that thread sanitizers see
// every hand-over; starting one costs some 20 microseconds, little against a frame.
#pragma once

#include <algorithm>
#include <atomic>
#include <thread>
#include <vector>

namespace cairn::synthetic {

// Calls body(i) once for each i in 0 .. count - 1, on `threads` threads (the caller's is one of
// them), `chunk` consecutive ones at a time. Returns when all are done. The body must not throw.
template <typename Body>
void parallel_for(int count, int threads, int chunk, const Body& body) {
  std::atomic<int> next{0};
  const auto work = [&] {
    for (int first; (first = next.fetch_add(chunk)) < count;) {
      for (int i = first; i < std::min(first + chunk, count); ++i) body(i);
    }
  };
  std::vector<std::jthread> helpers;
  for (int i = 1; i < threads; ++i) helpers.emplace_back(work);
  work();
}

}  // namespace cairn::synthetic
