// Time of the extractor beside the textbook's and cv::ORB's on the same images in the same run, and
// how far each stage stands from its floor.
//
//   ./dev bench frontend [--repeat N] [--micro [--benchmark_...]]
//
// 640 x 480: frames of tum_fr1_rpy_240; 752 x 480: frames of euroc_v101_mono_90; both from
// $CAIRN_DATA or ../shared/data. Where they are missing, the embedded desk scene in that size.
// --micro adds Google Benchmark's view of single functions.
#include <ctime>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgcodecs.hpp>

#include "client/frontend/extractor.h"
#include "client/frontend/orient.h"
#include "tests/bench/frontend/floors.h"
#include "tests/bench/frontend/textbook_orb.h"
#include "tests/support/synthetic_sequence.h"

namespace cairn::bench {
namespace {

constexpr int kImages = 6;
constexpr double kBar = 0.5;  // of the textbook's time

struct ImageSet {
  std::string name;
  std::vector<cv::Mat> images;
};

// Every n-th image of a folder, so that there are kImages.
std::vector<cv::Mat> recorded(const std::string& folder) {
  namespace fs = std::filesystem;
  const char* data = std::getenv("CAIRN_DATA");
  const fs::path path = fs::path(data ? data : CAIRN_SOURCE_DIR "/../shared/data") / folder;
  std::vector<std::string> files;
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(path, ignored))
    files.push_back(entry.path().string());
  std::sort(files.begin(), files.end());
  std::vector<cv::Mat> images;
  for (std::size_t i = 0; i < kImages && files.size() >= kImages; ++i)
    images.push_back(cv::imread(files[i * files.size() / kImages], cv::IMREAD_GRAYSCALE));
  return images;
}

ImageSet image_set(const std::string& folder, int width) {
  ImageSet set{folder, recorded(folder)};
  if (!set.images.empty() && !set.images.front().empty()) return set;
  set = {"embedded scene 'desk'", {}};
  const auto sequence = synthetic::SyntheticSequence::make({.width = width, .height = 480});
  if (!sequence) return set;
  for (int i = 0; i < kImages; ++i)
    set.images.push_back((*sequence)->frame(i * (*sequence)->size() / kImages).gray);
  return set;
}

// Of this thread: what others do on the machine does not count.
double cpu_ms() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) * 1e3 + static_cast<double>(t.tv_nsec) * 1e-6;
}

