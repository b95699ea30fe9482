// Where images come from: a recording, a live camera, a rendered scene.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include <opencv2/core/mat.hpp>

#include "common/config/camera_config.h"
#include "common/util/status.h"

namespace cairn {

// One moment's images. Stereo pairs are rectified by the time they are here.
struct Frame {
  std::int64_t stamp_ns = 0;
  cv::Mat gray;   // CV_8UC1
  cv::Mat right;  // CV_8UC1, same size as gray; empty unless stereo
  cv::Mat depth;  // CV_32FC1, metres, 0 where unknown, same size as gray; empty unless RGB-D
};

// Used from one thread. Sources read ahead on their own threads where that saves time.
class FrameSource {
 public:
  virtual ~FrameSource() = default;

  // The camera that the frames are seen by: given by the user, or read from the data set, and for
  // raw stereo pairs the rectified one (no distortion, `baseline_m` set).
  virtual const CameraConfig& camera() const = 0;

  // The next frame; nothing at the end; an error when the source as a whole is broken. Images that
  // can't be read, or have another size than the camera says, are skipped, counted and logged once
  // each.
  virtual Result<std::optional<Frame>> next() = 0;

  // Frames skipped so far because they could not be used.
  virtual std::uint64_t skipped() const = 0;
  // How many frames there are in all, where that is known.
  virtual std::optional<std::uint64_t> size() const = 0;
  // Live sources deliver at their own pace; recordings can be read as fast as one likes.
  virtual bool is_live() const = 0;
};

// `spec` as on the command line: tum:DIR, euroc:DIR, kitti:DIR, folder:DIR, video:FILE, camera:N,
// synth:SCENE[?key=value&...]. `config` is the user's camera, where given; euroc, kitti and synth
// know their own. Sources that don't, say that a camera is missing from the config.
Result<std::unique_ptr<FrameSource>> open_source(const std::string& spec,
                                                 const std::optional<CameraConfig>& config);

}  // namespace cairn
