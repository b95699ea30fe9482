// Time: int64 nanoseconds inside, seconds as text in TUM files.
#pragma once

#include <chrono>
#include <cstdint>

namespace cairn {

inline constexpr std::int64_t kNanosPerSecond = 1'000'000'000;

inline double to_seconds(std::int64_t ns) {
  return static_cast<double>(ns) * 1e-9;
}

// Milliseconds since construction or the last reset, on the monotonic clock.
class Stopwatch {
 public:
  double milliseconds() const {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start_)
        .count();
  }
  void reset() { start_ = std::chrono::steady_clock::now(); }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace cairn
