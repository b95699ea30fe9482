#include "client/tracking/tracker.h"

#include <algorithm>

#include "client/tracking/frame_matcher.h"
#include "client/tracking/refine.h"
#include "client/tracking/relocalise.h"
#include "common/util/clock.h"
#include "common/util/log.h"

namespace cairn {
namespace {

constexpr int kMinMatches = 20;        // to try to solve a pose at all, but no more than must fit
constexpr int kMinFollowInliers = 10;  // for the local map to be worth searching
constexpr int kFramesToTrustAfterLoss = 30;

int features_with_depth(const TrackedFrame& frame) {
  return static_cast<int>(std::count_if(frame.features.points.begin(), frame.features.points.end(),
                                        [](const Feature& f) { return f.has_depth(); }));
}

}  // namespace

Tracker::Tracker(std::uint64_t epoch, std::shared_ptr<const Rig> rig, TrackerOptions options)
    : epoch_(epoch),
      rig_(std::move(rig)),
      options_(options),
      mono_start_(rig_, options.mono_start),
      trajectory_(options.keep_every_pose),
      lost_(options.lost) {}

TrackingResult Tracker::track(std::int64_t stamp_ns, Features features) {
  auto frame = std::make_unique<TrackedFrame>(stamp_ns, rig_, std::move(features));
  // A view of what was left behind, or has been mapped by others, fits less well.
  if (state_ == TrackingState::kTracking) frame->slack = noise_level_.slack();
  TrackingResult result;
  ++frames_since_keyframe_;
  const bool placed =
      state_ == TrackingState::kStarting ? start(*frame, result) : follow(*frame, result);
  if (placed || (give_up(*frame) && start(*frame, result)))
    finish(std::move(frame), result);
  else
    ask_about(std::move(frame), result);
  result.state = state_;
  return result;
}

void Tracker::finish(std::unique_ptr<TrackedFrame> frame, TrackingResult& result) {
  lost_.end();
  asked_.reset();
  record(*frame);
  result.state = state_;
  result.map_from_camera = frame->map_from_camera;
  result.odom_from_camera = last_odom_from_camera_ =
      map_from_odom_.inverse().move_pose(frame->map_from_camera);
  last_ = std::move(frame);
}

bool Tracker::follow(TrackedFrame& frame, TrackingResult& result) {
  int landmarks = 0;
  if (state_ == TrackingState::kTracking) {
    if (follow_motion(frame) >= kMinFollowInliers || follow_keyframe(frame) >= kMinFollowInliers)
      landmarks = match_local_map(frame);
  } else if (find_again(frame)) {
    landmarks = match_local_map(frame);
    frames_since_loss_ = 0;
    has_motion_ = false;
  }
  ++frames_since_loss_;
  const int enough = frames_since_loss_ < kFramesToTrustAfterLoss ? options_.min_inliers_after_loss
                                                                  : min_inliers();
  if (landmarks < enough) {
    if (state_ == TrackingState::kTracking)
      log::warn("tracking lost at {:.3f} s: {} landmarks fit, {} needed",
                to_seconds(frame.stamp_ns), landmarks, enough);
    state_ = TrackingState::kLost;
    has_motion_ = false;
    return false;
  }
  if (state_ == TrackingState::kLost)
    log::info("tracking found again at {:.3f} s by {} landmarks", to_seconds(frame.stamp_ns),
              landmarks);
  const bool continuous = state_ == TrackingState::kTracking;
  state_ = TrackingState::kTracking;
  if (frame.median_squared) noise_level_.add(*frame.median_squared);
  choose_reference(frame);
  if (continuous) {
    last_from_current_ = last_->map_from_camera.inverse() * frame.map_from_camera;
    has_motion_ = true;
  }
  result.landmarks = landmarks;
  if (wants_keyframe(frame, landmarks)) result.keyframe = make_keyframe(frame);
  return true;
}

int Tracker::min_inliers() const {
  return rig_->sensor == Sensor::kMono ? options_.min_inliers_mono : options_.min_inliers;
}

bool Tracker::could_start(const TrackedFrame& frame) const {
  return rig_->sensor == Sensor::kMono
             ? static_cast<int>(frame.features.size()) >= options_.mono_start.min_features
             : features_with_depth(frame) >= options_.min_start_features;
}

// Whether a frame that could not be placed is to start a new part of the map. Without a server that
// could join the parts some day the client goes on looking for its old one.
bool Tracker::give_up(const TrackedFrame& frame) {
  lost_.see(frame.stamp_ns, could_start(frame));
  if (state_ != TrackingState::kLost || !has_server_ || !lost_.has_lasted()) return false;
  log::warn("lost for long: starting a new part of the map at {:.3f} s",
            to_seconds(frame.stamp_ns));
  state_ = TrackingState::kStarting;
  mono_start_ = MonoStart(rig_, options_.mono_start);
  reference_ = {};  // nothing connects it with what was before
  last_.reset();
  noise_level_ = {};
  return true;
}

void Tracker::ask_about(std::unique_ptr<TrackedFrame> frame, TrackingResult& result) {
  if (!has_server_ || !in_touch_ || !lost_.wants_to_ask()) return;
  auto question = std::make_shared<Keyframe>();
  question->id = {epoch_, ++questions_};
  question->stamp_ns = frame->stamp_ns;
  question->rig = rig_;
  question->features = frame->features;
  result.question = std::move(question);
  frame->clear_matches();
  frame->slack = 1;  // what it is to be held against is others' landmarks
  asked_ = std::move(frame);
  lost_.asked();
}

TrackingResult Tracker::take(const RelocaliseAnswer& answer) {
  TrackingResult result;
  result.state = state_;
  if (answer.epoch != epoch_ || answer.number != questions_ || !asked_) return result;
  lost_.answered();
  std::unique_ptr<TrackedFrame> frame = std::move(asked_);
  if (!answer.found) {
    log::debug("the server does not know where this is: {}", answer.why);
    return result;
  }
  // Told in another state of the map than this client has: the next answer will fit.
  if (answer.around.map != map_.id() || answer.around.merge_epoch != merge_epoch_) return result;
  const int landmarks = locate(answer, *frame);
  if (landmarks < options_.min_inliers_after_loss) return result;
  log::info("found by the server at {:.3f} s by {} landmarks", to_seconds(frame->stamp_ns),
            landmarks);
  // The way here is not known: unless the place is one that this client has been to, odom goes on
  // as if the camera had not moved.
  if (!map_.most_shared(frame->landmarks()))
    move_odom(last_odom_from_camera_, frame->map_from_camera);
  state_ = TrackingState::kTracking;
  has_motion_ = false;
  frames_since_loss_ = 0;
  // The keyframe says where in the map this client goes on.
  reference_ = answer.reference;
  if (!map_.pose_of(reference_))
    foreign_reference_ = KeyframePose{reference_, answer.map_from_reference};
  result.landmarks = landmarks;
  result.keyframe = make_keyframe(*frame);
  foreign_reference_.reset();
  finish(std::move(frame), result);
  return result;
}

// The landmarks that fit, at the pose that they fit at.
int Tracker::locate(const RelocaliseAnswer& answer, TrackedFrame& frame) {
  map_.apply(answer.around);
  frame.map_from_camera = answer.map_from_camera;
  for (const LandmarkMatch& m : answer.matches)
    if (m.feature < frame.matches.size())
      if (const LocalLandmark* landmark = map_.find(m.landmark))
        frame.matches[m.feature] = {true, landmark->id, landmark->position};
  return refine_pose(frame) >= kMinFollowInliers ? match_local_map(frame) : 0;
}

// The first frame's camera is the origin of the map; a new part after the first begins where odom
// ended.
bool Tracker::start(TrackedFrame& frame, TrackingResult& result) {
  if (rig_->sensor == Sensor::kMono) return start_mono(frame, result);
  if (features_with_depth(frame) < options_.min_start_features) return false;
  frame.map_from_camera = map_from_odom_.move_pose(last_odom_from_camera_);
  has_motion_ = false;
  state_ = TrackingState::kTracking;
  result.keyframe = make_keyframe(frame);
  log::info("map started at {:.3f} s by {} features with depth", to_seconds(frame.stamp_ns),
            features_with_depth(frame));
  return true;
}

// Without depth it takes two frames that see enough from different places; both become keyframes,
// the earlier one the origin. The frames in between get their poses afterwards.
bool Tracker::start_mono(TrackedFrame& frame, TrackingResult& result) {
  std::optional<StartMap> started = mono_start_.add(frame.stamp_ns, frame.features, frame.grid);
  if (!started) return false;
  TrackedFrame first(started->reference_stamp_ns, rig_, std::move(started->reference));
  first.map_from_camera = map_from_odom_.move_pose(last_odom_from_camera_);
  result.first_keyframe = make_keyframe(first, {});
  record(first);
  const KeyframeId origin = reference_;
  Rigid3 previous;
  for (std::size_t i = 0; i + 1 < started->poses.size(); ++i) {
    previous = started->poses[i].reference_from_camera;
    trajectory_.add(started->poses[i].stamp_ns, origin, previous);
  }
  result.earlier_frames = static_cast<int>(started->poses.size());
  const Rigid3& first_from_camera = started->poses.back().reference_from_camera;
  frame.map_from_camera = first.map_from_camera * first_from_camera;
  std::vector<ProvisionalLandmark> landmarks;
  for (const StartMap::Point& p : started->points)
    landmarks.push_back({p.feature, LandmarkId::from_feature(origin, p.reference),
                         first.map_from_camera * p.position});
  result.keyframe = make_keyframe(frame, landmarks);
  result.landmarks = static_cast<int>(landmarks.size());
  last_from_current_ = previous.inverse() * first_from_camera;
  has_motion_ = true;
  state_ = TrackingState::kTracking;
  log::info("map started at {:.3f} s by {} landmarks seen from {} frames",
            to_seconds(frame.stamp_ns), landmarks.size(), started->poses.size() + 1);
  return true;
}

// Constant velocity, matched to the last frame; twice the radius when too few are found.
int Tracker::follow_motion(TrackedFrame& frame) {
  frame.map_from_camera =
      has_motion_ ? last_->map_from_camera * last_from_current_ : last_->map_from_camera;
  const Rigid3 predicted = frame.map_from_camera;
  for (const double factor : {1.0, 2.0}) {
    frame.clear_matches();
    frame.map_from_camera = predicted;
    const int matches =
        match_to_last_frame(*last_, map_, factor * options_.last_frame_radius, frame);
    if (matches >= std::min(kMinMatches, min_inliers())) {
      const int landmarks = refine_pose(frame);
      if (landmarks >= kMinFollowInliers) return landmarks;
    }
  }
  return 0;
}

// The motion was not what it seemed: match to the nearest keyframe by looks alone.
int Tracker::follow_keyframe(TrackedFrame& frame) {
  const std::vector<KeyframePtr> recent = map_.recent_keyframes();
  const auto reference = std::find_if(recent.begin(), recent.end(),
                                      [&](const KeyframePtr& k) { return k->id == reference_; });
  if (reference == recent.end()) return 0;
  return relocalise_against(**reference, map_, kMinFollowInliers, frame)
             ? static_cast<int>(frame.landmarks().size())
             : 0;
}

// Lost: the newest keyframe every time, and two others in turn, so that one frame's cost is
// bounded.
bool Tracker::find_again(TrackedFrame& frame) {
  const std::vector<KeyframePtr> recent = map_.recent_keyframes();
  if (recent.empty()) return false;
  std::vector<std::size_t> tries{0};
  for (int i = 0; i < 2 && recent.size() > 1; ++i)
    tries.push_back(1 + lost_attempts_++ % (recent.size() - 1));
  for (const std::size_t i : tries)
    if (relocalise_against(*recent[i], map_, options_.min_inliers_after_loss, frame)) return true;
  return false;
}

int Tracker::match_local_map(TrackedFrame& frame) {
  const auto local = map_.around(frame.landmarks(), options_.local_keyframes);
  match_to_landmarks(local, options_.local_map_radius, frame);
  return refine_pose(frame);
}

void Tracker::choose_reference(const TrackedFrame& frame) {
  if (const auto best = map_.most_shared(frame.landmarks())) reference_ = *best;
}

bool Tracker::wants_keyframe(const TrackedFrame& frame, int landmarks) const {
  KeyframeSituation now;
  now.frames_since_keyframe = frames_since_keyframe_;
  now.shown_landmarks = landmarks;
  now.reference_landmarks = map_.landmarks_of(reference_);
  now.backlog = has_server_ ? unmapped() : 0;
  for (std::size_t f = 0; f < frame.features.size(); ++f) {
    const Feature& feature = frame.features.points[f];
    if (!feature.has_depth() || rig_->camera.depth(feature.disparity) > rig_->max_depth) continue;
    ++(frame.matches[f].shows_landmark() ? now.near_tracked : now.near_new);
  }
  KeyframePolicyOptions policy = options_.keyframes;
  if (rig_->sensor == Sensor::kMono) {
    policy.min_shared = policy.min_shared_mono;
    policy.weak_shared = policy.weak_shared_mono;
  }
  return cairn::wants_keyframe(policy, now);
}

// Nearest first: their depth is best.
void Tracker::make_landmarks(KeyframeId keyframe, TrackedFrame& frame) const {
  std::vector<std::pair<double, std::size_t>> candidates;
  int shown = 0;
  for (std::size_t f = 0; f < frame.features.size(); ++f) {
    if (frame.matches[f].shows_landmark())
      ++shown;
    else if (frame.features.points[f].has_depth())
      candidates.emplace_back(rig_->camera.depth(frame.features.points[f].disparity), f);
  }
  std::sort(candidates.begin(), candidates.end());
  for (int made = 0; made < static_cast<int>(candidates.size()); ++made) {
    const auto& [depth, f] = candidates[static_cast<std::size_t>(made)];
    const bool enough = shown + made >= options_.landmarks_per_keyframe || depth > rig_->max_depth;
    if (enough && made >= options_.min_new_landmarks) break;
    frame.matches[f] = {true, LandmarkId::from_feature(keyframe, static_cast<std::uint16_t>(f)),
                        frame.point_in_map(f)};
  }
}

// Of features that show nothing yet, with those of the keyframes around.
std::vector<ProvisionalLandmark> Tracker::triangulate(TrackedFrame& frame) const {
  if (rig_->sensor != Sensor::kMono) return {};
  return triangulate_provisional(map_, frame, options_.provisional);
}

KeyframePtr Tracker::make_keyframe(TrackedFrame& frame) {
  return make_keyframe(frame, triangulate(frame));
}

KeyframePtr Tracker::make_keyframe(TrackedFrame& frame,
                                   std::span<const ProvisionalLandmark> triangulated) {
  auto keyframe = std::make_shared<Keyframe>();
  keyframe->id = {epoch_, next_sequence_++};
  keyframe->stamp_ns = frame.stamp_ns;
  keyframe->rig = rig_;
  keyframe->noise = frame.noise();
  keyframe->odom_from_camera = map_from_odom_.inverse() * Sim3(frame.map_from_camera);
  keyframe->reference = reference_;
  if (const auto map_from_reference = foreign_reference_ ? foreign_reference_->map_from_camera
                                                         : map_.scaled_pose_of(reference_))
    keyframe->reference_from_camera = map_from_reference->inverse() * Sim3(frame.map_from_camera);

  make_landmarks(keyframe->id, frame);
  for (const ProvisionalLandmark& p : triangulated)
    frame.matches[p.feature] = {true, p.id, p.position};
  for (std::size_t f = 0; f < frame.features.size(); ++f)
    if (frame.matches[f].shows_landmark())
      keyframe->matches.push_back({static_cast<std::uint16_t>(f), frame.matches[f].landmark});

  keyframe->features = frame.features;
  map_.add_keyframe(keyframe, frame.map_from_camera);
  for (const ProvisionalLandmark& p : triangulated) map_.add_landmark(*keyframe, p);
  reference_ = keyframe->id;
  frames_since_keyframe_ = 0;
  return keyframe;
}

void Tracker::record(const TrackedFrame& frame) {
  const auto map_from_reference = map_.scaled_pose_of(reference_);
  reference_from_last_ = map_from_reference->inverse().move_pose(frame.map_from_camera);
  trajectory_.add(frame.stamp_ns, reference_, reference_from_last_);
}

void Tracker::apply(const MapUpdate& update) {
  // The last frame keeps its place beside its reference keyframe, in its unit; the difference goes
  // between odom and map, so that the client's own frame does not jump.
  const Rigid3 odom_from_camera =
      last_ ? map_from_odom_.inverse().move_pose(last_->map_from_camera) : Rigid3();
  const double old_unit = last_ ? map_.scaled_pose_of(reference_)->scale : 1;
  if (map_.is_of_another_map(update)) change_map();
  map_.apply(update);
  merge_epoch_ = update.merge_epoch;
  if (update.epoch == epoch_)
    mapped_keyframes_ = std::max(mapped_keyframes_, update.mapped_keyframes);
  if (!last_) {
    if (update.new_map_from_old_map) map_from_odom_ = *update.new_map_from_old_map * map_from_odom_;
    return;
  }
  const Sim3 map_from_reference = *map_.scaled_pose_of(reference_);
  const double growth = map_from_reference.scale / old_unit;
  last_->map_from_camera = map_from_reference.move_pose(reference_from_last_);
  last_from_current_.translation *= growth;
  map_from_odom_.scale *= growth;
  move_odom(odom_from_camera, last_->map_from_camera);
}

// What is at one place in odom is at the other one in the map; the scale stays.
void Tracker::move_odom(const Rigid3& odom_from_camera, const Rigid3& map_from_camera) {
  const Sim3 map_from_camera_in_odom(map_from_camera.rotation, map_from_camera.translation,
                                     map_from_odom_.scale);
  map_from_odom_ = map_from_camera_in_odom * Sim3(odom_from_camera).inverse();
}

void Tracker::change_map() {
  log::warn("the server has another map: going on in it with what this client knows");
  const NewNames names = map_.change_map(map_from_odom_.inverse());
  if (!last_) return;
  for (FeatureMatch& match : last_->matches)
    if (match.shows_landmark()) match.landmark = names.of(match.landmark);
}

}  // namespace cairn
