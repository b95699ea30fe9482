// Every frame source on small recordings written for the test, good and bad.
#include <cmath>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>

#include "client/capture/frame_source.h"
#include "client/capture/synth_source.h"
#include "tests/support/dataset_writer.h"
#include "tests/support/temp_folder.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;
using synthetic::DatasetLayout;
using synthetic::SequenceOptions;
using synthetic::SyntheticSequence;
using testing::HasSubstr;

constexpr int kFrames = 4;

SequenceOptions small(Sensor sensor) {
  return {.scene = "weak", .frames = kFrames, .sensor = sensor, .width = 160, .height = 120};
}

std::shared_ptr<const SyntheticSequence> make(const SequenceOptions& options) {
  return *SyntheticSequence::make(options);
}

CameraConfig config_of(const SyntheticSequence& sequence) {
  CameraConfig config;
  config.sensor = sequence.options().sensor;
  config.camera = sequence.camera();
  if (config.sensor == Sensor::kStereo) config.baseline_m = sequence.options().baseline_m;
  return config;
}

struct Played {
  std::vector<Frame> frames;
  std::uint64_t skipped = 0;
  std::string error;
  std::optional<CameraConfig> camera;
  std::optional<std::uint64_t> size;
};

Played play(const std::string& spec, const std::optional<CameraConfig>& config) {
  Played played;
  auto source = open_source(spec, config);
  if (!source) {
    played.error = source.message();
    return played;
  }
  played.camera = (*source)->camera();
  played.size = (*source)->size();
  for (;;) {
    auto frame = (*source)->next();
    if (!frame) {
      played.error = frame.message();
      break;
    }
    if (!frame->has_value()) break;
    played.frames.push_back(**frame);
  }
  played.skipped = (*source)->skipped();
  return played;
}

bool same(const cv::Mat& a, const cv::Mat& b, double tolerance = 0) {
  return a.size() == b.size() && a.type() == b.type() && cv::norm(a, b, cv::NORM_INF) <= tolerance;
}

void write(const fs::path& file, const std::string& text) {
  std::ofstream(file) << text;
}

// A recording in TUM layout on disk, and the sequence that it was made from.
class TumSource : public testing::Test {
 protected:
  void record(Sensor sensor) {
    sequence_ = make(small(sensor));
    ASSERT_TRUE(write_dataset(*sequence_, root(), DatasetLayout::kTum).ok());
  }
  fs::path root() const { return folder_ / "recording"; }
  std::string spec() const { return "tum:" + root().string(); }
  // The i-th image of a kind ("rgb", "depth", "right").
  fs::path image(const std::string& kind, int i) const {
    std::vector<fs::path> files;
    for (const auto& entry : fs::directory_iterator(root() / kind)) files.push_back(entry.path());
    std::sort(files.begin(), files.end());
    return files.at(static_cast<std::size_t>(i));
  }

  synthetic::TempFolder folder_;
  std::shared_ptr<const SyntheticSequence> sequence_;
};

TEST_F(TumSource, GivesBackTheRgbdFramesThatWereWritten) {
  record(Sensor::kRgbd);
  const Played played = play(spec(), config_of(*sequence_));
  EXPECT_EQ(played.error, "");
  EXPECT_EQ(played.skipped, 0u);
  EXPECT_EQ(played.size, kFrames);
  ASSERT_EQ(played.frames.size(), static_cast<std::size_t>(kFrames));
  for (int i = 0; i < kFrames; ++i) {
    const auto expected = sequence_->frame(i);
    EXPECT_EQ(played.frames[i].stamp_ns, expected.stamp_ns);
    EXPECT_TRUE(same(played.frames[i].gray, expected.gray));
    EXPECT_TRUE(same(played.frames[i].depth, expected.depth, 0.51 / 5000));
    EXPECT_TRUE(played.frames[i].right.empty());
  }
}

TEST_F(TumSource, GivesStereoPairsFromRightTxt) {
  record(Sensor::kStereo);
  const Played played = play(spec(), config_of(*sequence_));
  ASSERT_EQ(played.frames.size(), static_cast<std::size_t>(kFrames)) << played.error;
  EXPECT_TRUE(same(played.frames[2].right, sequence_->frame(2).right));
  EXPECT_TRUE(played.frames[2].depth.empty());
}

