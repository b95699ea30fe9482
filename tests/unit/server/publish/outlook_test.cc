#include "server/publish/outlook.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

using Eigen::Vector3d;

KeyframeNode node(const Rigid3& pose, double seconds) {
  auto rig = std::make_shared<Rig>();
  rig->camera = {500, 500, 320, 240, 640, 480, 0.08};
  auto keyframe = std::make_shared<Keyframe>();
  keyframe->rig = rig;
  keyframe->stamp_ns = static_cast<std::int64_t>(1e9 * seconds);
  KeyframeNode n;
  n.keyframe = keyframe;
  n.map_from_camera = pose;
  return n;
}

TEST(Outlook, ShowsWhatIsInFrontOrJustBeside) {
  const Outlook outlook(node({}, 0), nullptr);
  EXPECT_TRUE(outlook.shows({0, 0, 2}));
  EXPECT_TRUE(outlook.shows({1.5, 0, 2}));  // 55 px beyond the edge
  EXPECT_FALSE(outlook.shows({4, 0, 2}));
  EXPECT_FALSE(outlook.shows({0, 0, -2}));
}

TEST(Outlook, LooksAheadInTheDirectionOfTheMotion) {
  // Half a radian a second to the right.
  const KeyframeNode before = node({}, 0);
  const KeyframeNode latest = node({so3_exp({0, 0.25, 0}), {0, 0, 0}}, 0.5);
  const Outlook outlook(latest, &before);
  const Outlook standing(latest, nullptr);
  const Vector3d right(2 * std::sin(1.4), 0, 2 * std::cos(1.4));
  const Vector3d left(2 * std::sin(-0.7), 0, 2 * std::cos(-0.7));
  EXPECT_TRUE(outlook.shows(right));
  EXPECT_FALSE(standing.shows(right));
  EXPECT_FALSE(outlook.shows(left));
}

TEST(Outlook, StampsThatDoNotAscendMeanNoMotion) {
  const KeyframeNode before = node({so3_exp({0, 1, 0}), {0, 0, 0}}, 1);
  const Outlook outlook(node({}, 1), &before);
  EXPECT_TRUE(outlook.shows({0, 0, 2}));
}

TEST(Outlook, AShiftAcrossTheViewCountsMoreThanOneAlongIt) {
  const Outlook outlook(node({Eigen::Quaterniond::Identity(), {1, 0, 0}}, 0), nullptr);
  // 1 cm at 2 m and 500 pixels a radian.
  EXPECT_NEAR(outlook.shift_px({1, 0, 2}, {1.01, 0, 2}), 2.5, 0.03);
  EXPECT_NEAR(outlook.shift_px({1, 0, 2}, {1, 0, 2.01}), 0.25, 0.003);
  EXPECT_EQ(outlook.shift_px({1, 0, 2}, {1, 0, 2}), 0);
  EXPECT_EQ(outlook.shift_px({1, 0, 2}, {1, 0, 0}), 0) << "on the spot";
}

}  // namespace
}  // namespace cairn
