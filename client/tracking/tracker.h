// Tracking: the pose of every frame against the local map, and the choice of keyframes.
//
// One frame goes through five steps: predict, match to the last frame, match to the local map,
// decide on a keyframe, record. Nothing here waits for anybody. Used from one thread.
//
// Lost, it looks among its own latest keyframes and asks the server, which knows everybody's
// (TrackingResult::question, take()). Where neither helps for long it starts a new part of the map,
// which the server will join to the rest when it recognises something.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "client/tracking/keyframe_policy.h"
#include "client/tracking/local_map.h"
#include "client/tracking/lost_time.h"
#include "client/tracking/mono_start.h"
#include "client/tracking/noise_level.h"
#include "client/tracking/provisional.h"
#include "client/tracking/tracked_frame.h"
#include "client/tracking/trajectory.h"
#include "common/model/relocalise.h"

namespace cairn {

struct TrackerOptions {
  // Landmarks that must fit a pose for it to count (after the local map was searched), also where
  // there is no depth, and after having been lost, when more proof is due. A camera without depth
  // that turns to where it has not been sees few landmarks for a while; with 20 the turns of TUM
  // fr1/rpy ended in the dark, with 15 most don't, and are as exact.
  int min_inliers = 20, min_inliers_mono = 15;
  int min_inliers_after_loss = 40;
  // Features with depth that a first frame must have to start a map.
  int min_start_features = 60;
  // A keyframe makes provisional landmarks of its nearest features with depth until it shows
  // `landmarks_per_keyframe` in all, but always at least `min_new_landmarks`; those beyond the
  // rig's max_depth only to reach the latter. More would crowd out the landmarks that earlier
  // keyframes have confirmed, and let the map drift with each blurred view.
  int landmarks_per_keyframe = 300;
  int min_new_landmarks = 100;
  double last_frame_radius = 15;  // pixels, search around a predicted position
  double local_map_radius = 1.2;  // factor on the search radius around a landmark's projection
  std::size_t local_keyframes = 60;
  bool keep_every_pose = true;  // else one a keyframe: FrameTrajectory
  KeyframePolicyOptions keyframes;
  // Without depth: how a map starts, and how later landmarks are made.
  MonoStartOptions mono_start;
  ProvisionalOptions provisional;
  LostOptions lost;
};

enum class TrackingState { kStarting, kTracking, kLost };

struct TrackingResult {
  TrackingState state = TrackingState::kStarting;
  Rigid3 map_from_camera;   // meaningful while tracking
  Rigid3 odom_from_camera;  // the same, without the jumps of corrections
  int landmarks = 0;        // that fit the pose
  KeyframePtr keyframe;     // the one made of this frame, or null
  // Where a monocular map starts: the earlier frame that it starts from, to be sent before, and how
  // many earlier frames have got their poses only now, that one included.
  KeyframePtr first_keyframe;
  int earlier_frames = 0;
  // Where is this? To be sent to the server while it is not known: the frame as a keyframe without
  // matches, whose sequence is the number of the question.
  KeyframePtr question;
};

class Tracker {
 public:
  // `epoch` names this run's keyframes, see KeyframeId.
  Tracker(std::uint64_t epoch, std::shared_ptr<const Rig> rig, TrackerOptions options = {});

  // Stamps must ascend.
  TrackingResult track(std::int64_t stamp_ns, Features features);

  // The server's answer to the latest question, between frames. Where it holds the frame asked
  // about is tracked and becomes a keyframe, the next frame is tracked from it; otherwise nothing
  // changes.
  TrackingResult take(const RelocaliseAnswer& answer);
  // Whether the answer to the latest question would still help.
  bool awaits_answer() const { return asked_ != nullptr; }

  // Corrections by the server; call between frames. What is being tracked moves along with the map,
  // in scale, too.
  // Of another map than before (the server was restarted without it), the client's odom frame is
  // taken for its frame: the server places the keyframes that it gets by what they say of odom.
  void apply(const MapUpdate& update);

