// Views of a scene whose geometry is known, and which of them are to be matched.
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "common/geometry/camera.h"
#include "common/geometry/rigid3.h"
#include "common/util/status.h"

namespace cairn::bench {

struct View {
  cv::Mat gray;   // CV_8UC1
  cv::Mat depth;  // CV_32FC1 metres, 0 unknown
  Rigid3 world_from_camera;
  double turn_rate = 0;  // radians a second while it was taken: what blurs it
};

struct ViewSet {
  std::string name, title;
  Camera camera;
  // Pixels by which a correct match may miss where the truth puts it: what localisation, and in
  // recordings the truth itself, leave uncertain.
  double tolerance = 3;
  std::vector<View> views;
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
};

// Pairs of views of an embedded scene: turned by 20 to 60 degrees about the line of sight and up to
// 8 about the others, both blurred by a turn of 0.5 to 1.5 rad/s during an exposure of 20 ms.
Result<ViewSet> rotated_pairs(const std::string& scene, int count);

// Adjacent views, 30 a second, of a camera in an embedded scene that turns ever faster, from rest
// to 2.5 rad/s, exposed for 20 ms each.
Result<ViewSet> sharp_to_blurred(const std::string& scene, int count);

// A recording in TUM layout with ground truth: all adjacent frames are pairs.
Result<ViewSet> adjacent_frames(const std::filesystem::path& folder, const std::string& title);

// Of the views of a recording: at most `count` pairs that are 10 to 30 degrees apart and both taken
// while the camera turned faster than in half of the recording.
ViewSet rotated_pairs(const ViewSet& recording, std::size_t count);

}  // namespace cairn::bench
