#include "client/frontend/extractor.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "client/frontend/orient.h"
#include "common/feature/hamming.h"
#include "common/feature/matching.h"
#include "tests/unit/client/frontend/images.h"

namespace cairn {
namespace {

Features extract(const cv::Mat& image, const ExtractorOptions& options = {}) {
  Features features;
  Extractor(options).extract(image, features);
  return features;
}

bool same(const Features& a, const Features& b) {
  return a.descriptors == b.descriptors &&
         std::equal(a.points.begin(), a.points.end(), b.points.begin(), b.points.end(),
                    [](const Feature& p, const Feature& q) {
                      return p.x == q.x && p.y == q.y && p.angle == q.angle && p.octave == q.octave;
                    });
}

TEST(Extractor, FindsAsManyFeaturesAsAskedForOnAllLevels) {
  const Features features = extract(test::textured_image({640, 480}, 1));
  EXPECT_LE(features.size(), 1000u);
  EXPECT_GT(features.size(), 900u);
  EXPECT_EQ(features.descriptors.size(), features.size());
  for (int level = 0; level < 8; ++level)
    EXPECT_GT(std::count_if(features.points.begin(), features.points.end(),
                            [&](const Feature& f) { return f.octave == level; }),
              20);
}

TEST(Extractor, SpreadsFeaturesOverTheImage) {
  const Features features = extract(test::textured_image({640, 480}, 1));
  int cells[4][4] = {};
  for (const Feature& f : features.points)
    ++cells[static_cast<int>(f.y) / 120][static_cast<int>(f.x) / 160];
  for (const auto& row : cells)
    for (const int count : row) EXPECT_GT(count, 20);
}

TEST(Extractor, GivesTheSameForTheSameImageInAnyInstance) {
  const cv::Mat image = test::textured_image({320, 240}, 2);
  Extractor extractor({});
  Features first, again;
  extractor.extract(image, first);
  extractor.extract(image, again);
  EXPECT_TRUE(same(first, again));
  EXPECT_TRUE(same(first, extract(image)));
}

TEST(Extractor, FollowsImagesOfAnotherSize) {
  Extractor extractor({});
  Features features;
  extractor.extract(test::textured_image({640, 480}, 3), features);
  const cv::Mat small = test::textured_image({320, 240}, 2);
  ExtractorOptions off{.entropy = {.mode = EntropyMode::kOff}};
  Extractor other(off);
  other.extract(test::textured_image({640, 480}, 3), features);
  other.extract(small, features);
  EXPECT_TRUE(same(features, extract(small, off)));
}

TEST(Extractor, CopesWithTinyFlatAndMissingImages) {
  EXPECT_EQ(extract(cv::Mat()).size(), 0u);
  EXPECT_EQ(extract(cv::Mat(480, 640, CV_16UC1, cv::Scalar(7))).size(), 0u);
  EXPECT_EQ(extract(cv::Mat(5, 7, CV_8UC1, cv::Scalar(7))).size(), 0u);
  EXPECT_EQ(extract(cv::Mat(33, 33, CV_8UC1, cv::Scalar(7))).size(), 0u);
  EXPECT_EQ(extract(cv::Mat(480, 640, CV_8UC1, cv::Scalar(7))).size(), 0u);
}

// FAST does not know up from down: an image turned by half a circle has its features at the
// mirrored places, unless positions of the levels are brought to full resolution with a bias.
TEST(Extractor, ReportsPositionsAtFullResolutionWithoutBias) {
  const cv::Mat image = test::textured_image({640, 480}, 8);
  cv::Mat turned;
  cv::rotate(image, turned, cv::ROTATE_180);
  const Features a = extract(image, {.entropy = {.mode = EntropyMode::kOff}});
  const Features b = extract(turned, {.entropy = {.mode = EntropyMode::kOff}});
  for (int level = 0; level < 8; ++level) {
    const double scale = ScalePyramid().scale(level);
    std::vector<double> dx, dy;
    for (const Feature& p : a.points)
      for (const Feature& q : b.points) {
        const double x = 639 - q.x - p.x, y = 479 - q.y - p.y;
        if (p.octave != level || q.octave != level || std::hypot(x, y) > 2 * scale) continue;
        dx.push_back(x);
        dy.push_back(y);
      }
    ASSERT_GT(dx.size(), 10u);
    const auto mean = [](const std::vector<double>& v) {
      return std::accumulate(v.begin(), v.end(), 0.0) / static_cast<double>(v.size());
    };
    EXPECT_NEAR(mean(dx), 0, 0.15 * scale) << "level " << level;
    EXPECT_NEAR(mean(dy), 0, 0.15 * scale) << "level " << level;
  }
}

// Textured on the left; on the right a faint checkerboard that shows corners only when sharpened.
cv::Mat half_faint_image() {
  cv::Mat image = test::noise_image({640, 480}, 5);
  for (int y = 0; y < 480; ++y)
    for (int x = 320; x < 640; ++x)
      image.at<uchar>(y, x) = static_cast<uchar>((x / 9 + y / 9) % 2 ? 120 : 126);
  return image;
}

long features_right_of(const Features& features, float x) {
  return std::count_if(features.points.begin(), features.points.end(),
                       [&](const Feature& f) { return f.x > x; });
}

TEST(Extractor, SharpensOnlyWhatLiesUnderTheThreshold) {
  const cv::Mat image = half_faint_image();
  Extractor online({.entropy = {.min_threshold = 0}, .best_first = false});
  Features sharpened;
  online.extract(image, sharpened);
  EXPECT_GT(online.stats().blocks_sharpened, online.stats().blocks / 3);
  EXPECT_LT(online.stats().blocks_sharpened, 2 * online.stats().blocks / 3);
  EXPECT_NEAR(online.stats().threshold, online.stats().image_entropy / 2 + 0.3, 1e-9);

  Extractor off({.entropy = {.mode = EntropyMode::kOff}});
  Features plain;
  off.extract(image, plain);
  EXPECT_EQ(off.stats().blocks_sharpened, 0);
  EXPECT_EQ(features_right_of(plain, 330), 0);  // 6 grey levels are below the low FAST threshold
  EXPECT_GT(features_right_of(sharpened, 330), 100);
}

TEST(Extractor, TakesCornersOfSharpenedBlocksOnlyAsFarAsOthersLeaveRoom) {
  const cv::Mat image = half_faint_image();
  const EntropyOptions off{.mode = EntropyMode::kOff};
  EXPECT_EQ(features_right_of(extract(image, {.features = 500}), 330), 0);
  const Features few = extract(image, {.features = 10000, .entropy = off});
  const Features filled = extract(image, {.features = 10000, .entropy = {.min_threshold = 0}});
  EXPECT_EQ(features_right_of(few, 330), 0);
  EXPECT_GT(features_right_of(filled, 330), 100);
  EXPECT_EQ(std::ssize(filled.points) - features_right_of(filled, 330), std::ssize(few.points));
}

TEST(Extractor, LeavesOutFaintCornersWhereStrongOnesSuffice) {
  // Noise, and on the right a slope with spots that stand out a little.
  cv::Mat image = test::noise_image({640, 480}, 5);
  for (int y = 0; y < 480; ++y)
    for (int x = 440; x < 640; ++x)
      image.at<uchar>(y, x) =
          static_cast<uchar>(x - 420 + (x % 20 / 4 == 2 && y % 20 / 4 == 2 ? 8 : 0));
  const auto on_slope = [](const Features& features) {
    return std::count_if(features.points.begin(), features.points.end(),
                         [](const Feature& f) { return f.octave == 0 && f.x > 450; });
  };
  EXPECT_GT(on_slope(extract(image, {.best_first = false})), 20);
  EXPECT_EQ(on_slope(extract(image)), 0);
  EXPECT_GT(on_slope(extract(image, {.features = 200000})), 50);  // room for all
}

TEST(Extractor, DescribesThePixelsAsTheyWereTaken) {
  const cv::Mat noise = test::noise_image({640, 480}, 6);
  cv::Mat image = half_faint_image();
  for (int y = 0; y < 480; ++y)
    for (int x = 320; x < 640; ++x) image.at<uchar>(y, x) += noise.at<uchar>(y, x) / 128;
  const ExtractorOptions taken{.features = 10000};
  ExtractorOptions sharpened = taken;
  sharpened.describe_sharpened = true;
  const Features a = extract(image, taken), b = extract(image, sharpened);
  ASSERT_EQ(a.size(), b.size());
  int differ = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a.points[i].x, b.points[i].x);
    const bool same_descriptor = a.descriptors[i] == b.descriptors[i];
    EXPECT_TRUE(same_descriptor || a.points[i].x > 250);
    differ += a.points[i].x > 330 && !same_descriptor;
  }
  EXPECT_GT(differ, 50);
}

