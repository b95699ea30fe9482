// A client that does with map updates what their definition says, and nothing else.
#pragma once

#include <map>

#include <gtest/gtest.h>

#include "common/model/keyframe.h"
#include "common/model/map_update.h"

namespace cairn {

struct ModelClient {
  // As a client does when it makes a keyframe: its landmarks are there at once.
  void make(const Keyframe& keyframe) {
    for (const LandmarkMatch& match : keyframe.matches)
      if (match.landmark == LandmarkId::from_feature(keyframe.id, match.feature))
        landmarks.try_emplace(match.landmark);
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
    for (const LandmarkState& state : update.landmarks) landmarks[state.id] = {true, state};
    for (const LandmarkRemoval& removal : update.removed_landmarks) {
      if (removal.replaced_by) {
        EXPECT_TRUE(landmarks.contains(*removal.replaced_by)) << "renamed to an unknown one";
      }
      landmarks.erase(removal.id);
    }
    return true;
  }

  std::optional<Rigid3> pose_of(KeyframeId id) const {
    if (const auto own = poses.find(id); own != poses.end()) return own->second;
    const auto link = hanging.find(id);
    if (link == hanging.end()) return std::nullopt;
    const auto anchor = pose_of(link->second.anchor);
    if (!anchor) return std::nullopt;
    return *anchor * link->second.anchor_from_camera;
  }

  struct Known {
    bool placed = false;  // by the server
    LandmarkState state;
  };
  std::map<KeyframeId, Rigid3> poses;
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
      return entry.second.placed || entry.first.creator().sequence < update.mapped_keyframes;
    });
  }
};

}  // namespace cairn
