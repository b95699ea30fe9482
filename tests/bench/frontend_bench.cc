// Time of the extractor, whole and by stage, beside cv::ORB on the same image in the same run.
//
//   cairn_frontend_bench [IMAGE] [--benchmark_filter=...]
//
// Without an image: a frame of a recording under $CAIRN_DATA if there is one, else a made-up
// picture.
#include <cstdlib>
#include <filesystem>
#include <string>

#include <benchmark/benchmark.h>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "client/frontend/extractor.h"
#include "client/frontend/orient.h"

namespace cairn {
namespace {

cv::Mat g_image;

cv::Mat made_up_picture() {
  cv::RNG rng(1);
  cv::Mat image(480, 640, CV_8UC1, cv::Scalar(128));
  for (int i = 0; i < 600; ++i) {
    const cv::Rect box(rng.uniform(-20, 640), rng.uniform(-20, 480), rng.uniform(4, 80),
                       rng.uniform(4, 80));
    cv::rectangle(image, box, cv::Scalar(rng.uniform(0, 256)), cv::FILLED);
  }
  cv::GaussianBlur(image, image, {3, 3}, 0.8);
  return image;
}

cv::Mat recorded_picture() {
  const char* data = std::getenv("CAIRN_DATA");
  const std::filesystem::path folder = data ? data : CAIRN_SOURCE_DIR "/../shared/data";
  return cv::imread((folder / "tum_fr1_rpy_240/rgb/1305031229.528748.png").string(),
                    cv::IMREAD_GRAYSCALE);
}

void report(benchmark::State& state, const ExtractorStats& sum, std::size_t features) {
  const auto mean = [&](double total) {
    return benchmark::Counter(total / static_cast<double>(state.iterations()));
  };
  state.counters["features"] = static_cast<double>(features);
  state.counters["1_pyramid"] = mean(sum.pyramid_ms);
  state.counters["2_entropy"] = mean(sum.entropy_ms);
  state.counters["3_sharpen"] = mean(sum.sharpen_ms);
  state.counters["4_fast"] = mean(sum.fast_ms);
  state.counters["5_quadtree"] = mean(sum.quadtree_ms);
  state.counters["6_orient"] = mean(sum.orient_ms);
  state.counters["7_smooth"] = mean(sum.smooth_ms);
  state.counters["8_describe"] = mean(sum.describe_ms);
}

void extract(benchmark::State& state, EntropyMode mode) {
  ExtractorOptions options;
  options.entropy.mode = mode;
  Extractor extractor(options);
  Features features;
  ExtractorStats sum;
  for (auto _ : state) {
    extractor.extract(g_image, features);
    const ExtractorStats& s = extractor.stats();
    sum.pyramid_ms += s.pyramid_ms;
    sum.entropy_ms += s.entropy_ms;
    sum.sharpen_ms += s.sharpen_ms;
    sum.fast_ms += s.fast_ms;
    sum.quadtree_ms += s.quadtree_ms;
    sum.orient_ms += s.orient_ms;
    sum.smooth_ms += s.smooth_ms;
    sum.describe_ms += s.describe_ms;
  }
  report(state, sum, features.size());
}
BENCHMARK_CAPTURE(extract, online, EntropyMode::kOnline)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(extract, off, EntropyMode::kOff)->Unit(benchmark::kMillisecond);

void opencv_orb(benchmark::State& state) {
  const auto orb = cv::ORB::create(1000, 1.2f, 8);
  std::vector<cv::KeyPoint> points;
  cv::Mat descriptors;
  for (auto _ : state) orb->detectAndCompute(g_image, {}, points, descriptors);
  state.counters["features"] = static_cast<double>(points.size());
}
BENCHMARK(opencv_orb)->Unit(benchmark::kMillisecond);

void block_entropy(benchmark::State& state) {
  const cv::Mat block = g_image(cv::Rect(128, 128, 64, 64));
  for (auto _ : state) benchmark::DoNotOptimize(entropy(block, EntropyVariant::kHistogram));
}
BENCHMARK(block_entropy);

void orient_one(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(orientation(g_image, 300, 200));
}
BENCHMARK(orient_one);

void subpixel_one(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(subpixel_corner(g_image, 300, 200));
}
BENCHMARK(subpixel_one);

void fast(benchmark::State& state, int low_threshold) {
  FastDetector detector({.low_threshold = low_threshold});
  std::vector<Corner> corners;
  for (auto _ : state) detector.detect(g_image, kPatchBorder, corners);
  state.counters["corners"] = static_cast<double>(corners.size());
}
BENCHMARK_CAPTURE(fast, two_thresholds, 7)->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(fast, high_only, 0)->Unit(benchmark::kMicrosecond);

void describe_one(benchmark::State& state) {
  const Describer describer;
  float angle = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(describer.describe(g_image, 300, 200, angle));
    angle = angle < 6 ? angle + 0.37f : 0;
  }
}
BENCHMARK(describe_one);

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  benchmark::Initialize(&argc, argv);
  cv::setNumThreads(1);
  cairn::g_image = argc > 1 ? cv::imread(argv[1], cv::IMREAD_GRAYSCALE) : cairn::recorded_picture();
  if (cairn::g_image.empty()) cairn::g_image = cairn::made_up_picture();
  std::printf("image %d x %d\n", cairn::g_image.cols, cairn::g_image.rows);
  benchmark::RunSpecifiedBenchmarks();
}
