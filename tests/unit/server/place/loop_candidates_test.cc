#include "server/place/loop_candidates.h"

#include <algorithm>
#include <utility>

#include <gmock/gmock.h>

namespace cairn {
namespace {

using testing::IsEmpty;

KeyframeId kf(std::uint32_t sequence, std::uint64_t epoch = 7) {
  return {epoch, sequence};
}

// Keyframes in a row, each sharing 100, 50 and 20 landmarks with the next three, and looking like
// place[k]. What is asked for is just what place recognition reads of a map.
class LoopCandidatesTest : public testing::Test {
 protected:
  void add_row(const std::vector<int>& places, std::uint64_t epoch = 7) {
    const auto size = static_cast<std::uint32_t>(places.size());
    for (std::uint32_t k = 0; k < size; ++k) {
      KeyframeNode node;
      for (std::uint32_t step = 1; step <= 3; ++step) {
        const int shared = step == 1 ? 100 : step == 2 ? 50 : 20;
        if (k >= step) node.covisible.edit().push_back({kf(k - step, epoch), shared});
        if (k + step < size) node.covisible.edit().push_back({kf(k + step, epoch), shared});
      }
      if (k > 0) node.parent = kf(k - 1, epoch);
      if (k + 1 < size) node.children = {kf(k + 1, epoch)};
      map_.keyframes.insert(kf(k, epoch), node);
      index_.add(kf(k, epoch), look_of(places[k]));
    }
  }

  // Two places have as many words in common as they are close: 10 words each, shifted by 1.
  static Words look_of(int place) {
    Words words;
    for (int i = 0; i < 10; ++i) words.bag.push_back({static_cast<std::uint32_t>(place + i), 0.1f});
    return words;
  }

  static std::vector<KeyframeId> ids(const std::vector<LoopCandidate>& candidates) {
    std::vector<KeyframeId> result;
    for (const LoopCandidate& c : candidates) result.push_back(c.keyframe);
    return result;
  }

  // A walk of 30 places that comes back to the first ones.
  static std::vector<int> round_walk() {
    std::vector<int> places;
    for (int k = 0; k < 30; ++k) places.push_back(3 * k);
    for (int k = 0; k < 5; ++k) places.push_back(3 * k);
    return places;
  }

