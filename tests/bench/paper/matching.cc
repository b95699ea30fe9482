#include "tests/bench/paper/matching.h"

#include <cmath>

#include <fmt/format.h>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "common/feature/matching.h"

namespace cairn::bench {
namespace {

constexpr float kRatio = 0.85f;
constexpr double kRansacPixels = 2;

// Extracts as the method says, in the order of the views.
class MethodExtractor {
 public:
  explicit MethodExtractor(const Method& method)
      : method_(method), extractor_(options(method)), threshold_(method.extractor.entropy) {}

  Features extract(const cv::Mat& gray) {
    Features all;
    extractor_.extract(gray, all);
    return method_.leave_out_poor_blocks ? without_poor_blocks(all) : all;
  }
  double milliseconds() const { return extractor_.stats().total_ms; }

 private:
  static ExtractorOptions options(const Method& method) {
    ExtractorOptions o = method.extractor;
    if (method.leave_out_poor_blocks) o.entropy.mode = EntropyMode::kOff;
    return o;
  }

  Features without_poor_blocks(const Features& all) {
    const Pyramid& pyramid = extractor_.pyramid();
    const EntropyOptions& entropy = method_.extractor.entropy;
    std::vector<std::vector<float>> entropies(static_cast<std::size_t>(pyramid.levels()));
    double sum = 0, blocks = 0;
    for (int level = 0; level < pyramid.levels(); ++level) {
      auto& of_level = entropies[static_cast<std::size_t>(level)];
      append_block_entropies(pyramid[level], BlockGrid(pyramid[level].size(), entropy.block),
                             entropy.variant, of_level);
      for (const float e : of_level) sum += e;
      blocks += static_cast<double>(of_level.size());
    }
    const double least = threshold_.next(sum / blocks);
    Features kept;
    for (std::size_t i = 0; i < all.size(); ++i) {
      const Feature& f = all.points[i];
      const BlockGrid grid(pyramid[f.octave].size(), entropy.block);
      const cv::Point2f p = pyramid.from_full(f.octave, {f.x, f.y});
      for (int b = 0; b < grid.size(); ++b) {
        if (!grid.area(b).contains({static_cast<int>(p.x), static_cast<int>(p.y)})) continue;
        if (entropies[f.octave][static_cast<std::size_t>(b)] < least) break;
        kept.points.push_back(f);
        kept.descriptors.push_back(all.descriptors[i]);
        break;
      }
    }
    return kept;
  }

