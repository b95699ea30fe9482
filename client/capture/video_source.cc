#include "client/capture/video_source.h"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <initializer_list>

#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include "client/capture/read_ahead.h"
#include "client/capture/recordings.h"
#include "common/util/log.h"

namespace cairn {
namespace {

Status check_mono(const std::string& source, const std::optional<CameraConfig>& config) {
  if (!config) return camera_missing(source);
  if (config->sensor != Sensor::kMono) {
    return {ErrorCode::kInvalidArgument, source + ": has one image at a time; set sensor: mono"};
  }
  return {};
}

// Colour or grey -> grey of the camera's size, or why not.
Result<cv::Mat> to_gray(const cv::Mat& image, const Camera& camera, const std::string& name) {
  if (image.cols != camera.width() || image.rows != camera.height()) {
    return {ErrorCode::kInvalidArgument,
            name + ": is " + std::to_string(image.cols) + "x" + std::to_string(image.rows) +
                ", the camera in the config " + std::to_string(camera.width()) + "x" +
                std::to_string(camera.height())};
  }
  cv::Mat gray;
  if (image.channels() == 1) {
    gray = image.clone();
  } else {
    cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  }
  return gray;
}

// Named back ends only: left to itself OpenCV asks every one it has, down to photo cameras on USB,
// and that takes half a second and leaks.
bool try_open(cv::VideoCapture& capture, const auto& what,
              std::initializer_list<cv::VideoCaptureAPIs> back_ends) {
  // Each back end would print what it lacks.
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  try {
    return std::any_of(back_ends.begin(), back_ends.end(),
                       [&](auto back_end) { return capture.open(what, back_end); });
  } catch (const cv::Exception&) {
    return false;
  }
}

class LiveCamera final : public FrameSource {
 public:
  LiveCamera(std::string name, const cv::VideoCapture& capture, const CameraConfig& camera)
      : name_(std::move(name)), capture_(capture), camera_(camera) {}

  const CameraConfig& camera() const override { return camera_; }
  std::uint64_t skipped() const override { return skipped_; }
  std::optional<std::uint64_t> size() const override { return std::nullopt; }
  bool is_live() const override { return true; }

  Result<std::optional<Frame>> next() override {
    for (;;) {
      cv::Mat image;
      bool arrived = false;
      try {
        arrived = capture_.read(image);
      } catch (const cv::Exception&) {
        arrived = false;
      }
      if (!arrived) return {ErrorCode::kUnavailable, name_ + ": gives no more images"};
      const auto now = std::chrono::system_clock::now().time_since_epoch();
      auto gray = to_gray(image, camera_.camera, name_);
      // The first image decides: a camera does not change its size by itself.
      if (!gray && delivered_ == 0) return gray.error();
      if (!gray) {
        log::warn("frame skipped: {}", gray.message());
        ++skipped_;
        continue;
      }
      ++delivered_;
      Frame frame;
      frame.stamp_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
      frame.gray = *gray;
      return std::optional(std::move(frame));
    }
  }

 private:
  std::string name_;
  cv::VideoCapture capture_;
  CameraConfig camera_;
  std::uint64_t skipped_ = 0, delivered_ = 0;
};

}  // namespace

Result<std::unique_ptr<FrameSource>> open_video(const std::string& file,
                                                const std::optional<CameraConfig>& config) {
  const std::string name = "video:" + file;
  if (!std::filesystem::exists(file)) return {ErrorCode::kNotFound, file + ": no such file"};
  if (Status status = check_mono(name, config); !status) return status.error();
  auto capture = std::make_shared<cv::VideoCapture>();
  if (!try_open(*capture, file, {cv::CAP_FFMPEG, cv::CAP_GSTREAMER, cv::CAP_OPENCV_MJPEG})) {
    return {ErrorCode::kCorrupt, file + ": is no video that OpenCV can read"};
  }
  const double own_rate = capture->get(cv::CAP_PROP_FPS);
  const double rate = own_rate > 0.1 && own_rate < 1e4 ? own_rate : config->rate_hz;
  const double count = capture->get(cv::CAP_PROP_FRAME_COUNT);
  CameraConfig camera = *config;
  camera.rate_hz = rate;
  auto produce = [capture, rate, name, lens = camera.camera, index = 0]() mutable -> Produced {
    cv::Mat image;
    if (!capture->read(image)) return EndOfFrames{};
    Frame frame;
    frame.stamp_ns = std::llround(index++ / rate * 1e9);
    auto gray = to_gray(image, lens, name);
    if (!gray) return Skipped{gray.message()};
    frame.gray = *gray;
    return frame;
  };
  std::optional<std::uint64_t> size;
  if (count > 0) size = static_cast<std::uint64_t>(count);
  return std::unique_ptr<FrameSource>(
      std::make_unique<ReadAhead>(name, camera, size, std::move(produce)));
}

Result<std::unique_ptr<FrameSource>> open_camera(const std::string& number,
                                                 const std::optional<CameraConfig>& config) {
  const std::string name = "camera:" + number;
  int index = -1;
  const char* end = number.data() + number.size();
  if (std::from_chars(number.data(), end, index).ptr != end || number.empty() || index < 0) {
    return {ErrorCode::kInvalidArgument,
            name + ": needs the camera's number, for example camera:0"};
  }
  if (Status status = check_mono(name, config); !status) return status.error();
  cv::VideoCapture capture;
  if (!try_open(capture, index, {cv::CAP_V4L2})) {
    return {ErrorCode::kUnavailable,
            name + ": can't be opened; is it connected, and /dev/video" + number + " readable?"};
  }
  capture.set(cv::CAP_PROP_FRAME_WIDTH, config->camera.width());
  capture.set(cv::CAP_PROP_FRAME_HEIGHT, config->camera.height());
  capture.set(cv::CAP_PROP_FPS, config->rate_hz);
  return std::unique_ptr<FrameSource>(std::make_unique<LiveCamera>(name, capture, *config));
}

}  // namespace cairn
