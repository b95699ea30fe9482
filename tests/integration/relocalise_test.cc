// Clients that don't know where they are, with the real programs: found in what others have mapped,
// joined to a map from a file, or starting anew until the map joins up.
#include <csignal>

#include <gtest/gtest.h>

#include "tests/integration/accuracy.h"
#include "tests/integration/process.h"

namespace cairn::testing {
namespace {

using std::chrono::seconds;

// One trajectory of what several clients wrote, and its truth: the stamps of each moved out of the
// others' way. One alignment then serves all, who must be in one frame.
struct Joint {
  // Frames before `first` are left out.
  void add(const synthetic::SequenceOptions& options, const std::string& file, int first = 0) {
    const std::int64_t shift = 1'000'000'000'000 * clients++;
    const auto sequence = synthetic::SyntheticSequence::make(options);
    ASSERT_TRUE(sequence.ok());
    const std::int64_t from = (*sequence)->stamp_ns(first);
    for (StampedPose pose : truth_of(options)) {
      pose.stamp_ns += shift;
      truth.push_back(pose);
    }
    const Result<Trajectory> written = read_trajectory(file);
    ASSERT_TRUE(written) << written.message();
    for (StampedPose pose : *written) {
      if (pose.stamp_ns < from) continue;
      pose.stamp_ns += shift;
      estimate.push_back(pose);
    }
  }
  double ate() const {
    const Result<Evaluation> evaluation = evaluate(truth, estimate);
    EXPECT_TRUE(evaluation.ok()) << evaluation.message();
    return evaluation.ok() ? evaluation->ate.rmse : 1e9;
  }

