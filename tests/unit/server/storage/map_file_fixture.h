// What the tests of the map file share: a file in a folder of its own, keyframes as ingest hands
// them on, and maps compared in all that they hold.
#pragma once

#include <filesystem>
#include <fstream>

#include <gtest/gtest.h>
#include <unistd.h>

#include "server/map/apply.h"
#include "server/storage/map_file.h"
#include "tests/unit/server/synthetic_map.h"

namespace cairn {

namespace fs = std::filesystem;

inline const ClientId kClient{"walker", 7};

// A folder of its own for each test, gone afterwards.
class MapFileTest : public testing::Test {
 protected:
  MapFileTest()
      : folder_(fs::temp_directory_path() / ("cairn_map_file_test_" + std::to_string(getpid()))),
        path_(folder_ / "map.db") {
    fs::create_directories(folder_);
  }
  ~MapFileTest() override { fs::remove_all(folder_); }

  std::unique_ptr<MapFile> open(MapFile::Mode mode = MapFile::Mode::kReadWrite) {
    auto file = MapFile::open(path_, mode);
    EXPECT_TRUE(file.ok()) << file.message();
    return std::move(*file);
  }
  ErrorCode code_of_open() {
    const auto file = MapFile::open(path_);
    EXPECT_FALSE(file.ok());
    if (file.ok()) return ErrorCode::kInternal;
    EXPECT_EQ(file.message().find('\n'), std::string::npos);
    EXPECT_NE(file.message().find("map.db"), std::string::npos);
    return file.error().code;
  }
  void write_file(const std::string& bytes) { std::ofstream(path_, std::ios::binary) << bytes; }
  std::string read_file() {
    std::ifstream in(path_, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }

  const fs::path folder_, path_;
};

// What goes through the wire, as ingest would hand it on.
struct Sent {
  explicit Sent(const SyntheticMap& world) {
    for (const KeyframePtr& keyframe : world.keyframes) {
      blobs.push_back(*wire::encode_keyframe(kClient.name, *keyframe));
      keyframes.push_back(wire::decode_keyframe(blobs.back())->keyframe);
    }
  }
  void append(MapFile& file, std::size_t first, std::size_t last) const {
    for (std::size_t i = first; i < last; ++i) {
      const Status status = file.append(kClient, keyframes[i]->id, blobs[i]);
      ASSERT_TRUE(status.ok()) << status.message();
    }
  }
  std::vector<wire::Blob> blobs;
  std::vector<KeyframePtr> keyframes;
};

inline const SyntheticMap& small_world() {
  static const SyntheticMap world({.keyframes = 6, .points = 150});
  return world;
}

inline Map map_of(const Sent& sent, std::size_t count) {
  Map map;
  map.id = {42};
  for (std::size_t i = 0; i < count; ++i) apply_keyframe(map, sent.keyframes[i]);
  return map;
}

inline void expect_same_node(const KeyframeNode& a, const KeyframeNode& b) {
  EXPECT_EQ(a.map_from_camera.matrix(), b.map_from_camera.matrix());
  EXPECT_EQ(a.unit, b.unit);
  EXPECT_EQ(a.landmarks, b.landmarks);
  EXPECT_EQ(a.parent, b.parent);
  EXPECT_EQ(a.children, b.children);
  EXPECT_EQ(a.arrival, b.arrival);
  EXPECT_EQ(a.revision, b.revision);
  ASSERT_EQ(a.covisible.size(), b.covisible.size());
  for (std::size_t i = 0; i < a.covisible.size(); ++i) {
    EXPECT_EQ(a.covisible[i].keyframe, b.covisible[i].keyframe);
    EXPECT_EQ(a.covisible[i].shared, b.covisible[i].shared);
  }
  EXPECT_EQ(a.keyframe->stamp_ns, b.keyframe->stamp_ns);
  EXPECT_EQ(a.rig(), b.rig());
  ASSERT_EQ(a.features().size(), b.features().size());
  EXPECT_EQ(a.features().descriptors, b.features().descriptors);
}

inline void expect_same_landmark(const Landmark& a, const Landmark& b) {
  EXPECT_EQ(a.id, b.id);
  EXPECT_EQ(a.position, b.position);
  EXPECT_EQ(a.observations, b.observations);
  EXPECT_EQ(a.reference, b.reference);
  EXPECT_EQ(a.descriptor, b.descriptor);
  EXPECT_EQ(a.normal, b.normal);
  EXPECT_EQ(a.min_distance, b.min_distance);
  EXPECT_EQ(a.max_distance, b.max_distance);
  EXPECT_EQ(std::tuple(a.visible, a.found, a.birth, a.arrival, a.revision),
            std::tuple(b.visible, b.found, b.birth, b.arrival, b.revision));
}

inline void expect_same_transform(const Sim3& a, const Sim3& b) {
  EXPECT_EQ(a.rotation.coeffs(), b.rotation.coeffs());
  EXPECT_EQ(a.translation, b.translation);
  EXPECT_EQ(a.scale, b.scale);
}

inline void expect_same_edge(const LoopEdge& a, const LoopEdge& b) {
  EXPECT_EQ(std::tuple(a.query, a.candidate, a.inliers, a.merges, a.moved),
            std::tuple(b.query, b.candidate, b.inliers, b.merges, b.moved));
  expect_same_transform(a.candidate_from_query, b.candidate_from_query);
  expect_same_transform(a.new_map_from_old_map, b.new_map_from_old_map);
}

inline void expect_same_map(const Map& a, const Map& b) {
  EXPECT_EQ(a.id, b.id);
  EXPECT_EQ(a.revision, b.revision);
  EXPECT_EQ(a.merge_epoch, b.merge_epoch);
  EXPECT_EQ(a.keyframes_ever, b.keyframes_ever);
  EXPECT_EQ(a.next_landmark, b.next_landmark);
  ASSERT_EQ(a.keyframes.sorted_keys(), b.keyframes.sorted_keys());
  for (const KeyframeId id : a.keyframes.sorted_keys())
    expect_same_node(a.keyframes.at(id), b.keyframes.at(id));
  ASSERT_EQ(a.landmarks.sorted_keys(), b.landmarks.sorted_keys());
  for (const LandmarkId id : a.landmarks.sorted_keys())
    expect_same_landmark(a.landmarks.at(id), b.landmarks.at(id));
  ASSERT_EQ(a.replaced_landmarks.sorted_keys(), b.replaced_landmarks.sorted_keys());
  for (const LandmarkId id : a.replaced_landmarks.sorted_keys())
    EXPECT_EQ(a.replaced_landmarks.at(id).now, b.replaced_landmarks.at(id).now);
  ASSERT_EQ(a.removed_keyframes.sorted_keys(), b.removed_keyframes.sorted_keys());
  for (const KeyframeId id : a.removed_keyframes.sorted_keys()) {
    EXPECT_EQ(a.removed_keyframes.at(id).anchor, b.removed_keyframes.at(id).anchor);
    expect_same_transform(a.removed_keyframes.at(id).anchor_from_camera,
                          b.removed_keyframes.at(id).anchor_from_camera);
  }
  ASSERT_EQ(a.mapped_keyframes.sorted_keys(), b.mapped_keyframes.sorted_keys());
  for (const std::uint64_t epoch : a.mapped_keyframes.sorted_keys())
    EXPECT_EQ(a.mapped_of(epoch), b.mapped_of(epoch));
  ASSERT_EQ(a.loops.size(), b.loops.size());
  for (std::size_t i = 0; i < a.loops.size(); ++i) expect_same_edge(a.loops[i], b.loops[i]);
}

inline Map load(MapFile& file) {
  auto map = file.load_map();
  EXPECT_TRUE(map.ok()) << map.message();
  EXPECT_TRUE(map->has_value());
  return std::move(**map);
}

inline SaveSummary save(MapFile& file, const Map& map) {
  const auto summary = file.save_map(map);
  EXPECT_TRUE(summary.ok()) << summary.message();
  return *summary;
}

inline std::size_t pending_count(MapFile& file) {
  const auto pending = file.pending_keyframes();
  EXPECT_TRUE(pending.ok()) << pending.message();
  return pending->size();
}

// Two landmarks fused, a keyframe scaled and another one culled, so that every table has rows.
inline void rework(Map& map) {
  const auto landmarks = map.landmarks.sorted_keys();
  MapDelta delta;
  delta.base_revision = map.revision;
  delta.removed_landmarks = {landmarks[0]};
  delta.positions = {{landmarks[4], {1, 2, 3}}};
  const KeyframeId scaled = map.keyframes.sorted_keys()[1];
  delta.poses = {{scaled, *map.pose_of(scaled), *map.pose_of(scaled), 1.25}};
  apply_delta(map, delta);
  map.replaced_landmarks.insert(landmarks[0], {landmarks[1], map.keyframes_ever});
  map.mapped_keyframes.insert(kClient.epoch, 4);
  ASSERT_TRUE(remove_keyframe(map, {kClient.epoch, 2}));
}

}  // namespace cairn
