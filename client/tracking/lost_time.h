// What a client does about not knowing where it is, by the time that has passed since: when it asks
// the server, and when it gives up and starts a new part of the map.
//
// All by the frames' stamps, so that the same recording gives the same run at any pace.
#pragma once

#include <algorithm>
#include <cstdint>

#include "common/util/clock.h"

namespace cairn {

struct LostOptions {
  // Seconds between questions to the server, at first and after `ask_often_s` of being lost; and
  // after which one without an answer counts as lost, too.
  double ask_every_s = 0.25, ask_later_every_s = 1.0, ask_often_s = 2.0;
  double answer_within_s = 1.0;
  // Of images that a map could be started from, after which it is: who is lost in a place that
  // nobody has mapped would be lost for ever. Not before the server has answered, which could join
  // the new part with the old one: one that recognises no places never does.
  double new_part_after_s = 1.5;
};

class LostTime {
 public:
  explicit LostTime(const LostOptions& options) : options_(options) {}

  // A frame that could not be placed. `good`: it shows enough to be placed or to start from. Time
  // in the dark does not count.
  void see(std::int64_t stamp_ns, bool good) {
    if (good && was_good_) lost_s_ += std::min(to_seconds(stamp_ns - last_ns_), kLongestFrame);
    was_good_ = good;
    last_ns_ = stamp_ns;
  }
  // Where the camera is, is known again, or a new part has begun.
  void end() {
    lost_s_ = 0;
    was_good_ = was_answered_ = false;
  }

  // Of the frame seen last.
  bool wants_to_ask() const {
    if (!was_good_) return false;
    const double since = to_seconds(last_ns_ - asked_ns_);
    if (!has_asked_) return true;
    if (waits_) return since >= options_.answer_within_s;
    return since >=
           (lost_s_ < options_.ask_often_s ? options_.ask_every_s : options_.ask_later_every_s);
  }
  void asked() {
    has_asked_ = waits_ = true;
    asked_ns_ = last_ns_;
  }
  void answered() {
    waits_ = false;
    was_answered_ = true;
  }

  bool has_lasted() const {
    return was_good_ && was_answered_ && lost_s_ >= options_.new_part_after_s;
  }

 private:
  static constexpr double kLongestFrame = 0.2;  // seconds; a gap in the recording is no lost time

  LostOptions options_;
  double lost_s_ = 0;
  bool was_good_ = false, has_asked_ = false, waits_ = false, was_answered_ = false;
  std::int64_t last_ns_ = 0, asked_ns_ = 0;
};

}  // namespace cairn
