// A client that does with map updates what their definition says, and nothing else.
#pragma once

#include <map>
#include <optional>

#include <gtest/gtest.h>

#include "common/model/keyframe.h"
#include "common/model/map_update.h"

namespace cairn {

struct ModelClient {
  // As a client does when it makes a keyframe: its landmarks are there at once, and move with it.
  void make(const Keyframe& keyframe) {
    const PinholeCamera& camera = keyframe.rig->camera;
    for (const LandmarkMatch& match : keyframe.matches) {
      if (match.landmark != LandmarkId::from_feature(keyframe.id, match.feature)) continue;
      const Feature& f = keyframe.features.points[match.feature];
      landmarks.try_emplace(
          match.landmark,
          Known{.in_maker = camera.unproject(f.pixel(), camera.depth(f.disparity)), .state = {}});
    }
  }

  // False when the update does not follow on the last one.
  bool apply(const MapUpdate& update) {
    if (!update.is_refresh() && update.base_revision != revision) return false;
    if (update.is_refresh()) start_over(update);
    revision = update.revision;
    mapped = update.mapped_keyframes;
    for (const KeyframePose& pose : update.keyframes) {
      poses[pose.id] = pose.map_from_camera;
      hanging.erase(pose.id);
    }
    for (const KeyframeRemoval& removal : update.removed_keyframes) {
      EXPECT_EQ(removal.anchor.epoch, removal.id.epoch) << "the client has no such keyframe";
      hanging[removal.id] = removal;
      poses.erase(removal.id);
    }
    for (auto& [id, known] : landmarks) {
      if (!known.in_maker) continue;
      const auto pose = pose_of(id.creator());
      if (pose) known.state.position = *pose * *known.in_maker;
      if (id.creator().sequence < mapped) known.in_maker.reset();
    }
    for (const LandmarkState& state : update.landmarks) landmarks[state.id] = {{}, state};
    for (const LandmarkMove& move : update.moved_landmarks) {
      EXPECT_TRUE(landmarks.contains(move.id)) << "an unknown one has moved";
      landmarks[move.id].in_maker.reset();
      landmarks[move.id].state.position = move.position;
    }
    for (const LandmarkRemoval& removal : update.removed_landmarks) {
      if (removal.replaced_by) {
        EXPECT_TRUE(landmarks.contains(*removal.replaced_by)) << "renamed to an unknown one";
      }
      landmarks.erase(removal.id);
    }
    return true;
  }

  std::optional<Sim3> pose_of(KeyframeId id) const {
    if (const auto own = poses.find(id); own != poses.end()) return own->second;
    const auto link = hanging.find(id);
    if (link == hanging.end()) return std::nullopt;
    const auto anchor = pose_of(link->second.anchor);
    if (!anchor) return std::nullopt;
    return *anchor * link->second.anchor_from_camera;
  }

  struct Known {
    // While it moves with the keyframe that made it: where it lies in that one's camera.
    std::optional<Eigen::Vector3d> in_maker;
    LandmarkState state;
  };
  std::map<KeyframeId, Sim3> poses;
  std::map<KeyframeId, KeyframeRemoval> hanging;
  std::map<LandmarkId, Known> landmarks;
  std::uint64_t revision = 0;
  std::uint32_t mapped = 0;

 private:
  // Keeps only what it has made from keyframes that the server has not mapped yet.
  void start_over(const MapUpdate& update) {
    poses.clear();
    hanging.clear();
    std::erase_if(landmarks, [&](const auto& entry) {
      return !entry.second.in_maker || entry.first.creator().sequence < update.mapped_keyframes;
    });
  }
};

}  // namespace cairn