TEST(Extractor, FollowsThePaperWhenAsked) {
  cv::Mat faint(480, 640, CV_8UC1);
  for (int y = 0; y < 480; ++y)
    for (int x = 0; x < 640; ++x)
      faint.at<uchar>(y, x) = static_cast<uchar>((x / 40 + y / 40) % 2 ? 120 : 123);
  EXPECT_EQ(extract(faint, as_in_paper({})).size(), 0u);
  // Sharpened corners compete with the rest.
  EXPECT_GT(features_right_of(extract(half_faint_image(), as_in_paper({})), 330), 100);
}

// A faint checkerboard all over: its entropy is that of the scene, so eq. 12 alone sharpens
// nothing.
TEST(Extractor, FindsFeaturesInAnEvenlyFlatImageWherePlainOrbFindsNone) {
  cv::Mat image(480, 640, CV_8UC1);
  for (int y = 0; y < 480; ++y)
    for (int x = 0; x < 640; ++x)
      image.at<uchar>(y, x) = static_cast<uchar>((x / 40 + y / 40) % 2 ? 120 : 123);
  EXPECT_EQ(extract(image, {.entropy = {.mode = EntropyMode::kOff}}).size(), 0u);
  EXPECT_GT(extract(image).size(), 200u);
  EXPECT_EQ(extract(image, {.entropy = {.min_threshold = 0}}).size(), 0u);
}