  // Without a server nobody maps keyframes, and the policy need not wait for anyone. May change at
  // any time; keyframes go on to be counted as unmapped.
  void set_has_server(bool has_server) { has_server_ = has_server; }
  // Whether a question would reach it now.
  void set_in_touch(bool in_touch) { in_touch_ = in_touch; }
  // Keyframes before `sequence` will not be mapped any more: their map is lost.
  void write_off(std::uint32_t sequence) {
    mapped_keyframes_ = std::max(mapped_keyframes_, sequence);
  }

  std::uint32_t keyframes_made() const { return next_sequence_; }
  std::uint32_t keyframes_mapped() const { return mapped_keyframes_; }
  // Keyframes made that the server has not told of as mapped, whether there is a server or not.
  int unmapped() const { return static_cast<int>(next_sequence_ - mapped_keyframes_); }
  Trajectory trajectory() const { return trajectory_.poses(map_); }
  std::vector<Trajectory> trajectory_by_part() const { return trajectory_.poses_by_part(map_); }
  const LocalMap& map() const { return map_; }

 private:
  bool follow(TrackedFrame& frame, TrackingResult& result);
  bool start(TrackedFrame& frame, TrackingResult& result);
  bool start_mono(TrackedFrame& frame, TrackingResult& result);
  int follow_motion(TrackedFrame& frame);
  int follow_keyframe(TrackedFrame& frame);
  bool find_again(TrackedFrame& frame);
  bool give_up(const TrackedFrame& frame);
  void ask_about(std::unique_ptr<TrackedFrame> frame, TrackingResult& result);
  int locate(const RelocaliseAnswer& answer, TrackedFrame& frame);
  int min_inliers() const;
  bool could_start(const TrackedFrame& frame) const;
  void finish(std::unique_ptr<TrackedFrame> frame, TrackingResult& result);
  int match_local_map(TrackedFrame& frame);
  void choose_reference(const TrackedFrame& frame);
  bool wants_keyframe(const TrackedFrame& frame, int landmarks) const;
  void make_landmarks(KeyframeId keyframe, TrackedFrame& frame) const;
  std::vector<ProvisionalLandmark> triangulate(TrackedFrame& frame) const;
  KeyframePtr make_keyframe(TrackedFrame& frame);
  KeyframePtr make_keyframe(TrackedFrame& frame, std::span<const ProvisionalLandmark> triangulated);
  void record(const TrackedFrame& frame);
  void change_map();
  void move_odom(const Rigid3& odom_from_camera, const Rigid3& map_from_camera);

  const std::uint64_t epoch_;
  const std::shared_ptr<const Rig> rig_;
  const TrackerOptions options_;

  TrackingState state_ = TrackingState::kStarting;
  MonoStart mono_start_;
  LocalMap map_;
  FrameTrajectory trajectory_;
  std::unique_ptr<TrackedFrame> last_;  // the last tracked frame
  Rigid3 last_from_current_;            // predicted motion, camera to camera
  bool has_motion_ = false;
  NoiseLevel noise_level_;
  KeyframeId reference_;        // own keyframe that the current view is nearest to
  Rigid3 reference_from_last_;  // the last frame's pose, relative to it, in its own unit
  Sim3 map_from_odom_;          // odom keeps the unit that the run has begun with
  int frames_since_keyframe_ = 0;
  int frames_since_loss_ = 1'000'000;
  std::size_t lost_attempts_ = 0;
  LostTime lost_;
  std::unique_ptr<TrackedFrame> asked_;  // the frame of the latest question, until it is answered
  std::uint32_t questions_ = 0;
  std::optional<KeyframePose> foreign_reference_;  // of the keyframe being made, if not an own one
  Rigid3 last_odom_from_camera_;                   // of the last tracked frame
  std::uint32_t merge_epoch_ = 0;                  // of the map, as the last update has told
  std::uint32_t next_sequence_ = 0;
  std::uint32_t mapped_keyframes_ = 0;
  bool has_server_ = true, in_touch_ = true;
};

}  // namespace cairn
