// A monocular client whose server answers late: in one process, by the frame, so that the delay is
// what it says whatever else the machine does. The server's part is its own mapping, step by step.
#include <gtest/gtest.h>

#include <cmath>
#include <deque>

#include "client/tracking/tracker.h"
#include "common/geometry/sim3.h"
#include "server/map/apply.h"
#include "server/mapping/cull.h"
#include "server/mapping/fuse.h"
#include "server/mapping/local_window.h"
#include "server/mapping/triangulate.h"
#include "server/optimize/local_ba.h"
#include "server/publish/publish.h"
#include "tests/unit/client/tracking/feature_world.h"

namespace cairn {
namespace {

using testing::FeatureWorld;

constexpr std::uint64_t kEpoch = 99;
constexpr int kFrames = 300;  // 10 s

// Along a wall and on round the room.
Rigid3 stroll(int frame) {
  const double t = frame / 30.0;
  return {so3_exp({0.05 * std::sin(0.9 * t), 0.3 * t, 0.03 * std::sin(t)}),
          {0.6 * std::sin(0.6 * t), 0.1 * std::sin(0.8 * t), 0.3 * std::sin(0.4 * t)}};
}

class LateServer {
 public:
  explicit LateServer(int delay_frames) : delay_(delay_frames) { map_.id = {1}; }

  void take(const KeyframePtr& keyframe, int frame) {
    const KeyframeId id = keyframe->id;
    apply_keyframe(map_, keyframe);
    MapDelta first = fuse(map_, id, grids_, {}, FuseDirection::kInto);
    first.removed_landmarks = landmarks_failing_trial(map_, id);
    apply_delta(map_, first);
    apply_delta(map_, triangulate(map_, id));
    apply_delta(map_, fuse(map_, id, grids_, {}, FuseDirection::kFrom));
    const KeyframeId centres[] = {id};
    apply_delta(map_, solve_local_ba(map_, choose_local_window(map_, centres), {}));
    if (const auto update = view_.difference(map_, id.sequence + 1))
      under_way_.push_back({frame + delay_, *update});
  }

  // What has come by the time of that frame.
  void deliver(int frame, Tracker& tracker) {
    for (; !under_way_.empty() && under_way_.front().due <= frame; under_way_.pop_front())
      tracker.apply(under_way_.front().update);
  }

 private:
  struct Late {
    int due;
    MapUpdate update;
  };
  const int delay_;
  Map map_;
  GridCache grids_;
  ClientView view_{kEpoch};
  std::deque<Late> under_way_;
};

struct Outcome {
  int tracked = 0, lost = 0;  // frames
  int keyframes = 0;          // in all
  double error = 1e9;         // metres, once the scale is taken out
};

Outcome run(int delay_frames) {
  const auto rig = testing::mono_test_rig();
  FeatureWorld world(31, 6000);
  Tracker tracker(kEpoch, rig);
  LateServer server(delay_frames);
  Outcome outcome;
  for (int i = 0; i < kFrames; ++i) {
    server.deliver(i, tracker);
    const TrackingResult r = tracker.track(i * 33'333'333LL, world.view(*rig, stroll(i), 0.3, 10));
    outcome.tracked += r.state == TrackingState::kTracking;
    outcome.lost += r.state == TrackingState::kLost;
    for (const KeyframePtr& k : {r.first_keyframe, r.keyframe}) {
      if (!k) continue;
      server.take(k, i);
      ++outcome.keyframes;
    }
  }
  server.deliver(1 << 30, tracker);
  std::vector<Eigen::Vector3d> found, truth;
  for (const StampedPose& p : tracker.trajectory()) {
    found.push_back(p.world_from_camera.translation);
    truth.push_back(
        stroll(static_cast<int>(std::lround(static_cast<double>(p.stamp_ns) / 33'333'333)))
            .translation);
  }
  const auto aligned = align_points(found, truth, true);
  if (!aligned) return outcome;
  double sum = 0;
  for (std::size_t i = 0; i < found.size(); ++i)
    sum += (*aligned * found[i] - truth[i]).squaredNorm();
  outcome.error = std::sqrt(sum / static_cast<double>(found.size()));
  return outcome;
}

TEST(MonoLatency, TrackingDoesNotStarveWithoutDelayWithAFifthOfASecondOrWithAWholeOne) {
  for (const int delay_frames : {0, 6, 30}) {
    const Outcome outcome = run(delay_frames);
    EXPECT_EQ(outcome.lost, 0) << delay_frames << " frames late";
    RecordProperty("error_mm_" + std::to_string(delay_frames),
                   static_cast<int>(1000 * outcome.error));
    EXPECT_GT(outcome.tracked, kFrames / 2) << delay_frames << " frames late";
    EXPECT_GT(outcome.keyframes, 6) << delay_frames << " frames late";
    EXPECT_LT(outcome.error, 0.05) << delay_frames << " frames late";
  }
}

}  // namespace
}  // namespace cairn
