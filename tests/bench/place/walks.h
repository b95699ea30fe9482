// Walks through known places: what a client would have made keyframes of, and which of them truly
// show the same.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <opencv2/core/mat.hpp>

#include "common/geometry/camera.h"
#include "common/geometry/rigid3.h"
#include "common/model/features.h"

namespace cairn::bench {

struct View {
  double seconds = 0;
  Rigid3 world_from_camera;
  std::vector<Descriptor> descriptors;
  cv::Mat depth;  // CV_32FC1 metres, 0 unknown, every kDepthStep-th pixel

  static constexpr int kDepthStep = 8;
};

struct Walk {
  std::string name;
  PinholeCamera camera;
  std::vector<View> views;
};

// What share of one view's surface is in the other's sight, 0..1, the lesser of both directions.
double overlap(const PinholeCamera& camera, const View& a, const View& b);

// `frames` frames along path `path` of an embedded scene, every `step`-th of them taken.
Walk scene_walk(const std::string& scene, int path, int frames, int step);
// The recording sevenscenes_kitchen_400 of $CAIRN_DATA or ../shared/data; nothing where it is not.
std::optional<Walk> kitchen_walk(int step);
// Of the photographs that vocabularies are trained on, where they are.
std::string photos_folder();

}  // namespace cairn::bench
