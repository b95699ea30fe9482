#include "client/frontend/quadtree.h"

#include <algorithm>
#include <random>
#include <set>

#include <gtest/gtest.h>

namespace cairn {
namespace {

const cv::Rect kArea(16, 16, 600, 400);

std::int16_t small(int value) {
  return static_cast<std::int16_t>(value);
}

std::vector<Corner> clustered_corners(int seed) {
  std::mt19937 rng(static_cast<std::uint32_t>(seed));
  std::set<std::pair<int, int>> taken;
  std::vector<Corner> corners;
  const auto add = [&](int x, int y, int score) {
    if (taken.insert({x, y}).second) corners.push_back({small(x), small(y), small(score)});
  };
  // Nine tenths, and the strongest, in one corner of the image.
  for (int i = 0; i < 4500; ++i)
    add(16 + static_cast<int>(rng() % 100), 16 + static_cast<int>(rng() % 100), 150);
  for (int i = 0; i < 500; ++i)
    add(16 + static_cast<int>(rng() % 600), 16 + static_cast<int>(rng() % 400), 10);
  return corners;
}

std::vector<Corner> choose(const std::vector<Corner>& corners, int wanted) {
  Quadtree tree;
  std::vector<Corner> chosen;
  tree.choose(corners, kArea, wanted, chosen);
  return chosen;
}

TEST(Quadtree, SpreadsTheChoiceOverTheImage) {
  const auto chosen = choose(clustered_corners(1), 300);
  EXPECT_GT(chosen.size(), 290u);
  EXPECT_LE(chosen.size(), 300u);
  const auto outside = std::count_if(chosen.begin(), chosen.end(),
                                     [](const Corner& c) { return c.x > 116 || c.y > 116; });
  EXPECT_GT(outside, 150);  // by strength alone there would be none
}

TEST(Quadtree, KeepsTheStrongestOfACell) {
  const std::vector<Corner> corners = {
      {100, 100, 10}, {101, 100, 30}, {102, 100, 20}, {500, 300, 5}};
  const auto chosen = choose(corners, 2);
  ASSERT_EQ(chosen.size(), 2u);
  EXPECT_EQ(chosen[0].score + chosen[1].score, 35);
}

TEST(Quadtree, KeepsAllWhenThereAreFewer) {
  const auto corners = clustered_corners(2);
  EXPECT_EQ(choose(corners, 100000).size(), corners.size());
}

TEST(Quadtree, GivesNothingForNothing) {
  EXPECT_TRUE(choose({}, 10).empty());
  EXPECT_TRUE(choose(clustered_corners(1), 0).empty());
}

TEST(Quadtree, EndsWhenCornersShareAPixel) {
  const std::vector<Corner> corners(5, Corner{50, 50, 9});
  EXPECT_EQ(choose(corners, 4).size(), 1u);
}

TEST(Quadtree, DoesNotDependOnTheOrderOfTheCorners) {
  auto corners = clustered_corners(3);
  const auto as_set = [](const std::vector<Corner>& chosen) {
    std::set<std::pair<int, int>> points;
    for (const Corner& c : chosen) points.insert({c.x, c.y});
    return points;
  };
  const auto before = as_set(choose(corners, 200));
  std::shuffle(corners.begin(), corners.end(), std::mt19937(4));
  EXPECT_EQ(as_set(choose(corners, 200)), before);
}

}  // namespace
}  // namespace cairn
