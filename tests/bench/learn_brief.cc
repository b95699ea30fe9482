// Learns the tests of the descriptor from photographs and prints client/frontend/brief_pattern.cc.
//
//   cairn_learn_brief DIR_WITH_PHOTOS > client/frontend/brief_pattern.cc
//
// Method: Rublee et al. 2011, section 4.3. Of many random tests on oriented patches around corners,
// take those that split the patches evenly (mean near 0.5) and say something new (little
// correlation with those taken before). Added here: each patch is also seen warped, and tests that
// often change their answer between the two views come later.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <random>
#include <vector>

#include <opencv2/imgcodecs.hpp>

#include "client/frontend/extractor.h"
#include "tests/bench/warped_pair.h"

namespace cairn {
namespace {

constexpr int kRadius = 17;  // rounding after rotation may add almost a pixel
constexpr int kCandidates = 150000;
constexpr std::size_t kPatchesPerPhoto = 40;
constexpr double kFlipWeight = 1.0;  // cost of a flip rate of 1, in units of |mean - 0.5|

struct Patches {
  std::vector<std::vector<std::uint8_t>> original, warped;  // [point of the disc][patch]
  std::size_t count() const { return original.front().size(); }
};

std::vector<cv::Point> disc() {
  std::vector<cv::Point> points;
  for (int y = -kRadius; y <= kRadius; ++y)
    for (int x = -kRadius; x <= kRadius; ++x)
      if (x * x + y * y <= kRadius * kRadius) points.emplace_back(x, y);
  return points;
}

// Pyramid of smoothed levels, and the features of an image.
struct Seen {
  explicit Seen(const cv::Mat& image)
      : extractor({.features = 600, .entropy = {.mode = EntropyMode::kOff}}) {
    extractor.extract(image, features);
    smoothed.reshape(extractor.pyramid().sizes());
    for (int i = 0; i < smoothed.levels(); ++i) smooth(extractor.pyramid()[i], smoothed[i]);
  }
  void sample(const Feature& f, const std::vector<cv::Point>& points,
              std::vector<std::vector<std::uint8_t>>& values) const {
    const cv::Point2f at = extractor.pyramid().from_full(f.octave, {f.x, f.y});
    const long x = std::lround(at.x), y = std::lround(at.y);
    const double c = std::cos(f.angle), s = std::sin(f.angle);
    for (std::size_t i = 0; i < points.size(); ++i)
      values[i].push_back(smoothed[f.octave].at<std::uint8_t>(
          static_cast<int>(y + std::lround(s * points[i].x + c * points[i].y)),
          static_cast<int>(x + std::lround(c * points[i].x - s * points[i].y))));
  }
  Extractor extractor;
  Features features;
  LevelStack smoothed;
};

void collect(const cv::Mat& photo, std::uint64_t seed, const std::vector<cv::Point>& points,
             Patches& patches) {
  const bench::WarpedPair pair = bench::warp(photo, {}, seed);
  const Seen original(pair.original), warped(pair.warped);
  std::size_t taken = 0;
  for (std::size_t i = 0; i < original.features.size() && taken < kPatchesPerPhoto; ++i) {
    // Every 7th, so that all levels are among them.
    const Feature& f = original.features.points[i * 7 % original.features.size()];
    const cv::Point2d expected = pair.map({f.x, f.y});
    const double scale = std::pow(1.2, f.octave);
    const auto match = std::find_if(
        warped.features.points.begin(), warped.features.points.end(), [&](const Feature& g) {
          return std::abs(g.octave - f.octave) <= 1 &&
                 std::hypot(g.x - expected.x, g.y - expected.y) < 1.5 * scale;
        });
    if (match == warped.features.points.end()) continue;
    original.sample(f, points, patches.original);
    warped.sample(*match, points, patches.warped);
    ++taken;
  }
}

using Bits = std::vector<std::uint64_t>;

Bits answers(const std::vector<std::uint8_t>& a, const std::vector<std::uint8_t>& b) {
  Bits bits((a.size() + 63) / 64, 0);
  for (std::size_t i = 0; i < a.size(); ++i)
    bits[i / 64] |= static_cast<std::uint64_t>(a[i] < b[i]) << (i % 64);
  return bits;
}

int count_ones(const Bits& bits) {
  int ones = 0;
  for (const std::uint64_t w : bits) ones += std::popcount(w);
  return ones;
}

int count_differing(const Bits& a, const Bits& b) {
  int ones = 0;
  for (std::size_t i = 0; i < a.size(); ++i) ones += std::popcount(a[i] ^ b[i]);
  return ones;
}

struct Candidate {
  BriefTest test;
  Bits bits;
  double mean, cost;
};

std::vector<Candidate> candidates(const std::vector<cv::Point>& points, const Patches& patches,
                                  double flip_weight) {
  std::mt19937 rng(1);
  std::vector<Candidate> list;
  const auto n = static_cast<double>(patches.count());
  while (list.size() < kCandidates) {
    const std::size_t a = rng() % points.size(), b = rng() % points.size();
    if (a == b) continue;
    Candidate c;
    c.test = {static_cast<std::int8_t>(points[a].x), static_cast<std::int8_t>(points[a].y),
              static_cast<std::int8_t>(points[b].x), static_cast<std::int8_t>(points[b].y)};
    c.bits = answers(patches.original[a], patches.original[b]);
    c.mean = count_ones(c.bits) / n;
    const double flips = count_differing(c.bits, answers(patches.warped[a], patches.warped[b])) / n;
    c.cost = std::abs(c.mean - 0.5) + flip_weight * flips;
    list.push_back(std::move(c));
  }
  std::stable_sort(list.begin(), list.end(),
                   [](const Candidate& a, const Candidate& b) { return a.cost < b.cost; });
  return list;
}

// Pearson correlation of two binary variables, without sign: a test and its opposite say the same.
double correlation(const Candidate& a, const Candidate& b, double n) {
  const double both =
      (count_ones(a.bits) + count_ones(b.bits) - count_differing(a.bits, b.bits)) / 2.0 / n;
  const double spread = std::sqrt(a.mean * (1 - a.mean) * b.mean * (1 - b.mean));
  return spread > 0 ? std::abs(both - a.mean * b.mean) / spread : 1.0;
}

// Greedy; raises the bar on correlation until enough are found.
std::vector<BriefTest> choose(const std::vector<Candidate>& list, double n) {
  for (double limit = 0.14;; limit += 0.02) {
    std::vector<const Candidate*> chosen;
    for (const Candidate& c : list) {
      if (std::all_of(chosen.begin(), chosen.end(),
                      [&](const Candidate* o) { return correlation(c, *o, n) < limit; }))
        chosen.push_back(&c);
      if (chosen.size() == kBriefTests) break;
    }
    std::fprintf(stderr, "correlation below %.2f: %zu tests\n", limit, chosen.size());
    if (chosen.size() < kBriefTests) continue;
    std::vector<BriefTest> tests;
    for (const Candidate* c : chosen) tests.push_back(c->test);
    return tests;
  }
}

void print(const std::vector<BriefTest>& tests) {
  std::puts(
      "// Generated by tests/bench/learn_brief.cc; do not edit.\n"
      "#include \"client/frontend/brief_pattern.h\"\n\nnamespace cairn {\n\n"
      "// clang-format off\n"
      "const std::array<BriefTest, kBriefTests> kBriefPattern = {{");
  for (std::size_t i = 0; i < tests.size(); ++i) {
    const BriefTest& t = tests[i];
    std::printf("%s{%d, %d, %d, %d},%s", i % 4 == 0 ? "    " : " ", t.ax, t.ay, t.bx, t.by,
                i % 4 == 3 ? "\n" : "");
  }
  std::puts("}};\n// clang-format on\n\n}  // namespace cairn");
}

int learn(const char* folder, double flip_weight) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  const std::vector<cv::Point> points = disc();
  Patches patches;
  patches.original.resize(points.size());
  patches.warped.resize(points.size());
  // Every fifth photograph is left for the evaluation (descriptor_report.cc).
  for (std::size_t i = 0; i < files.size(); ++i)
    if (i % 5 != 0)
      if (const cv::Mat photo = cv::imread(files[i].string(), cv::IMREAD_GRAYSCALE); !photo.empty())
        collect(photo, i, points, patches);
  std::fprintf(stderr, "%zu patches\n", patches.count());
  if (patches.count() < 1000) return 1;
  print(choose(candidates(points, patches, flip_weight), static_cast<double>(patches.count())));
  return 0;
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: %s DIR_WITH_PHOTOS [FLIP_WEIGHT]\n", argv[0]);
    return 2;
  }
  return cairn::learn(argv[1], argc > 2 ? std::atof(argv[2]) : cairn::kFlipWeight);
}