  Method method_;
  Extractor extractor_;
  EntropyThreshold threshold_;
};

// Whether the truth puts a's feature where b's is. False where a's depth is unknown.
bool is_correct(const ViewSet& set, const View& a, const Feature& fa, const View& b,
                const Feature& fb) {
  const float depth = a.depth.at<float>(cv::Point(cvRound(fa.x), cvRound(fa.y)));
  const auto direction = set.camera.unproject(fa.pixel());
  if (!(depth > 0) || !direction) return false;
  const Eigen::Vector3d in_a = *direction * (depth / direction->z());
  const auto seen =
      set.camera.project(b.world_from_camera.inverse() * (a.world_from_camera * in_a));
  const double scale = ScalePyramid{}.scale(std::max(fa.octave, fb.octave));
  return seen && (*seen - fb.pixel()).norm() <= set.tolerance * scale;
}

// Which matches one fundamental matrix explains; positions without lens distortion.
std::vector<bool> ransac(const Camera& camera, const Features& a, const Features& b,
                         const std::vector<FeatureMatch>& matches) {
  std::vector<bool> kept(matches.size(), false);
  std::vector<cv::Point2d> pa, pb;
  const auto ideal = [&](const Feature& f) {
    const Eigen::Vector2d p = camera.undistort(f.pixel()).value_or(f.pixel());
    return cv::Point2d(p.x(), p.y());
  };
  for (const FeatureMatch& m : matches) {
    pa.push_back(ideal(a.points[m.a]));
    pb.push_back(ideal(b.points[m.b]));
  }
  if (matches.size() < 15) return kept;  // any matrix explains most of so few
  cv::setRNGSeed(1);
  std::vector<std::uint8_t> mask;
  cv::findFundamentalMat(pa, pb, cv::FM_RANSAC, kRansacPixels, 0.999, 2000, mask);
  for (std::size_t i = 0; i < mask.size(); ++i) kept[i] = mask[i] != 0;
  return kept;
}

std::vector<FeatureMatch> match(const Features& a, const Features& b) {
  return match_mutual(a.descriptors, b.descriptors, kLooseDistance, kRatio);
}

void write(cv::Mat& image, const std::string& text, cv::Point at) {
  cv::putText(image, text, at, cv::FONT_HERSHEY_SIMPLEX, 0.6, {0, 0, 0}, 4, cv::LINE_AA);
  cv::putText(image, text, at, cv::FONT_HERSHEY_SIMPLEX, 0.6, {255, 255, 255}, 1, cv::LINE_AA);
}

cv::Mat draw_method(const ViewSet& set, std::size_t pair, const Method& method) {
  const View &a = set.views[set.pairs[pair].first], &b = set.views[set.pairs[pair].second];
  MethodExtractor extractor(method);
  const Features fa = extractor.extract(a.gray), fb = extractor.extract(b.gray);
  const auto matches = match(fa, fb);
  const auto inliers = ransac(set.camera, fa, fb, matches);
  cv::Mat both;
  cv::hconcat(a.gray, b.gray, both);
  cv::cvtColor(both, both, cv::COLOR_GRAY2BGR);
  int kept = 0;
  for (const bool inlier_pass : {false, true})
    for (std::size_t i = 0; i < matches.size(); ++i) {
      if (inliers[i] != inlier_pass) continue;
      kept += inlier_pass;
      const Feature &p = fa.points[matches[i].a], &q = fb.points[matches[i].b];
      cv::line(both, cv::Point2f(p.x, p.y), cv::Point2f(q.x + a.gray.cols, q.y),
               inlier_pass ? cv::Scalar(80, 220, 80) : cv::Scalar(70, 70, 150), 1, cv::LINE_AA);
    }
  write(both, fmt::format("{}: {} matches, {} after RANSAC", method.name, matches.size(), kept),
        {10, 24});
  return both;
}

}  // namespace

std::vector<Method> methods(const ExtractorOptions& off, const ExtractorOptions& on) {
  ExtractorOptions unsharpened = on;
  // No block lies below these, but fainter corners count as they do with sharpening.
  unsharpened.entropy.delta = -100;
  unsharpened.entropy.min_threshold = 1e-9;
  return {{"ORB", off},
          {"ORB + entropy", on, true},
          {"ORB, best corners first", unsharpened},
          {"ORB + entropy + sharpening", on}};
}

MatchingResult match_views(const ViewSet& set, const Method& method) {
  MatchingResult result;
  MethodExtractor extractor(method);
  std::vector<Features> features;
  for (const View& view : set.views) {
    features.push_back(extractor.extract(view.gray));
    result.extraction_ms.push_back(extractor.milliseconds());
  }
  for (const auto& [i, j] : set.pairs) {
    const Features &a = features[i], &b = features[j];
    const auto matches = match(a, b);
    const auto inliers = ransac(set.camera, a, b, matches);
    PairMatches found{static_cast<double>(a.size() + b.size()) / 2,
                      static_cast<int>(matches.size()), 0, 0};
    for (std::size_t m = 0; m < matches.size(); ++m) {
      if (!inliers[m]) continue;
      ++found.inliers;
      found.correct += is_correct(set, set.views[i], a.points[matches[m].a], set.views[j],
                                  b.points[matches[m].b]);
    }
    result.pairs.push_back(found);
  }
  return result;
}

cv::Mat draw_pair(const ViewSet& set, std::size_t pair, const std::vector<Method>& shown) {
  std::vector<cv::Mat> rows;
  for (const Method& method : shown) rows.push_back(draw_method(set, pair, method));
  cv::Mat picture;
  cv::vconcat(rows, picture);
  return picture;
}

}  // namespace cairn::bench
