#include "server/mapping/step.h"

#include <utility>

namespace cairn {

// Loops come seconds apart at the most, so that the second attempt is as good as sure.
DeltaSummary take_step(MapWriter& writer, const Step& step) {
  constexpr int kAttempts = 5;
  DeltaSummary summary;
  for (int i = 0; i < kAttempts; ++i) {
    MapDelta delta = step(*writer.snapshot());
    if (delta.empty()) return {};
    summary = writer.submit(std::move(delta)).delta;
    if (!summary.is_void) break;
  }
  return summary;
}

double lap(Stopwatch& watch) {
  const double ms = watch.milliseconds();
  watch.reset();
  return ms;
}

}  // namespace cairn
