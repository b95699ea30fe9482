// Every set of kernels gives the same to the last bit, and what it gives is what it should.
#include "client/frontend/kernels.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "client/frontend/extractor.h"
#include "tests/unit/client/frontend/images.h"

namespace cairn {
namespace {

std::vector<const Kernels*> all_kernels() {
  std::vector<const Kernels*> all = {&baseline_kernels()};
  if (avx2_kernels()) all.push_back(avx2_kernels());
  return all;
}

bool equal(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && cv::norm(a, b, cv::NORM_INF) == 0;
}

TEST(Kernels, TheBestAreThoseForAvx2WhereTheProcessorHasIt) {
#if defined(__x86_64__)
  EXPECT_EQ(avx2_kernels() != nullptr, static_cast<bool>(__builtin_cpu_supports("avx2")));
#endif
  EXPECT_EQ(&best_kernels(), all_kernels().back());
}

TEST(Kernels, GiveTheSameFeaturesWithEveryInstructionSet) {
  for (const cv::Size size : {cv::Size(640, 480), cv::Size(751, 479), cv::Size(97, 83)}) {
    for (const int shapes : {900, 30}) {  // rich; and with areas for the low threshold
      cv::Mat image = test::textured_image(size, 11, shapes);
      image += test::noise_image(size, 12, 0, 9);
      Features reference;
      Extractor({}, baseline_kernels()).extract(image, reference);
      EXPECT_GT(reference.size(), 10u);
      for (const Kernels* kernels : all_kernels()) {
        Features features;
        Extractor({}, *kernels).extract(image, features);
        EXPECT_EQ(features.descriptors, reference.descriptors) << kernels->name;
        ASSERT_EQ(features.size(), reference.size()) << kernels->name;
        for (std::size_t i = 0; i < features.size(); ++i) {
          const Feature &a = features.points[i], &b = reference.points[i];
          EXPECT_TRUE(a.x == b.x && a.y == b.y && a.angle == b.angle && a.octave == b.octave);
        }
      }
    }
  }
}

// Widths below a vector, between, and beyond: nothing outside the row is written.
TEST(Kernels, ScoreRowsOfAnyWidthAlike) {
  const cv::Mat image = test::noise_image({120, 7}, 3);
  constexpr int kX[16] = {0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1};
  constexpr int kY[16] = {-3, -3, -2, -1, 0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3};
  std::ptrdiff_t circle[16];
  for (int i = 0; i < 16; ++i) circle[i] = kY[i] * static_cast<std::ptrdiff_t>(image.step) + kX[i];
  const std::uint8_t* row = image.ptr<std::uint8_t>(3) + 3;
  for (const Kernels* kernels : all_kernels())
    for (const int width : {1, 15, 16, 17, 31, 32, 33, 63, 100}) {
      std::vector<std::uint8_t> scores(128, 0);
      kernels->fast_scores(row, width, circle, 20, &scores[1]);
      for (int x = 0; x < width; ++x) {
        const int score = fast_score(image, x + 3, 3);
        EXPECT_EQ(scores[static_cast<std::size_t>(x + 1)], score > 20 ? score : 0);
      }
      EXPECT_EQ(scores[0], 0);
      EXPECT_EQ(std::count(scores.begin() + width + 1, scores.end(), 0), 127 - width);
    }
}

TEST(Kernels, FindPeaksOfWhichEqualNeighboursCountOnce) {
  for (const Kernels* kernels : all_kernels()) {
    std::vector<std::uint8_t> rows(3 * 100, 0);
    std::uint8_t *above = &rows[1], *row = &rows[101], *below = &rows[201];
    row[0] = 9;
    row[10] = row[11] = 7;       // the last of two
    row[20] = 5, above[21] = 5;  // equal above: the one below counts
    row[30] = 5, below[29] = 5;  // equal below: this one does not
    row[40] = 5, above[41] = 6;  // greater above
    row[50] = 255;
    row[61] = 3;  // beyond the width
    std::uint16_t peaks[64];
    const int found = kernels->fast_peaks(above, row, below, 60, peaks);
    EXPECT_EQ(std::vector<int>(peaks, peaks + found), (std::vector<int>{0, 11, 20, 50}));
  }
}

TEST(Kernels, BlurIsTheGaussianWithinTwoGreyLevels) {
  for (const cv::Size size : {cv::Size(131, 67), cv::Size(9, 4), cv::Size(1, 1)}) {
    const cv::Mat in = test::noise_image(size, 4);
    cv::Mat expected, out(size, CV_8UC1);
    cv::GaussianBlur(in, expected, {7, 7}, 2, 2, cv::BORDER_REFLECT_101);
    std::vector<std::uint16_t> scratch;
    for (const Kernels* kernels : all_kernels()) {
      smooth(in, out, scratch, *kernels);
      EXPECT_LE(cv::norm(out, expected, cv::NORM_INF), 2) << kernels->name << size;
      EXPECT_LE(cv::norm(out, expected, cv::NORM_L1), 0.4 * size.area()) << kernels->name << size;
    }
  }
  const cv::Mat white(20, 20, CV_8UC1, cv::Scalar(255));  // sums stay within 16 bits
  cv::Mat out(20, 20, CV_8UC1);
  smooth(white, out);
  EXPECT_TRUE(equal(out, white));
}

// Scales with and without the fast path for groups of eight, sizes below a group, enlarging too.
TEST(Kernels, ResizeIsBilinearWithinTwoGreyLevels) {
  const cv::Size sizes[][2] = {{{640, 480}, {533, 400}}, {{533, 400}, {444, 333}},
                               {{97, 61}, {41, 30}},     {{20, 20}, {11, 11}},
                               {{12, 9}, {10, 8}},       {{30, 30}, {47, 40}},
                               {{50, 50}, {1, 1}}};
  for (const auto& [from, to] : sizes) {
    const cv::Mat in = test::noise_image(from, 5);
    cv::Mat expected, reference(to, CV_8UC1), out(to, CV_8UC1);
    cv::resize(in, expected, to, 0, 0, cv::INTER_LINEAR);
    ResizeMap(from, to).apply(in, reference, baseline_kernels());
    EXPECT_LE(cv::norm(reference, expected, cv::NORM_INF), 2) << from << to;
    for (const Kernels* kernels : all_kernels()) {
      ResizeMap(from, to).apply(in, out, *kernels);
      EXPECT_TRUE(equal(out, reference)) << kernels->name << from << to;
    }
  }
}

TEST(Kernels, ResizeKeepsBlackAndWhite) {
  for (const int level : {0, 255}) {
    const cv::Mat in(48, 64, CV_8UC1, cv::Scalar(level));
    cv::Mat out(40, 53, CV_8UC1);
    ResizeMap(in.size(), out.size()).apply(in, out);
    EXPECT_TRUE(equal(out, cv::Mat(40, 53, CV_8UC1, cv::Scalar(level))));
  }
}

TEST(Kernels, CountGreyLevelsOfBlocksOfAnyWidth) {
  for (const Kernels* kernels : all_kernels())
    for (const int width : {1, 7, 8, 64, 91}) {
      const cv::Mat image = test::noise_image({100, 20}, 6, 0, 30);
      std::uint16_t counts[256];
      kernels->histogram(image.data, static_cast<std::ptrdiff_t>(image.step), width, 20, counts);
      for (int level = 0; level < 256; ++level)
        EXPECT_EQ(counts[level], cv::countNonZero(image.colRange(0, width) == level));
    }
}

}  // namespace
}  // namespace cairn
