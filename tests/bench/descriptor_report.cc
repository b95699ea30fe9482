// How well the descriptors tell places apart: warped pairs of photographs, matched with Cairn's and
// with cv::ORB's descriptors of the very same key points.
//
//   cairn_descriptor_report DIR_WITH_PHOTOS
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <vector>

#include <opencv2/features2d.hpp>
#include <opencv2/imgcodecs.hpp>

#include "client/frontend/extractor.h"
#include "common/feature/matching.h"
#include "tests/bench/warped_pair.h"

namespace cairn {
namespace {

struct View {
  Features features;            // with Cairn's descriptors
  std::vector<Descriptor> orb;  // OpenCV's for the same points
};

ExtractorOptions plain() {
  return {.entropy = {.mode = EntropyMode::kOff}};
}

// cv::ORB drops points near the edges: those are left out of the comparison.
View look(const cv::Mat& image) {
  static const auto orb = cv::ORB::create(2000, 1.2f, 8, 16);
  Extractor extractor(plain());
  Features all;
  extractor.extract(image, all);
  std::vector<cv::KeyPoint> points;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Feature& f = all.points[i];
    const float scale = std::pow(1.2f, f.octave);
    const cv::Point2f level = extractor.pyramid().from_full(f.octave, {f.x, f.y});
    points.emplace_back(level * scale, 31 * scale, f.angle * 180 / static_cast<float>(M_PI), 1.0f,
                        f.octave, static_cast<int>(i));
  }
  cv::Mat descriptors;
  orb->compute(image, points, descriptors);
  View view;
  for (int i = 0; i < descriptors.rows; ++i) {
    const auto index = static_cast<std::size_t>(points[static_cast<std::size_t>(i)].class_id);
    view.features.points.push_back(all.points[index]);
    view.features.descriptors.push_back(all.descriptors[index]);
    Descriptor d;
    std::memcpy(d.data(), descriptors.ptr(i), sizeof d);
    view.orb.push_back(d);
  }
  return view;
}

struct Score {
  long matches = 0, correct = 0;
  double squared_error = 0;                          // of correct matches, in pixels of their level
  std::array<long, 257> matches_at{}, correct_at{};  // by Hamming distance

  void add(const bench::WarpedPair& pair, const View& a, const View& b,
           const std::vector<FeatureMatch>& found) {
    for (const FeatureMatch& m : found) {
      const Feature &p = a.features.points[m.a], &q = b.features.points[m.b];
      const cv::Point2d expected = pair.map({p.x, p.y});
      const double scale = std::pow(1.2, std::max(p.octave, q.octave));
      const double error = std::hypot(expected.x - q.x, expected.y - q.y) / scale;
      ++matches;
      ++matches_at[m.distance];
      if (error > 2.5) continue;
      ++correct;
      ++correct_at[m.distance];
      squared_error += error * error;
    }
  }
  // Correct matches with the greatest distance limit that leaves `precision`: does not depend on
  // how a pattern's distances are scaled, as a fixed limit does.
  long correct_at_precision(double precision) const {
    long m = 0, c = 0, best = 0;
    for (std::size_t d = 0; d <= 256; ++d) {
      m += matches_at[d];
      c += correct_at[d];
      if (static_cast<double>(c) >= precision * static_cast<double>(m)) best = c;
    }
    return best;
  }
  void print(const char* name) const {
    std::printf(
        "%-28s %7ld matches  %7ld correct  precision %.4f  rms %.3f px of level  at 0.90: %ld\n",
        name, matches, correct, static_cast<double>(correct) / static_cast<double>(matches),
        std::sqrt(squared_error / static_cast<double>(correct)), correct_at_precision(0.9));
  }
};

void compare(const std::vector<std::filesystem::path>& files, const char* title,
             const bench::Warp& options) {
  Score cairn_score, orb_score, cairn_loose, orb_loose;
  for (std::size_t i = 0; i < files.size(); i += 5) {  // those that were not learned from
    const cv::Mat photo = cv::imread(files[i].string(), cv::IMREAD_GRAYSCALE);
    if (photo.empty()) continue;
    const bench::WarpedPair pair = bench::warp(photo, options, 100000 + i);
    const View a = look(pair.original), b = look(pair.warped);
    const auto& da = a.features.descriptors;
    const auto& db = b.features.descriptors;
    cairn_score.add(pair, a, b, match_mutual(da, db, 50, 0.85f));
    orb_score.add(pair, a, b, match_mutual(a.orb, b.orb, 50, 0.85f));
    cairn_loose.add(pair, a, b, match_mutual(da, db, 256));
    orb_loose.add(pair, a, b, match_mutual(a.orb, b.orb, 256));
  }
  std::printf("%s\n", title);
  cairn_score.print("  cairn, <= 50, ratio 0.85");
  orb_score.print("  cv::ORB, <= 50, ratio 0.85");
  cairn_loose.print("  cairn, mutual nearest");
  orb_loose.print("  cv::ORB, mutual nearest");
}

int report(const char* folder) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  compare(files, "turned by up to 15 degrees, scaled by up to 10 %",
          {.max_turn = 0.26, .max_log_scale = 0.1});
  compare(files, "turned by any angle, scaled by up to 25 %", {});
  compare(files, "as before, more noise and blur", {.noise = 6, .max_blur = 2.0});
  return 0;
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: %s DIR_WITH_PHOTOS\n", argv[0]);
    return 2;
  }
  return cairn::report(argv[1]);
}