// A flat wall in a scene that has texture elsewhere: more sharpening would only let weak corners
// displace good ones.
TEST(Extractor, LeavesLevelsWithEnoughCornersToEquation12) {
  cv::Mat image(480, 640, CV_8UC1, cv::Scalar(100));
  test::noise_image({400, 480}, 4).copyTo(image(cv::Rect(0, 0, 400, 480)));
  EXPECT_TRUE(same(extract(image), extract(image, {.entropy = {.min_threshold = 0}})));
}

// A slope of so many shades that nothing is sharpened, with spots of five grey levels.
TEST(Extractor, TakesFainterCornersOnLevelsThatLackThem) {
  cv::Mat image(480, 640, CV_8UC1);
  for (int y = 0; y < 480; ++y)
    for (int x = 0; x < 640; ++x)
      image.at<uchar>(y, x) =
          static_cast<uchar>(x / 4 + y / 8 + (x % 40 < 4 && y % 40 < 4 ? 5 : 0));
  Extractor extractor({});
  Features features;
  extractor.extract(image, features);
  EXPECT_EQ(extract(image, {.entropy = {.min_threshold = 0}}).size(), 0u);
  EXPECT_GT(features.size(), 100u);
  EXPECT_EQ(extractor.stats().blocks_sharpened, 0);
}

// Tiles of four shades of grey, 2 bits a block, which is more than E0, and next to no corners for
// FAST; at the left something that every level finds corners in.
cv::Mat tiled_image() {
  std::mt19937 random(3);
  cv::Mat tiles(24, 32, CV_8UC1), image;
  for (uchar& tile : cv::Mat_<uchar>(tiles)) tile = static_cast<uchar>(100 + random() % 4);
  cv::resize(tiles, image, {640, 480}, 0, 0, cv::INTER_NEAREST);
  test::noise_image({48, 480}, 4).copyTo(image(cv::Rect(0, 0, 48, 480)));
  return image;
}

TEST(Extractor, SharpensMoreOfLevelsThatLackCorners) {
  const cv::Mat image = tiled_image();
  const Features equation_12 = extract(image, {.entropy = {.min_threshold = 0}});
  const Features filled = extract(image);
  EXPECT_EQ(features_right_of(equation_12, 60), 0);
  EXPECT_GT(features_right_of(filled, 60), 150);
  // Not in place of others.
  EXPECT_GE(std::ssize(filled.points) - features_right_of(filled, 60),
            std::ssize(equation_12.points));
  const ExtractorOptions fixed{.entropy = {.mode = EntropyMode::kFixed, .fixed_threshold = 1}};
  EXPECT_EQ(features_right_of(extract(image, fixed), 60), 0);
}