  std::int64_t clients = 0;
  Trajectory truth, estimate;
};

// Seconds from the given frame to the first one after it that has a pose.
double lost_for(const synthetic::SequenceOptions& options, int frame, const std::string& file) {
  const auto sequence = synthetic::SyntheticSequence::make(options);
  const Result<Trajectory> written = read_trajectory(file);
  EXPECT_TRUE(sequence.ok() && written) << written.message();
  if (!sequence.ok() || !written) return 1e9;
  const std::int64_t from = (*sequence)->stamp_ns(frame);
  for (const StampedPose& pose : *written)
    if (pose.stamp_ns >= from) return 1e-9 * static_cast<double>(pose.stamp_ns - from);
  return 1e9;
}

std::string spec(const synthetic::SequenceOptions& o) {
  return "synth:" + o.scene + "?frames=" + std::to_string(o.frames) +
         "&path=" + std::to_string(o.path) + "&start=" + std::to_string(o.start_s) +
         "&black=" + std::to_string(o.black_from) + "-" + std::to_string(o.black_until) +
         "&jump=" + std::to_string(o.jump_at) + ":" + std::to_string(o.jump_s) +
         (o.sensor == Sensor::kMono ? "&sensor=mono" : "");
}

// Ten seconds along the far side of the hall.
const synthetic::SequenceOptions kFarSide{.scene = "hall", .frames = 300, .start_s = 30};

// Bob begins on the near side, where nobody else comes by. Then a hand is on his lens for two
// seconds, and when it goes he stands on the far side.
TEST(Relocalise, ALostClientIsFoundWhereOnlyAnotherOneHasBeen) {
  if (kSlowBuild) GTEST_SKIP() << "needs real time; run it in another build";
  Deployment deployment;
  const auto server = deployment.server();
  const std::string of_alice = deployment.file("alice.tum").string();
  const auto alice =
      deployment.client("alice", spec(kFarSide), {"--max-rate", "--trajectory", of_alice});
  ASSERT_EQ(alice->wait(seconds(120)), 0) << alice->err();

  const int dark = 60, light = 120;
  const synthetic::SequenceOptions way{.scene = "hall",
                                       .path = 1,
                                       .frames = 240,
                                       .black_from = dark,
                                       .black_until = light,
                                       .jump_at = light,
                                       .jump_s = 18.5};
  const std::string of_bob = deployment.file("bob.tum").string();
  const auto bob = deployment.client("bob", spec(way), {"--trajectory", of_bob});
  ASSERT_EQ(bob->wait(seconds(120)), 0) << bob->err();
  EXPECT_NE(bob->err().find("found by the server"), std::string::npos) << bob->err();
  // Nobody knows how where he began lies to the rest: that has a file, and a frame, of its own.
  EXPECT_EQ(bob->reported("parts"), 2);
  const std::string of_bob_here = deployment.file("bob.part2.tum").string();
  EXPECT_LT(lost_for(way, light, of_bob_here), 1.0);
  Joint joint;
  joint.add(kFarSide, of_alice);
  joint.add(way, of_bob_here, light);
  EXPECT_GT(joint.estimate.size(), 310u);
  EXPECT_LT(joint.ate(), 0.02);
}

// What alice has mapped is in a file, and she is gone.
TEST(Relocalise, WhoComesLaterIsInTheFrameOfTheMapThatWasLoaded) {
  if (kSlowBuild) GTEST_SKIP() << "too long under sanitizers; run it in another build";
  Deployment deployment;
  const std::string map = deployment.file("map.db").string();
  auto server = deployment.server({"--map", map});
  const std::string of_alice = deployment.file("alice.tum").string();
  const auto alice =
      deployment.client("alice", spec(kFarSide), {"--max-rate", "--trajectory", of_alice});
  ASSERT_EQ(alice->wait(seconds(120)), 0) << alice->err();
  server->signal(SIGTERM);
  ASSERT_EQ(server->wait(seconds(30)), 0) << server->err();

  server = deployment.server({"--map", map});
  Joint joint;
  joint.add(kFarSide, of_alice);  // written before the others came: alice's frame
  synthetic::SequenceOptions way{.scene = "hall", .path = 1, .frames = 150, .start_s = 21};
  const std::string of_bob = deployment.file("bob.tum").string();
  const auto bob = deployment.client("bob", spec(way), {"--max-rate", "--trajectory", of_bob});
  ASSERT_EQ(bob->wait(seconds(120)), 0) << bob->err();
  EXPECT_EQ(bob->reported("tracked"), 150);
  joint.add(way, of_bob);

  // A single camera has no scale of its own: it begins with being found.
  way.sensor = Sensor::kMono;
  const std::string of_carol = deployment.file("carol.tum").string();
  const auto carol =
      deployment.client("carol", spec(way), {"--max-rate", "--trajectory", of_carol});
  ASSERT_EQ(carol->wait(seconds(120)), 0) << carol->err();
  EXPECT_NE(carol->err().find("found by the server"), std::string::npos) << carol->err();
  EXPECT_GT(carol->reported("tracked"), 130);
  joint.add(way, of_carol);
  EXPECT_LT(joint.ate(), 0.02);
}

// It comes to where nobody has been, goes on there, and walks to where it had begun.
TEST(Relocalise, WhoIsFoundNowhereStartsAnewAndTheMapJoinsUp) {
  if (kSlowBuild) GTEST_SKIP() << "too long under sanitizers; run it in another build";
  Deployment deployment;
  const auto server = deployment.server();
  const int dark = 90, light = 120;
  const synthetic::SequenceOptions way{.scene = "hall",
                                       .frames = 560,
                                       .start_s = 20,
                                       .black_from = dark,
                                       .black_until = light,
                                       .jump_at = light,
                                       .jump_s = -15};
  const std::string file = deployment.file("out.tum").string();
  const auto walker = deployment.client("walker", spec(way), {"--max-rate", "--trajectory", file});
  ASSERT_EQ(walker->wait(seconds(240)), 0) << walker->err();
  EXPECT_NE(walker->err().find("starting a new part"), std::string::npos) << walker->err();
  EXPECT_NE(server->err().find("parts merged"), std::string::npos) << server->err();
  const double lost = lost_for(way, light, file);
  EXPECT_GT(lost, 1.0);
  EXPECT_LT(lost, 2.0);
  Joint joint;
  joint.add(way, file);
  EXPECT_GT(joint.estimate.size(), 460u);
  EXPECT_LT(joint.ate(), 0.03);
}

}  // namespace
}  // namespace cairn::testing