  Map map_;
  PlaceIndex index_;
};

TEST_F(LoopCandidatesTest, FindsTheKeyframeOfAnEarlierVisit) {
  add_row(round_walk());
  LoopCandidates loops;
  const auto found = loops.find(map_, index_, kf(32));
  ASSERT_FALSE(found.empty());
  EXPECT_EQ(found[0].keyframe, kf(2));
  EXPECT_NEAR(found[0].score, 1.0, 1e-5);
  EXPECT_GT(found[0].group_score, found[0].score);
  EXPECT_FALSE(found[0].other_island);
}

TEST_F(LoopCandidatesTest, NeverNamesWhatIsNearByAnyway) {
  add_row(std::vector<int>(9, 0));  // one who stands still: all look the same
  LoopCandidates loops;
  for (std::uint32_t k = 0; k < 9; ++k)
    for (const KeyframeId id : ids(loops.find(map_, index_, kf(k))))
      EXPECT_GT(std::max(id.sequence, k) - std::min(id.sequence, k), 6u);  // two steps of 3
}

TEST_F(LoopCandidatesTest, TakesNothingLessAlikeThanItsNeighbours) {
  std::vector<int> places = round_walk();
  add_row(places);
  // Neighbours look 70 %, 70 %, 40 %, 40 % and 10 % alike; a stranger of 1 word in common is below
  // 0.8 of the least, one with 2 above half of the bar of 0.4.
  CandidateOptions strict{.bar_share = 1.0, .bar_neighbours = 3};
  index_.add(kf(3), look_of(1000));
  map_.keyframes.edit(kf(3))->covisible.edit().clear();
  Words half = look_of(3 * 20);
  for (auto& w : half.bag)
    if (w.word % 10 < 7) w.word += 5000;
  std::sort(half.bag.begin(), half.bag.end(),
            [](const WordWeight& a, const WordWeight& b) { return a.word < b.word; });
  index_.add(kf(3), half);
  EXPECT_THAT(LoopCandidates(strict).find(map_, index_, kf(20)), IsEmpty());
  strict.bar_share = 0.1;
  EXPECT_THAT(ids(LoopCandidates(strict).find(map_, index_, kf(20))), testing::Contains(kf(3)));
}

TEST_F(LoopCandidatesTest, PrefersPlacesWhoseNeighboursMatchToo) {
  add_row(round_walk());
  // A single keyframe elsewhere that looks just as alike, with neighbours that don't.
  map_.keyframes.insert(kf(0, 9), {});
  index_.add(kf(0, 9), look_of(6));
  const auto found = LoopCandidates().find(map_, index_, kf(32));
  ASSERT_FALSE(found.empty());
  EXPECT_EQ(found[0].keyframe, kf(2));
  EXPECT_THAT(ids(found), testing::Not(testing::Contains(kf(0, 9))));
}

TEST_F(LoopCandidatesTest, TellsWhenNothingConnectsThem) {
  add_row({0, 3, 6, 9, 12});
  add_row({100, 103, 6, 9, 12}, 9);
  const auto found = LoopCandidates().find(map_, index_, kf(3, 9));
  ASSERT_FALSE(found.empty());
  EXPECT_EQ(found[0].keyframe, kf(3));
  EXPECT_TRUE(found[0].other_island);
}

TEST_F(LoopCandidatesTest, WithConsistencyWaitsForQueriesInARow) {
  add_row(round_walk());
  LoopCandidates loops({.consistency = 2});
  EXPECT_THAT(loops.find(map_, index_, kf(30)), IsEmpty());
  EXPECT_THAT(loops.find(map_, index_, kf(31)), IsEmpty());
  EXPECT_EQ(ids(loops.find(map_, index_, kf(32))), std::vector{kf(2)});
}

TEST_F(LoopCandidatesTest, AQueryWithoutCandidatesBreaksTheRow) {
  add_row(round_walk());
  LoopCandidates loops({.consistency = 1});
  EXPECT_THAT(loops.find(map_, index_, kf(30)), IsEmpty());
  EXPECT_THAT(loops.find(map_, index_, kf(15)), IsEmpty());
  EXPECT_THAT(loops.find(map_, index_, kf(31)), IsEmpty());
  EXPECT_EQ(ids(loops.find(map_, index_, kf(32))), std::vector{kf(2)});
}

TEST_F(LoopCandidatesTest, CandidatesFromElsewhereAreNotConsistent) {
  add_row(round_walk());
  LoopCandidates loops({.consistency = 1});
  // The first looks like a place far from that of the second.
  index_.add(kf(30), look_of(3 * 15));
  EXPECT_THAT(loops.find(map_, index_, kf(30)), IsEmpty());
  EXPECT_THAT(loops.find(map_, index_, kf(31)), IsEmpty());
  EXPECT_FALSE(loops.find(map_, index_, kf(32)).empty());
}

TEST_F(LoopCandidatesTest, PassesOverWhatTheMapNoLongerHas) {
  add_row(round_walk());
  for (std::uint32_t k = 0; k < 5; ++k) index_.add(kf(k, 5), look_of(3 * static_cast<int>(k)));
  for (const KeyframeId id : ids(LoopCandidates().find(map_, index_, kf(32))))
    EXPECT_TRUE(map_.keyframes.contains(id));
  EXPECT_THAT(LoopCandidates().find(map_, index_, kf(2, 5)), IsEmpty());  // not in the map
  index_.remove(kf(32));
  EXPECT_THAT(LoopCandidates().find(map_, index_, kf(32)), IsEmpty());  // not in the index
}

TEST_F(LoopCandidatesTest, GivesNoMoreThanAskedFor) {
  for (std::uint64_t epoch = 20; epoch < 30; ++epoch) add_row({0, 3, 6}, epoch);
  add_row({0, 3, 6});
  EXPECT_EQ(LoopCandidates({.most = 4}).find(map_, index_, kf(1)).size(), 4u);
}

}  // namespace
}  // namespace cairn