// The same tiles with bright spots here and there, which the first search finds.
TEST(Extractor, FillsUpWithoutTouchingWhatItHasFound) {
  cv::Mat image = tiled_image();
  for (int y = 36; y < 450; y += 47)
    for (int x = 70; x < 600; x += 47) image(cv::Rect(x, y, 4, 4)) = 130 + x % 7;
  const auto options = [](int features, double min_threshold) {
    return ExtractorOptions{.features = features,
                            .pyramid = {.levels = 1},
                            .entropy = {.min_threshold = min_threshold}};
  };
  const Features first = extract(image, options(10000, 0));
  const int wanted = static_cast<int>(first.size()) + 60;  // fewer than there is to be found
  const Features filled = extract(image, options(wanted, 3));
  ASSERT_GT(features_right_of(first, 60), 80);
  ASSERT_EQ(std::ssize(filled.points), wanted);
  EXPECT_GT(extract(image, options(10000, 3)).size(), first.size() + 120);
  for (std::size_t i = 0; i < first.size(); ++i) {
    EXPECT_EQ(filled.points[i].pixel(), first.points[i].pixel());
    EXPECT_EQ(filled.descriptors[i], first.descriptors[i]);
    for (std::size_t j = first.size(); j < filled.size(); ++j)
      EXPECT_GE((filled.points[j].pixel() - first.points[i].pixel()).lpNorm<Eigen::Infinity>(), 3)
          << "found twice";
  }
}

TEST(Orientation, PointsToTheBrighterSide) {
  for (const double turn : {0.0, 0.7, 2.0, 3.5, 5.9}) {
    cv::Mat image(64, 64, CV_8UC1);
    for (int y = 0; y < 64; ++y)
      for (int x = 0; x < 64; ++x)
        image.at<uchar>(y, x) = cv::saturate_cast<uchar>(
            128 + 3 * ((x - 32) * std::cos(turn) + (y - 32) * std::sin(turn)));
    EXPECT_NEAR(orientation(image, 32, 32), turn, 0.02);
  }
}

// Descriptors of corners found in an image and in the image turned must match at the turned places.
TEST(Extractor, DescribesAlikeWhateverTheRotation) {
  const cv::Mat image = test::textured_image({480, 480}, 6, 300);
  const Features original = extract(image);
  for (const double degrees : {15.0, 45.0, 90.0, 200.0}) {
    const cv::Mat turn = cv::getRotationMatrix2D({239.5f, 239.5f}, degrees, 1.0);
    cv::Mat turned;
    cv::warpAffine(image, turned, turn, image.size(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
    const Features features = extract(turned);
    const auto matches = match_mutual(original.descriptors, features.descriptors, 60, 0.9f);
    int correct = 0;
    for (const FeatureMatch& m : matches) {
      const Feature &a = original.points[m.a], &b = features.points[m.b];
      const cv::Mat expected = turn * (cv::Mat_<double>(3, 1) << a.x, a.y, 1);
      correct += std::hypot(expected.at<double>(0) - b.x, expected.at<double>(1) - b.y) < 6;
    }
    EXPECT_GT(matches.size(), 150u) << degrees;
    EXPECT_GT(correct, 0.9 * static_cast<double>(matches.size())) << degrees;
  }
}

TEST(BriefPattern, StaysInItsCircleAndHasNoTestTwice) {
  for (std::size_t i = 0; i < kBriefTests; ++i) {
    const BriefTest& t = kBriefPattern[i];
    EXPECT_LE(t.ax * t.ax + t.ay * t.ay, kBriefRadius * kBriefRadius);
    EXPECT_LE(t.bx * t.bx + t.by * t.by, kBriefRadius * kBriefRadius);
    for (std::size_t j = 0; j < i; ++j) {
      const BriefTest& o = kBriefPattern[j];
      EXPECT_FALSE(t.ax == o.ax && t.ay == o.ay && t.bx == o.bx && t.by == o.by);
      EXPECT_FALSE(t.ax == o.bx && t.ay == o.by && t.bx == o.ax && t.by == o.ay);
    }
  }
}

}  // namespace
}  // namespace cairn
