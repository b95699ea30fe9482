#include "client/trajectory_files.h"

#include <filesystem>
#include <fstream>

#include <gtest/gtest.h>

#include "tests/support/temp_folder.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

Trajectory walk(int frames, double start_s) {
  Trajectory t;
  for (int i = 0; i < frames; ++i)
    t.push_back({static_cast<std::int64_t>(1e9 * (start_s + 0.1 * i)), {}});
  return t;
}

class TrajectoryFiles : public ::testing::Test {
 protected:
  std::string file(const std::string& name) const { return (folder_.path() / name).string(); }
  synthetic::TempFolder folder_;
};

TEST_F(TrajectoryFiles, PartsAreNamedAfterTheFirstFile) {
  EXPECT_EQ(trajectory_file("out.tum", 1), "out.tum");
  EXPECT_EQ(trajectory_file("out.tum", 2), "out.part2.tum");
  EXPECT_EQ(trajectory_file("/a.b/out", 12), "/a.b/out.part12");
}

TEST_F(TrajectoryFiles, EachPartIsWrittenAndTold) {
  const auto written = write_trajectories(file("t.tum"), {walk(5, 1), walk(3, 7)});
  ASSERT_TRUE(written) << written.message();
  ASSERT_EQ(written->size(), 2u);
  EXPECT_EQ((*written)[1].file, file("t.part2.tum"));
  EXPECT_EQ((*written)[1].frames, 3u);
  EXPECT_EQ((*written)[1].first_ns, 7'000'000'000);
  EXPECT_EQ((*written)[1].last_ns, 7'200'000'000);
  EXPECT_EQ(read_trajectory(file("t.tum"))->size(), 5u);
  EXPECT_EQ(read_trajectory(file("t.part2.tum"))->size(), 3u);
}

TEST_F(TrajectoryFiles, PartsOfAnEarlierRunAreRemoved) {
  ASSERT_TRUE(write_trajectories(file("t.tum"), {walk(5, 1), walk(3, 7), walk(2, 9)}));
  std::ofstream(file("t.part9.tum")) << "not of that run\n";
  ASSERT_TRUE(write_trajectories(file("t.tum"), {walk(8, 1)}));
  EXPECT_FALSE(fs::exists(file("t.part2.tum")));
  EXPECT_FALSE(fs::exists(file("t.part3.tum")));
  EXPECT_TRUE(fs::exists(file("t.part9.tum")));
}

TEST_F(TrajectoryFiles, ARunWithoutAPoseLeavesAnEmptyFile) {
  const auto written = write_trajectories(file("t.tum"), {});
  ASSERT_TRUE(written);
  EXPECT_EQ(written->size(), 1u);
  EXPECT_TRUE(fs::exists(file("t.tum")));
}

TEST_F(TrajectoryFiles, AFileThatCantBeWrittenIsAnError) {
  EXPECT_FALSE(write_trajectories(file("no/such/folder/t.tum"), {walk(2, 1)}));
}

}  // namespace
}  // namespace cairn
