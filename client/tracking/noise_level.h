// How precise a camera's views are, learned while it is tracked.
//
// How far a right match lies off differs between cameras: by three tenths of a pixel where lens,
// shutter and depth are good, by more than one with a rolling shutter or depth that was taken at
// another moment. One bound for all either lets wrong matches in or throws right ones out. So the
// bound follows what the run's views have shown, not each view: a blurred one must not widen its
// own unless it is far worse (refine.h). Figures in tests/bench/RESULTS.md.
#pragma once

#include <algorithm>
#include <cmath>

namespace cairn {

// For solve_pose: how many times the usual standard deviations the outlier test should allow for
// views of this PoseSolution::median_squared.
inline double slack_of(double median_squared) {
  constexpr double kUsual = 0.5;  // the median that the usual bound fits
  return std::sqrt(median_squared / kUsual);
}

// Used from one thread.
class NoiseLevel {
 public:
  // Of the views so far.
  double slack() const { return std::clamp(mean_, kLeastSlack, kMostSlack); }

  // PoseSolution::median_squared of the next tracked frame.
  void add(double median_squared) { mean_ += kNewShare * (slack_of(median_squared) - mean_); }

 private:
  static constexpr double kNewShare = 0.1;  // of the next frame: ten frames, a third of a second
  static constexpr double kLeastSlack = 0.4, kMostSlack = 1.2;

  double mean_ = 1;  // running, in usual standard deviations
};

}  // namespace cairn
