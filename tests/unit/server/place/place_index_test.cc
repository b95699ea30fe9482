#include "server/place/place_index.h"

#include <atomic>
#include <random>
#include <thread>

#include <gtest/gtest.h>

namespace cairn {
namespace {

KeyframeId kf(std::uint32_t sequence) {
  return {7, sequence};
}

Words words_with(BagOfWords bag) {
  return {std::move(bag), {}, {}};
}

BagOfWords random_bag(std::mt19937_64& random) {
  BagOfWords bag;
  for (std::uint32_t word = 0; word < 40; ++word)
    if (random() % 4 == 0) bag.push_back({word, static_cast<float>(1 + random() % 5)});
  float sum = 0;
  for (const auto& w : bag) sum += w.weight;
  for (auto& w : bag) w.weight /= sum;
  return bag;
}

TEST(PlaceIndex, FindsTheMostSimilarFirst) {
  PlaceIndex index;
  index.add(kf(1), words_with({{1, 0.5f}, {2, 0.5f}}));
  index.add(kf(2), words_with({{2, 0.75f}, {3, 0.25f}}));
  index.add(kf(3), words_with({{4, 1.0f}}));
  const auto matches = index.query({{2, 0.75f}, {3, 0.25f}});
  EXPECT_EQ(matches, (std::vector<PlaceMatch>{{kf(2), 1.0}, {kf(1), 0.5}}));
}

TEST(PlaceIndex, ScoresAsSimilarityDoes) {
  std::mt19937_64 random(1);
  PlaceIndex index;
  std::vector<BagOfWords> bags;
  for (std::uint32_t i = 0; i < 30; ++i) {
    bags.push_back(random_bag(random));
    index.add(kf(i), words_with(bags.back()));
  }
  const BagOfWords query = random_bag(random);
  const auto matches = index.query(query);
  EXPECT_GT(matches.size(), 20u);
  for (const PlaceMatch& match : matches)
    EXPECT_NEAR(match.score, similarity(query, bags[match.keyframe.sequence]), 1e-6);
}

TEST(PlaceIndex, LeavesOutWhatIsTurnedDownOrTooUnlike) {
  PlaceIndex index;
  index.add(kf(1), words_with({{1, 1.0f}}));
  index.add(kf(2), words_with({{1, 1.0f}}));
  index.add(kf(3), words_with({{1, 0.25f}, {2, 0.75f}}));
  const auto matches = index.query({{1, 1.0f}}, 0.3, [](KeyframeId id) { return id != kf(1); });
  EXPECT_EQ(matches, (std::vector<PlaceMatch>{{kf(2), 1.0}}));
}

TEST(PlaceIndex, OfEqualsTheLesserIdComesFirst) {
  PlaceIndex index;
  for (const std::uint32_t i : {5u, 2u, 9u}) index.add(kf(i), words_with({{3, 1.0f}}));
  const auto matches = index.query({{3, 1.0f}});
  ASSERT_EQ(matches.size(), 3u);
  EXPECT_EQ(matches[0].keyframe, kf(2));
  EXPECT_EQ(matches[2].keyframe, kf(9));
}

TEST(PlaceIndex, ForgetsWhatIsRemoved) {
  PlaceIndex index;
  index.add(kf(1), words_with({{1, 1.0f}}));
  index.add(kf(2), words_with({{1, 0.5f}, {2, 0.5f}}));
  const auto kept = index.words_of(kf(1));
  EXPECT_TRUE(index.remove(kf(1)));
  EXPECT_FALSE(index.remove(kf(1)));
  EXPECT_EQ(index.size(), 1u);
  EXPECT_EQ(index.words_of(kf(1)), nullptr);
  EXPECT_EQ(kept->bag.size(), 1u);  // whoever has it may go on
  EXPECT_EQ(index.query({{1, 1.0f}}), (std::vector<PlaceMatch>{{kf(2), 0.5}}));
}

TEST(PlaceIndex, AddingAgainReplaces) {
  PlaceIndex index;
  index.add(kf(1), words_with({{1, 1.0f}}));
  index.add(kf(1), words_with({{2, 1.0f}}));
  EXPECT_EQ(index.size(), 1u);
  EXPECT_TRUE(index.query({{1, 1.0f}}).empty());
  EXPECT_EQ(index.query({{2, 1.0f}}).size(), 1u);
}

TEST(PlaceIndex, AfterManyChangesAnswersAsAFreshOne) {
  std::mt19937_64 random(2);
  PlaceIndex changed, fresh;
  std::vector<BagOfWords> bags(50);
  for (int round = 0; round < 400; ++round) {
    const auto i = static_cast<std::uint32_t>(random() % 50);
    if (random() % 3 == 0) {
      changed.remove(kf(i));
      bags[i].clear();
    } else {
      bags[i] = random_bag(random);
      changed.add(kf(i), words_with(bags[i]));
    }
  }
  for (std::uint32_t i = 0; i < 50; ++i)
    if (!bags[i].empty()) fresh.add(kf(i), words_with(bags[i]));
  const BagOfWords query = random_bag(random);
  EXPECT_EQ(changed.query(query), fresh.query(query));
  EXPECT_EQ(changed.size(), fresh.size());
}

TEST(PlaceIndex, IsReadWhileItIsWritten) {
  PlaceIndex index;
  index.add(kf(0), words_with({{1, 1.0f}}));
  std::atomic<int> queries = 0;
  std::jthread reader([&](std::stop_token stop) {
    for (; !stop.stop_requested(); ++queries) EXPECT_GE(index.query({{1, 1.0f}}).size(), 1u);
  });
  while (queries == 0) std::this_thread::yield();
  for (std::uint32_t i = 2; i < 300; ++i) {
    index.add(kf(i), words_with({{1, 0.5f}, {i, 0.5f}}));
    if (i % 2 == 0) index.remove(kf(i - 1));
  }
}

}  // namespace
}  // namespace cairn
