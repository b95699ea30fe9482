// The same work on many things, on as many threads as there are processors.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <thread>
#include <vector>

namespace cairn {

// Calls work(i) for each i below `count`, each once, from several threads, the caller's among them;
// returns when all is done. `work` must be safe to call for different i at the same time, and must
// not throw.
template <typename Work>
void for_each_index(std::size_t count, Work&& work) {
  std::atomic<std::size_t> next = 0;
  const auto take = [&] {
    for (std::size_t i = next++; i < count; i = next++) work(i);
  };
  const std::size_t threads =
      std::min<std::size_t>(count, std::max(1u, std::thread::hardware_concurrency()));
  std::vector<std::jthread> helpers;
  for (std::size_t t = 1; t < threads; ++t) helpers.emplace_back(take);
  take();
}

}  // namespace cairn