TEST_F(TumSource, ReadsColourImagesAsGray) {
  record(Sensor::kMono);
  const cv::Mat gray = sequence_->frame(1).gray;
  cv::Mat colour;
  cv::merge(std::vector<cv::Mat>{gray, gray, gray}, colour);
  cv::imwrite(image("rgb", 1).string(), colour);
  const Played played = play(spec(), config_of(*sequence_));
  ASSERT_EQ(played.frames.size(), static_cast<std::size_t>(kFrames));
  EXPECT_TRUE(same(played.frames[1].gray, gray, 1));
}

TEST_F(TumSource, SkipsAndCountsWhatItCannotUse) {
  record(Sensor::kRgbd);
  write(image("rgb", 1), "this is no image");
  cv::imwrite(image("depth", 2).string(), cv::Mat(60, 80, CV_16U, cv::Scalar(5000)));
  const Played played = play(spec(), config_of(*sequence_));
  EXPECT_EQ(played.error, "");
  EXPECT_EQ(played.skipped, 2u);
  ASSERT_EQ(played.frames.size(), 2u);
  EXPECT_EQ(played.frames[1].stamp_ns, sequence_->stamp_ns(3));
}

TEST_F(TumSource, SkipsMissingTruncatedAndEightBitDepthFiles) {
  record(Sensor::kRgbd);
  fs::remove(image("rgb", 0));
  fs::resize_file(image("rgb", 0), 0);  // the second, now the first
  cv::imwrite(image("depth", 2).string(), cv::Mat(120, 160, CV_8U, cv::Scalar(50)));
  const Played played = play(spec(), config_of(*sequence_));
  EXPECT_EQ(played.skipped, 3u);
  EXPECT_EQ(played.frames.size(), 1u);
}

TEST_F(TumSource, SaysSoWhenNoFrameIsUsable) {
  record(Sensor::kMono);
  CameraConfig config = config_of(*sequence_);
  config.camera = Camera(LensModel::kPinhole, 640, 480, {500, 500, 320, 240}, {});
  const Played played = play(spec(), config);
  EXPECT_THAT(played.error, HasSubstr("none of 4 frames is usable"));
  EXPECT_THAT(played.error, HasSubstr("is 160x120, the camera 640x480"));
}

TEST_F(TumSource, NamesWhatIsMissing) {
  record(Sensor::kMono);
  CameraConfig config = config_of(*sequence_);
  EXPECT_THAT(play(spec(), std::nullopt).error, HasSubstr("camera"));
  EXPECT_THAT(play("tum:/nowhere", config).error, HasSubstr("/nowhere: no such folder"));
  config.sensor = Sensor::kRgbd;
  EXPECT_THAT(play(spec(), config).error, HasSubstr("depth.txt"));
  config.sensor = Sensor::kStereo;
  EXPECT_THAT(play(spec(), config).error, HasSubstr("right.txt"));
  fs::remove(root() / "rgb.txt");
  EXPECT_THAT(play(spec(), config).error, HasSubstr("rgb.txt"));
}

