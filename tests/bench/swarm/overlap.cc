#include "tests/bench/swarm/overlap.h"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <numeric>
#include <unordered_map>

namespace cairn::bench {
namespace {

struct View {
  std::size_t client;
  WallTime sent;
  const Keyframe* keyframe;
  Rigid3 world_from_camera;
  std::vector<Eigen::Vector3d> points;  // some of what it shows, in world
};

std::vector<Eigen::Vector3d> some_points(const Keyframe& keyframe,
                                         const Rigid3& world_from_camera) {
  constexpr std::size_t kEach = 15;  // feature
  const PinholeCamera& camera = keyframe.rig->camera;
  std::vector<Eigen::Vector3d> points;
  for (std::size_t f = 0; f < keyframe.features.size(); f += kEach) {
    const Feature& feature = keyframe.features.points[f];
    if (feature.has_depth())
      points.push_back(world_from_camera *
                       camera.unproject(feature.pixel(), camera.depth(feature.disparity)));
  }
  return points;
}

double share_seen(const View& from, const View& by) {
  constexpr double kLeastCosine = 0.9;  // 25 degrees
  const PinholeCamera& camera = by.keyframe->rig->camera;
  const Rigid3 camera_from_world = by.world_from_camera.inverse();
  int seen = 0;
  for (const Eigen::Vector3d& point : from.points) {
    const Eigen::Vector3d p = camera_from_world * point;
    if (p.z() < 0.1) continue;
    const Eigen::Vector2d pixel = camera.project(p);
    const bool inside =
        pixel.x() >= 0 && pixel.y() >= 0 && pixel.x() < camera.width && pixel.y() < camera.height;
    const Eigen::Vector3d here = (point - from.world_from_camera.translation).normalized(),
                          there = (point - by.world_from_camera.translation).normalized();
    seen += inside && here.dot(there) > kLeastCosine;
  }
  return from.points.empty() ? 0
                             : static_cast<double>(seen) / static_cast<double>(from.points.size());
}

bool overlap(const View& a, const View& b) {
  constexpr double kShare = 0.6;
  return share_seen(a, b) >= kShare && share_seen(b, a) >= kShare;
}

std::vector<View> views_in_order(const std::vector<RecordedWalk>& walks,
                                 const std::vector<ReplayResult>& results) {
  std::vector<View> views;
  for (std::size_t i = 0; i < walks.size(); ++i) {
    std::unordered_map<std::int64_t, Rigid3> truth;
    for (const auto& pose : walks[i].truth) truth[pose.stamp_ns] = pose.world_from_camera;
    for (const KeyframePtr& keyframe : walks[i].keyframes) {
      const auto sent = results[i].sent.find(keyframe->id);
      const auto pose = truth.find(keyframe->stamp_ns);
      if (sent != results[i].sent.end() && pose != truth.end())
        views.push_back(
            {i, sent->second, keyframe.get(), pose->second, some_points(*keyframe, pose->second)});
    }
  }
  std::sort(views.begin(), views.end(),
            [](const View& a, const View& b) { return a.sent < b.sent; });
  return views;
}

}  // namespace

Meetings find_meetings(const std::vector<RecordedWalk>& walks,
                       const std::vector<ReplayResult>& results) {
  std::vector<std::size_t> group(walks.size());
  std::iota(group.begin(), group.end(), 0);
  std::size_t groups = walks.size();
  Meetings meetings;
  const std::vector<View> views = views_in_order(walks, results);
  for (std::size_t i = 0; i < views.size() && groups > 1; ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const std::size_t a = group[views[i].client], b = group[views[j].client];
      if (a == b || !overlap(views[i], views[j])) continue;
      std::replace(group.begin(), group.end(), a, b);
      --groups;
      if (!meetings.first) meetings.first = views[i].sent;
      if (groups == 1) meetings.all = views[i].sent;
    }
  }
  return meetings;
}

std::vector<WallTime> merges_in(const std::string& log) {
  std::vector<WallTime> merges;
  for (auto at = log.find("parts merged"); at != std::string::npos;
       at = log.find("parts merged", at + 1)) {
    const auto line = log.rfind('\n', at) + 1;  // which begins with the time, to milliseconds
    std::tm utc{};
    if (!strptime(log.substr(line, 19).c_str(), "%Y-%m-%dT%H:%M:%S", &utc)) continue;
    merges.push_back(std::chrono::system_clock::from_time_t(timegm(&utc)) +
                     std::chrono::milliseconds(std::stoi(log.substr(line + 20, 3))));
  }
  return merges;
}

}  // namespace cairn::bench
