#include "common/model/trajectory.h"

#include <filesystem>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

namespace cairn {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class TrajectoryFile : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("cairn_trajectory_" + std::to_string(getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string write(const std::string& name, const std::string& text) {
    std::ofstream(folder_ / name) << text;
    return (folder_ / name).string();
  }
  Trajectory read(const std::string& text) {
    const auto result = read_trajectory(write("t.txt", text));
    EXPECT_TRUE(result.ok()) << (result.ok() ? "" : result.message());
    return result.ok() ? *result : Trajectory{};
  }
  std::string error(const std::string& text) {
    const auto result = read_trajectory(write("t.txt", text));
    return result.ok() ? "no error" : result.message();
  }

  fs::path folder_;
};

TEST_F(TrajectoryFile, TumLinesMayHaveCommentsBlanksAndWindowsEnds) {
  const Trajectory poses = read(
      "# timestamp tx ty tz qx qy qz qw\r\n\n"
      "  1.5   1 2 3  0 0 0 1 \r\n"
      "2.5\t4 5 6 0.70710678 0 0 0.70710678\n\n");
  ASSERT_EQ(poses.size(), 2u);
  EXPECT_EQ(poses[0].stamp_ns, 1'500'000'000);
  EXPECT_EQ(poses[0].world_from_camera.translation, Eigen::Vector3d(1, 2, 3));
  EXPECT_NEAR(rotation_angle(poses[1].world_from_camera), M_PI / 2, 1e-7);
  EXPECT_NEAR(poses[1].world_from_camera.rotation.norm(), 1, 1e-15);
}

TEST_F(TrajectoryFile, StampsKeepTheirNanoseconds) {
  // As a double, the second stamp would be 36 ns off.
  const Trajectory poses = read(
      "1305031229.528748 0 0 0 0 0 0 1\n1403715285.262142897 0 0 0 0 0 0 1\n"
      "1.403715286e+09 0 0 0 0 0 0 1\n1403715287 0 0 0 0 0 0 1\n");
  ASSERT_EQ(poses.size(), 4u);
  EXPECT_EQ(poses[0].stamp_ns, 1305031229'528748000);
  EXPECT_EQ(poses[1].stamp_ns, 1403715285'262142897);
  EXPECT_EQ(poses[2].stamp_ns, 1403715286'000000000);
  EXPECT_EQ(poses[3].stamp_ns, 1403715287'000000000);
}

TEST_F(TrajectoryFile, PosesAreSortedAndTheFirstOfEachStampCounts) {
  const Trajectory poses =
      read("3 3 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n3 9 0 0 0 0 0 1\n2 2 0 0 0 0 0 1\n");
  ASSERT_EQ(poses.size(), 3u);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(poses[i].world_from_camera.translation.x(), i + 1);
}

TEST_F(TrajectoryFile, EurocLinesHaveNanosecondsAndTheScalarFirst) {
  const Trajectory poses = read(
      "#timestamp, p_RS_R_x [m], ...\n"
      "1403715273262142976,0.878,2.18,0.94,0.70710678,0,0,0.70710678,0.1,0.2,0.3\n");
  ASSERT_EQ(poses.size(), 1u);
  EXPECT_EQ(poses[0].stamp_ns, 1403715273262142976);
  EXPECT_EQ(poses[0].world_from_camera.translation, Eigen::Vector3d(0.878, 2.18, 0.94));
  // A quarter turn about z takes x to y.
  const Eigen::Vector3d x_turned = poses[0].world_from_camera.rotation * Eigen::Vector3d::UnitX();
  EXPECT_TRUE(x_turned.isApprox(Eigen::Vector3d::UnitY(), 1e-7));
}

TEST_F(TrajectoryFile, KittiLinesTakeTheirStampsFromTimesTxt) {
  const std::string poses_path =
      write("poses.txt", "1 0 0 5 0 1 0 6 0 0 1 7\n0 0 1 0 0 1 0 0 -1 0 0 0\n");
  EXPECT_THAT(read_trajectory(poses_path).message(), HasSubstr("times.txt"));
  write("times.txt", "0.0\n1.037359e-01\n2.0e-01\n");
  const auto poses = read_trajectory(poses_path);
  ASSERT_TRUE(poses.ok()) << poses.message();
  ASSERT_EQ(poses->size(), 2u);
  EXPECT_EQ((*poses)[0].world_from_camera.translation, Eigen::Vector3d(5, 6, 7));
  EXPECT_EQ((*poses)[1].stamp_ns, 103735900);
  EXPECT_NEAR(rotation_angle((*poses)[1].world_from_camera), M_PI / 2, 1e-9);
  write("times.txt", "0.0\n");
  EXPECT_THAT(read_trajectory(poses_path).message(), HasSubstr("fewer lines"));
}

TEST_F(TrajectoryFile, BadLinesAreNamed) {
  EXPECT_THAT(error("1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0\n"), HasSubstr("t.txt:2: expected"));
  EXPECT_THAT(error("1 0 0 0 0 0 x 1\n"), HasSubstr("t.txt:1: expected"));
  EXPECT_THAT(error("1 nan 0 0 0 0 0 1\n"), HasSubstr("t.txt:1: expected"));
  EXPECT_THAT(error("1 0 0 0 0 0 0 0\n"), HasSubstr("unit quaternion"));
  EXPECT_THAT(error("-1 0 0 0 0 0 0 1\n"), HasSubstr("t.txt:1: expected"));
  EXPECT_THAT(error("99999999999 0 0 0 0 0 0 1\n"), HasSubstr("t.txt:1: expected"));
  EXPECT_THAT(error("2 0 0 1 0 0 0 1 0 0 0 1\n"), HasSubstr("rotation"));
  EXPECT_THAT(error("# only a comment\n"), HasSubstr("holds no pose"));
}

TEST_F(TrajectoryFile, MissingFileSaysSo) {
  const auto result = read_trajectory((folder_ / "absent.txt").string());
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().code, ErrorCode::kNotFound);
  EXPECT_FALSE(read_trajectory(folder_.string()).ok());
}

TEST_F(TrajectoryFile, WhatIsWrittenReadsBackTheSame) {
  const Rigid3 pose(so3_exp({0.1, -2.0, 0.3}), {1.25, -3.5, 1e-3});
  const std::string path = (folder_ / "out.tum").string();
  ASSERT_TRUE(write_trajectory(path, {{1305031229'528748001, pose}}).ok());
  const auto back = read_trajectory(path);
  ASSERT_TRUE(back.ok()) << back.message();
  EXPECT_EQ((*back)[0].stamp_ns, 1305031229'528748001);
  const Rigid3 difference = pose.inverse() * (*back)[0].world_from_camera;
  EXPECT_LT(difference.translation.norm(), 1e-6);
  EXPECT_LT(rotation_angle(difference), 1e-8);
  EXPECT_FALSE(write_trajectory((folder_ / "no" / "out.tum").string(), *back).ok());
}

}  // namespace
}  // namespace cairn
