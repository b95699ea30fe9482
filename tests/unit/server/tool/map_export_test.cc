#include "server/tool/map_export.h"

#include <filesystem>
#include <fstream>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>
#include <nlohmann/json.hpp>

namespace cairn {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::StartsWith;

constexpr std::uint64_t kEpochA = 0xa, kEpochB = 0xb;

std::shared_ptr<const Rig> rig() {
  Rig out;
  out.camera = {.fx = 500, .fy = 500, .cx = 320, .cy = 240, .width = 640, .height = 480};
  return std::make_shared<Rig>(out);
}

void add_keyframe(Map& map, const std::shared_ptr<const Rig>& shared_rig, KeyframeId id, int second,
                  const Eigen::Vector3d& position,
                  const std::vector<std::pair<float, LandmarkId>>& seen) {
  auto keyframe = std::make_shared<Keyframe>();
  keyframe->id = id;
  keyframe->stamp_ns = second * 1'000'000'000LL + 250;
  keyframe->rig = shared_rig;
  KeyframeNode node;
  for (const auto& [x, landmark] : seen) {
    keyframe->features.points.push_back({.x = x, .y = 240});
    keyframe->features.descriptors.push_back({});
    node.landmarks.edit().push_back(landmark);
  }
  node.keyframe = keyframe;
  node.map_from_camera.translation = position;
  map.keyframes.insert(id, node);
}

// Two clients look along z at landmark 1, which lies 5 m ahead of the origin, and client B at
// landmark 2 as well. Client A goes 1 m to the right between its keyframes, 2 s apart.
Map small_map() {
  Map map;
  map.id.value = 0x77;
  map.revision = 9;
  const auto shared_rig = rig();
  const LandmarkId one{0, 1}, two{0, 2};
  // x = 500 * (0 - camera x) / 5 + 320: 320 at the origin, 220 from 1 m to the right.
  add_keyframe(map, shared_rig, {kEpochA, 0}, 10, {0, 0, 0}, {{320, one}, {50, {}}});
  add_keyframe(map, shared_rig, {kEpochA, 1}, 12, {1, 0, 0}, {{223, one}});  // 3 px off
  add_keyframe(map, shared_rig, {kEpochB, 0}, 11, {0, 0, 0}, {{320, two}, {320, one}});
  const auto landmark = [&](LandmarkId id, const Eigen::Vector3d& p, std::vector<Observation> o) {
    Landmark out;
    out.id = id;
    out.position = p;
    out.observations = std::move(o);
    map.landmarks.insert(id, out);
  };
  landmark(one, {0, 0, 5}, {{{kEpochA, 0}, 0}, {{kEpochA, 1}, 0}, {{kEpochB, 0}, 1}});
  landmark(two, {0, 0, 7}, {{{kEpochB, 0}, 0}});
  return map;
}

std::string written(void (*write)(const Map&, std::ostream&), const Map& map) {
  std::ostringstream out;
  write(map, out);
  return out.str();
}

TEST(MapInfo, CountsAndMeasures) {
  const MapInfo info = info_of(small_map());
  EXPECT_EQ(info.id, 0x77u);
  EXPECT_EQ(info.revision, 9u);
  EXPECT_EQ(info.keyframes, 3u);
  EXPECT_EQ(info.landmarks, 2u);
  EXPECT_EQ(info.observations, 4u);
  EXPECT_DOUBLE_EQ(info.mean_observations, 2);
  // Four observations, one of them 3 px off: sqrt(9 / 4).
  EXPECT_NEAR(info.reprojection_rmse, 1.5, 1e-9);
  EXPECT_EQ(info.box_min, Eigen::Vector3d(0, 0, 5));
  EXPECT_EQ(info.box_max, Eigen::Vector3d(0, 0, 7));
  ASSERT_EQ(info.runs.size(), 2u);
  EXPECT_EQ(info.runs[0].epoch, kEpochA);
  EXPECT_EQ(info.runs[0].keyframes, 2u);
  EXPECT_DOUBLE_EQ(info.runs[0].path_m, 1);
  EXPECT_DOUBLE_EQ(info.runs[0].duration_s, 2);
  EXPECT_DOUBLE_EQ(info.runs[1].path_m, 0);
}

TEST(MapInfo, AnEmptyMapIsFine) {
  const MapInfo info = info_of(Map());
  EXPECT_EQ(info.keyframes, 0u);
  EXPECT_TRUE(info.runs.empty());
  EXPECT_EQ(info.box_max, Eigen::Vector3d(0, 0, 0));
}

TEST(MapExport, TumNamesEachRun) {
  EXPECT_EQ(written(write_tum, small_map()),
            "# client run 000000000000000a: timestamp tx ty tz qx qy qz qw\n"
            "10.000000250 0.0000000 0.0000000 0.0000000 0.000000000 0.000000000 0.000000000 "
            "1.000000000\n"
            "12.000000250 1.0000000 0.0000000 0.0000000 0.000000000 0.000000000 0.000000000 "
            "1.000000000\n"
            "# client run 000000000000000b: timestamp tx ty tz qx qy qz qw\n"
            "11.000000250 0.0000000 0.0000000 0.0000000 0.000000000 0.000000000 0.000000000 "
            "1.000000000\n");
}

TEST(MapExport, PlyHoldsLandmarksAndCameras) {
  const std::string ply = written(write_ply, small_map());
  EXPECT_THAT(ply, StartsWith("ply\nformat ascii 1.0\nelement vertex 5\n"));
  EXPECT_THAT(ply, HasSubstr("end_header\n0.0000 0.0000 5.0000 190 190 190\n"));
  EXPECT_THAT(ply, HasSubstr("\n1.0000 0.0000 0.0000 220 40 40\n"));
}

TEST(MapExport, ColmapPixelsStartHalfAPixelLater) {
  const Map map = small_map();
  // One camera although every keyframe has it; the principal point moves by half a pixel.
  EXPECT_THAT(written(write_colmap_cameras, map),
              HasSubstr("\n1 PINHOLE 640 480 500.000000 500.000000 320.500000 240.500000\n"));
  const std::string images = written(write_colmap_images, map);
  // The camera stands at x = 1 m, so camera_from_world has -1.
  EXPECT_THAT(images, HasSubstr("\n2 1.000000000 -0.000000000 -0.000000000 -0.000000000 -1.0000000 "
                                "-0.0000000 -0.0000000 1 000000000000000a/12.000000250.png\n"
                                "223.500 240.500 1\n"));
  EXPECT_THAT(images, HasSubstr("\n320.500 240.500 1 50.500 240.500 -1\n"));
}

TEST(MapExport, ColmapPointsNameImagesAndFeatures) {
  // Landmark 1: errors 0, 3 and 0 px, so 1 px in the mean; seen in image 1 as its feature 0, in 2
  // as 0 and in 3 as 1.
  EXPECT_THAT(written(write_colmap_points, small_map()),
              HasSubstr("\n1 0.000000 0.000000 5.000000 190 190 190 1.0000 1 0 2 0 3 1\n"
                        "2 0.000000 0.000000 7.000000 190 190 190 0.0000 3 0\n"));
}

TEST(MapExport, JsonParsesBack) {
  const Map map = small_map();
  MapInfo info = info_of(map);
  info.runs[0].client = "anna";
  std::ostringstream text;
  write_json(map, info, text);
  const auto json = nlohmann::json::parse(text.str());
  EXPECT_EQ(json["info"]["runs"][0]["client"], "anna");
  EXPECT_EQ(json["info"]["keyframes"], 3);
  EXPECT_EQ(json["keyframes"][1]["stamp_ns"], 12'000'000'250);
  EXPECT_EQ(json["keyframes"][1]["map_from_camera"]["position"][0], 1.0);
  EXPECT_EQ(json["landmarks"][0]["observations"][2][0], "000000000000000b/0");
  EXPECT_EQ(json["landmarks"][0]["observations"][2][1], 1);
}

TEST(MapExport, WritesFilesAndFoldersOrSaysWhyNot) {
  const fs::path folder = fs::temp_directory_path() / ("cairn_export_" + std::to_string(getpid()));
  const Map map = small_map();
  ASSERT_TRUE(export_map(map, info_of(map), MapFormat::kColmap, folder.string()).ok());
  for (const char* name : {"cameras.txt", "images.txt", "points3D.txt"})
    EXPECT_TRUE(fs::file_size(folder / name) > 0) << name;
  ASSERT_TRUE(export_map(map, info_of(map), MapFormat::kTum, (folder / "map.tum").string()).ok());
  EXPECT_EQ(read_trajectory((folder / "map.tum").string())->size(), 3u);
  EXPECT_FALSE(
      export_map(map, info_of(map), MapFormat::kPly, (folder / "no" / "map.ply").string()).ok());
  EXPECT_FALSE(
      export_map(map, info_of(map), MapFormat::kColmap, (folder / "map.tum").string()).ok());
  fs::remove_all(folder);
}

}  // namespace
}  // namespace cairn