TEST_F(TumSource, PairsImagesByStampAndLeavesTheRestOut) {
  record(Sensor::kRgbd);
  std::string depth_list;  // 15 ms late; the last one 25 ms
  for (int i = 0; i < kFrames; ++i) {
    const std::int64_t stamp = sequence_->stamp_ns(i) + (i == kFrames - 1 ? 25 : 15) * 1'000'000LL;
    depth_list += std::to_string(stamp / 1'000'000'000) + "." +
                  std::to_string(1'000'000'000 + stamp % 1'000'000'000).substr(1) + " depth/" +
                  image("depth", i).filename().string() + "\n";
  }
  write(root() / "depth.txt", depth_list);
  const Played played = play(spec(), config_of(*sequence_));
  ASSERT_EQ(played.frames.size(), static_cast<std::size_t>(kFrames - 1)) << played.error;
  EXPECT_TRUE(same(played.frames[1].depth, sequence_->frame(1).depth, 0.51 / 5000));
}

TEST_F(TumSource, StereoNeedsABaselineOrARightCamera) {
  record(Sensor::kStereo);
  CameraConfig config = config_of(*sequence_);
  config.baseline_m = 0;
  EXPECT_THAT(play(spec(), config).error, HasSubstr("baseline_m"));
}

TEST(EurocSource, ReadsItsOwnStereoCalibrationAndRectifies) {
  const synthetic::TempFolder folder;
  const auto sequence = make(small(Sensor::kStereo));
  ASSERT_TRUE(write_dataset(*sequence, folder / "e", DatasetLayout::kEuroc).ok());
  const Played played = play("euroc:" + (folder / "e").string(), std::nullopt);
  ASSERT_EQ(played.frames.size(), static_cast<std::size_t>(kFrames)) << played.error;
  EXPECT_EQ(played.camera->sensor, Sensor::kStereo);
  EXPECT_NEAR(played.camera->baseline_m, 0.11, 1e-9);
  EXPECT_EQ(played.camera->rate_hz, 30);
  EXPECT_EQ(played.frames[3].stamp_ns, sequence->stamp_ns(3));
  EXPECT_EQ(played.frames[0].right.size(), cv::Size(160, 120));
}

TEST(EurocSource, IsMonoWithoutASecondCamera) {
  const synthetic::TempFolder folder;
  const auto sequence = make(small(Sensor::kMono));
  ASSERT_TRUE(write_dataset(*sequence, folder / "e", DatasetLayout::kEuroc).ok());
  for (const char* part : {"e", "e/mav0"}) {
    const Played played = play("euroc:" + (folder / part).string(), std::nullopt);
    ASSERT_EQ(played.frames.size(), static_cast<std::size_t>(kFrames)) << played.error;
    EXPECT_EQ(played.camera->sensor, Sensor::kMono);
    EXPECT_EQ(played.camera->camera.intrinsics(), sequence->camera().intrinsics());
    EXPECT_TRUE(same(played.frames[1].gray, sequence->frame(1).gray));
  }
}

TEST(EurocSource, NamesFileAndKeyOfABadCalibration) {
  const synthetic::TempFolder folder;
  const auto sequence = make(small(Sensor::kMono));
  ASSERT_TRUE(write_dataset(*sequence, folder / "e", DatasetLayout::kEuroc).ok());
  const std::string spec = "euroc:" + (folder / "e").string();
  const fs::path file = folder / "e/mav0/cam0/sensor.yaml";
  write(file, "%YAML:1.0\nresolution: [160, 120]\nintrinsics: [nan, 1, 2]\n");
  EXPECT_THAT(play(spec, std::nullopt).error, HasSubstr("sensor.yaml"));
  EXPECT_THAT(play(spec, std::nullopt).error, HasSubstr("intrinsics"));
  write(file, "{[");
  EXPECT_THAT(play(spec, std::nullopt).error, HasSubstr("sensor.yaml"));
  fs::remove(file);
  EXPECT_THAT(play(spec, std::nullopt).error, HasSubstr("sensor.yaml"));
  EXPECT_THAT(play("euroc:/nowhere", std::nullopt).error, HasSubstr("mav0/cam0"));
  CameraConfig rgbd = config_of(*sequence);
  rgbd.sensor = Sensor::kRgbd;
  EXPECT_THAT(play(spec, rgbd).error, HasSubstr("no depth"));
}

class KittiSource : public testing::Test {
 protected:
  void SetUp() override {
    fs::create_directories(folder_ / "image_0");
    fs::create_directories(folder_ / "image_1");
    for (int i = 0; i < 3; ++i) {
      const std::string name = "00000" + std::to_string(i) + ".png";
      cv::imwrite((folder_ / "image_0" / name).string(),
                  cv::Mat(60, 80, CV_8U, cv::Scalar(10 + i)));
      cv::imwrite((folder_ / "image_1" / name).string(),
                  cv::Mat(60, 80, CV_8U, cv::Scalar(20 + i)));
    }
    write(folder_ / "times.txt", "0.000000e+00\n1.037359e-01\n2.073381e-01\n");
    write(folder_ / "calib.txt",
          "P0: 70 0 40 0 0 71 30 0 0 0 1 0\nP1: 70 0 40 -37.6 0 71 30 0 0 0 1 0\n");
  }
  std::string spec() const { return "kitti:" + folder_.path().string(); }

  synthetic::TempFolder folder_;
};

TEST_F(KittiSource, ReadsPairsTimesAndCalibration) {
  const Played played = play(spec(), std::nullopt);
  ASSERT_EQ(played.frames.size(), 3u) << played.error;
  EXPECT_EQ(played.camera->sensor, Sensor::kStereo);
  EXPECT_NEAR(played.camera->baseline_m, 37.6 / 70, 1e-12);
  EXPECT_EQ(played.camera->camera.intrinsics(), (std::array<double, 4>{70, 71, 40, 30}));
  EXPECT_EQ(played.frames[1].stamp_ns, 103735900);
  EXPECT_EQ(played.frames[2].gray.at<unsigned char>(5, 5), 12);
  EXPECT_EQ(played.frames[2].right.at<unsigned char>(5, 5), 22);
}

TEST_F(KittiSource, IsMonoWithoutTheRightImages) {
  fs::remove_all(folder_ / "image_1");
  const Played played = play(spec(), std::nullopt);
  ASSERT_EQ(played.frames.size(), 3u) << played.error;
  EXPECT_EQ(played.camera->sensor, Sensor::kMono);
}

TEST_F(KittiSource, SkipsAFrameWhoseRightImageIsMissing) {
  fs::remove(folder_ / "image_1/000001.png");
  const Played played = play(spec(), std::nullopt);
  EXPECT_EQ(played.frames.size(), 2u);
  EXPECT_EQ(played.skipped, 1u);
}

TEST_F(KittiSource, NamesWhatIsWrong) {
  write(folder_ / "times.txt", "0\n1\n");
  EXPECT_THAT(play(spec(), std::nullopt).error, HasSubstr("2 times for 3 images"));
  write(folder_ / "times.txt", "0\nsoon\n2\n");
  EXPECT_THAT(play(spec(), std::nullopt).error, HasSubstr("'soon' is no time"));
  write(folder_ / "calib.txt", "P0: 70 0 40\n");
  EXPECT_THAT(play(spec(), std::nullopt).error, HasSubstr("calib.txt"));
  EXPECT_THAT(play("kitti:/nowhere", std::nullopt).error, HasSubstr("/nowhere/image_0"));
}

CameraConfig mono_80x60() {
  CameraConfig config;
  config.sensor = Sensor::kMono;
  config.camera = Camera(LensModel::kPinhole, 80, 60, {70, 70, 40, 30}, {});
  config.rate_hz = 20;
  return config;
}

TEST_F(KittiSource, FolderSourcePlaysSingleImagesAtTheConfiguredRate) {
  const std::string folder = "folder:" + (folder_ / "image_0").string();
  const Played played = play(folder, mono_80x60());
  ASSERT_EQ(played.frames.size(), 3u) << played.error;
  EXPECT_EQ(played.frames[2].stamp_ns, 100'000'000);
  CameraConfig rgbd = mono_80x60();
  rgbd.sensor = Sensor::kRgbd;
  EXPECT_THAT(play(folder, rgbd).error, HasSubstr("sensor: mono"));
  EXPECT_THAT(play(folder, std::nullopt).error, HasSubstr("camera"));
}

TEST(FolderSource, SaysThatAFolderIsMissingOrEmpty) {
  const synthetic::TempFolder folder;
  EXPECT_THAT(play("folder:" + folder.path().string(), mono_80x60()).error,
              HasSubstr("holds no images"));
  EXPECT_THAT(play("folder:/nowhere", mono_80x60()).error, HasSubstr("/nowhere"));
}

TEST(VideoSource, PlaysAFileAndRefusesWhatIsNone) {
  const synthetic::TempFolder folder;
  const std::string file = (folder / "v.avi").string();
  {
    cv::VideoWriter writer(file, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 25, {80, 60});
    if (!writer.isOpened()) GTEST_SKIP() << "OpenCV here can't write videos";
    for (int i = 0; i < 5; ++i) writer.write(cv::Mat(60, 80, CV_8UC3, cv::Scalar::all(40 * i)));
  }
  const Played played = play("video:" + file, mono_80x60());
  ASSERT_EQ(played.frames.size(), 5u) << played.error;
  EXPECT_EQ(played.frames[2].stamp_ns, 80'000'000);
  EXPECT_EQ(played.frames[2].gray.type(), CV_8UC1);
  EXPECT_NEAR(played.frames[2].gray.at<unsigned char>(30, 40), 80, 3);
  write(folder / "no.avi", "no video");
  EXPECT_NE(play("video:" + (folder / "no.avi").string(), mono_80x60()).error, "");
  EXPECT_THAT(play("video:/nowhere.avi", mono_80x60()).error, HasSubstr("no such file"));
}

TEST(CameraSource, SaysThatThereIsNoCamera) {
  EXPECT_THAT(play("camera:97", mono_80x60()).error, HasSubstr("camera:97"));
  EXPECT_THAT(play("camera:front", mono_80x60()).error, HasSubstr("number"));
}

TEST(SynthSource, PlaysTheSequenceThatItsTextDescribes) {
  const std::string spec = "weak?frames=3&seed=5&path=1&width=160&height=120&rate=20";
  const Played played = play("synth:" + spec, std::nullopt);
  ASSERT_EQ(played.frames.size(), 3u) << played.error;
  const auto expected = make(*parse_synth_spec(spec, Sensor::kRgbd));
  EXPECT_EQ(played.frames[1].stamp_ns, expected->stamp_ns(1));
  EXPECT_TRUE(same(played.frames[1].gray, expected->frame(1).gray));
  EXPECT_TRUE(same(played.frames[1].depth, expected->frame(1).depth));
  EXPECT_EQ(played.camera->rate_hz, 20);
  EXPECT_EQ(played.camera->camera.width(), 160);
}

TEST(SynthSource, UnderstandsEveryKey) {
  const auto options = parse_synth_spec(
      "turn?sensor=stereo&blur=15&noise=0&depth_noise=1&start=2.5&focal=400&baseline=0.2&threads=2",
      Sensor::kRgbd);
  ASSERT_TRUE(options.ok()) << options.message();
  EXPECT_EQ(options->scene, "turn");
  EXPECT_EQ(options->sensor, Sensor::kStereo);
  EXPECT_EQ(options->exposure_s, 0.015);
  EXPECT_FALSE(options->noise);
  EXPECT_TRUE(options->depth_noise);
  EXPECT_EQ(options->start_s, 2.5);
  EXPECT_EQ(options->focal, 400);
  EXPECT_EQ(options->baseline_m, 0.2);
  EXPECT_EQ(options->threads, 2);
  const auto carried = parse_synth_spec("hall?black=60-120&jump=120:-7.5", Sensor::kRgbd);
  ASSERT_TRUE(carried.ok()) << carried.message();
  EXPECT_EQ(carried->black_from, 60);
  EXPECT_EQ(carried->black_until, 120);
  EXPECT_EQ(carried->jump_at, 120);
  EXPECT_EQ(carried->jump_s, -7.5);
  EXPECT_EQ(parse_synth_spec("desk?blur", Sensor::kMono)->exposure_s, 0.020);
  EXPECT_EQ(parse_synth_spec("desk?blur=0", Sensor::kMono)->exposure_s, 0.0);
  EXPECT_EQ(parse_synth_spec("desk", Sensor::kMono)->sensor, Sensor::kMono);
}

TEST(SynthSource, NamesUnknownKeysAndBadValues) {
  EXPECT_THAT(play("synth:desk?frame=3", std::nullopt).error, HasSubstr("unknown key 'frame'"));
  EXPECT_THAT(play("synth:desk?frame=3", std::nullopt).error, HasSubstr("frames, path, seed"));
  EXPECT_THAT(play("synth:desk?frames=three", std::nullopt).error, HasSubstr("'three'"));
  EXPECT_THAT(play("synth:desk?black=60", std::nullopt).error, HasSubstr("'60'"));
  EXPECT_THAT(play("synth:desk?jump=x:3", std::nullopt).error, HasSubstr("'x:3'"));
  EXPECT_THAT(play("synth:desk?black=9-3", std::nullopt).error, HasSubstr("black"));
  EXPECT_THAT(play("synth:desk?frames=-3", std::nullopt).error, HasSubstr("frames"));
  EXPECT_THAT(play("synth:attic", std::nullopt).error, HasSubstr("unknown scene 'attic'"));
}

TEST(SynthSource, StopsReadingAheadWhenItIsNoLongerWanted) {
  auto source = open_source("synth:textureless?width=160&height=120", std::nullopt);
  ASSERT_TRUE(source.ok());
  ASSERT_TRUE((*source)->next().ok());
  source->reset();  // with frames waiting and more to come: no hang
}

TEST(OpenSource, ListsTheKindsThereAre) {
  for (const char* spec : {"", "desk", "ftp:desk", "tum:", "tum"}) {
    EXPECT_THAT(play(spec, std::nullopt).error, HasSubstr("must be tum:DIR")) << spec;
  }
}

}  // namespace
}  // namespace cairn