template <typename Work>
double time_of(Work&& work) {
  const double start = cpu_ms();
  work();
  return cpu_ms() - start;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

struct Stage {
  const char* name;
  double ExtractorStats::*time;
  double Floors::*floor;
};
constexpr Stage kStages[] = {
    {"pyramid", &ExtractorStats::pyramid_ms, &Floors::pyramid},
    {"entropy", &ExtractorStats::entropy_ms, &Floors::entropy},
    {"sharpen", &ExtractorStats::sharpen_ms, &Floors::sharpen},
    {"FAST", &ExtractorStats::fast_ms, &Floors::fast},
    {"quadtree", &ExtractorStats::quadtree_ms, &Floors::quadtree},
    {"orient", &ExtractorStats::orient_ms, &Floors::orient},
    {"blur", &ExtractorStats::smooth_ms, &Floors::smooth},
    {"describe", &ExtractorStats::describe_ms, &Floors::describe},
};

struct Measured {
  double textbook = 0, opencv = 0, ours = 0, plain = 0;
  std::vector<double> stages;
  ExtractorStats stats;  // of the last image
  double textbook_features = 0, opencv_features = 0, our_features = 0, plain_features = 0;
};

// The four in turn on every image, so that whatever slows the machine slows them alike.
Measured measure(const ImageSet& set, int repeat) {
  TextbookOrb textbook({});
  const auto orb = cv::ORB::create(1000, 1.2f, 8);
  Extractor ours({}), plain({.entropy = {.mode = EntropyMode::kOff}});
  Features textbook_features, our_features, plain_features;
  std::vector<cv::KeyPoint> points;
  cv::Mat descriptors;
  std::vector<double> times[4], stages[std::size(kStages)];
  for (int i = 0; i < repeat; ++i)
    for (const cv::Mat& image : set.images) {
      times[0].push_back(time_of([&] { textbook.extract(image, textbook_features); }));
      times[1].push_back(time_of([&] { orb->detectAndCompute(image, {}, points, descriptors); }));
      times[2].push_back(time_of([&] { ours.extract(image, our_features); }));
      for (std::size_t s = 0; s < std::size(kStages); ++s)
        stages[s].push_back(ours.stats().*kStages[s].time);
      times[3].push_back(time_of([&] { plain.extract(image, plain_features); }));
    }
  Measured m{.textbook = median(times[0]),
             .opencv = median(times[1]),
             .ours = median(times[2]),
             .plain = median(times[3]),
             .stages = {},
             .stats = ours.stats(),
             .textbook_features = static_cast<double>(textbook_features.size()),
             .opencv_features = static_cast<double>(points.size()),
             .our_features = static_cast<double>(our_features.size()),
             .plain_features = static_cast<double>(plain_features.size())};
  for (const auto& stage : stages) m.stages.push_back(median(stage));
  return m;
}

// True when the bar is met.
bool report(const Machine& machine, const ImageSet& set, int repeat) {
  const Measured m = measure(set, repeat);
  const cv::Size size = set.images.front().size();
  std::printf("\n## %d x %d: %s, %zu images, %d times each\n\n", size.width, size.height,
              set.name.c_str(), set.images.size(), repeat);
  std::printf("| extractor | ms | of the textbook | features |\n|---|---|---|---|\n");
  const auto row = [&](const char* name, double ms, double features) {
    std::printf("| %s | %.2f | %.2f | %.0f |\n", name, ms, ms / m.textbook, features);
  };
  row("textbook (ORB-SLAM2 style)", m.textbook, m.textbook_features);
  row("cv::ORB", m.opencv, m.opencv_features);
  row("Cairn, entropy and sharpening on", m.ours, m.our_features);
  row("Cairn, plain ORB", m.plain, m.plain_features);

  const Floors floor = floors(machine, size, ScalePyramid(), m.stats, m.our_features);
  std::printf("\n| stage of Cairn's | ms | floor ms | times the floor |\n|---|---|---|---|\n");
  for (std::size_t s = 0; s < std::size(kStages); ++s) {
    const double least = floor.*kStages[s].floor;
    std::printf("| %s | %.3f | %.3f | %.1f |\n", kStages[s].name, m.stages[s], least,
                least > 0 ? m.stages[s] / least : 0.0);
  }
  std::printf("\nratio %.2f, bar %.2f: %s\n", m.ours / m.textbook, kBar,
              m.ours <= kBar * m.textbook ? "met" : "missed");
  return m.ours <= kBar * m.textbook;
}

cv::Mat g_image;

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

void blur(benchmark::State& state) {
  cv::Mat out(g_image.size(), CV_8UC1);
  for (auto _ : state) smooth(g_image, out);
}
BENCHMARK(blur)->Unit(benchmark::kMicrosecond);

void describe_one(benchmark::State& state) {
  Describer describer;
  float angle = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(describer.describe(g_image, 300, 200, angle));
    angle = angle < 6 ? angle + 0.37f : 0;
  }
}
BENCHMARK(describe_one);

}  // namespace

int run(int argc, char** argv) {
  int repeat = 30;
  bool micro = false;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    if (argument == "--micro")
      micro = true;
    else if (argument == "--repeat" && i + 1 < argc)
      repeat = std::max(1, std::atoi(argv[++i]));
    else if (!argument.starts_with("--benchmark_")) {
      std::fprintf(stderr, "usage: %s [--repeat N] [--micro [--benchmark_...]]\n", argv[0]);
      return 2;
    }
  }
  cv::setNumThreads(1);
  const Machine machine = measure_machine();
  std::printf("# Front end: one thread, 1000 features, 8 levels, scale 1.2\n\n");
  std::printf(
      "Medians of the thread's processor time. Measured here: clock %.2f GHz, copying\n"
      "within the second-level cache %.0f GB/s read and written. A stage's floor is the\n"
      "greater of its bytes at that speed and its operations at %.0f vector operations,\n"
      "%.0f loads and %.0f store a cycle (tests/bench/frontend/floors.cc).\n",
      machine.hertz * 1e-9, machine.bytes_per_s * 1e-9, kVectorOpsPerCycle, kLoadsPerCycle,
      kStoresPerCycle);
  bool met = true;
  for (const ImageSet& set : {image_set("tum_fr1_rpy_240/rgb", 640),
                              image_set("euroc_v101_mono_90/mav0/cam0/data", 752)}) {
    met = report(machine, set, repeat) && met;
    if (g_image.empty()) g_image = set.images.front();
  }
  if (micro) {
    benchmark::Initialize(&argc, argv);
    benchmark::RunSpecifiedBenchmarks();
  }
  return met ? 0 : 1;
}

}  // namespace cairn::bench

int main(int argc, char** argv) {
  return cairn::bench::run(argc, argv);
}
