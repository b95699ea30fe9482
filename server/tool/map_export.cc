#include "server/tool/map_export.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <unordered_map>

#include <fmt/format.h>
#include <fmt/ostream.h>
#include <nlohmann/json.hpp>

#include "common/util/clock.h"

namespace cairn {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kColmapPixelShift = 0.5;

std::string seconds_text(std::int64_t stamp_ns) {
  return fmt::format("{}.{:09d}", stamp_ns / kNanosPerSecond, stamp_ns % kNanosPerSecond);
}
std::string epoch_text(std::uint64_t epoch) {
  return fmt::format("{:016x}", epoch);
}
std::string id_text(const KeyframeId& id) {
  return epoch_text(id.epoch) + "/" + std::to_string(id.sequence);
}

// Distance in pixels between a feature and where its landmark projects; nothing behind the camera.
std::optional<double> reprojection_error(const KeyframeNode& node, std::uint16_t feature,
                                         const Eigen::Vector3d& position) {
  const Eigen::Vector3d in_camera = node.map_from_camera.inverse() * position;
  if (!(in_camera.z() > 0)) return std::nullopt;
  return (node.rig().camera.project(in_camera) - node.features().points[feature].pixel()).norm();
}

void add_landmarks(const Map& map, MapInfo& info) {
  double squared = 0;
  std::size_t projected = 0;
  Eigen::AlignedBox3d box;
  for (const LandmarkId& id : map.landmarks.sorted_keys()) {
    const Landmark& landmark = map.landmarks.at(id);
    box.extend(landmark.position);
    info.observations += landmark.observations.size();
    for (const Observation& seen : landmark.observations) {
      const KeyframeNode* node = map.keyframes.find(seen.keyframe);
      if (!node) continue;
      if (const auto error = reprojection_error(*node, seen.feature, landmark.position)) {
        squared += *error * *error;
        ++projected;
      }
    }
  }
  if (info.landmarks == 0) return;
  info.box_min = box.min();
  info.box_max = box.max();
  info.mean_observations =
      static_cast<double>(info.observations) / static_cast<double>(info.landmarks);
  if (projected > 0) info.reprojection_rmse = std::sqrt(squared / static_cast<double>(projected));
}

std::vector<std::uint64_t> epochs_of(const Map& map) {
  std::vector<std::uint64_t> epochs;
  for (const KeyframeId& id : map.keyframes.sorted_keys())
    if (epochs.empty() || epochs.back() != id.epoch) epochs.push_back(id.epoch);
  return epochs;
}

Json pose_json(const Rigid3& pose) {
  const auto& t = pose.translation;
  const auto& q = pose.rotation;
  return {{"position", {t.x(), t.y(), t.z()}}, {"quaternion_xyzw", {q.x(), q.y(), q.z(), q.w()}}};
}

Json loops_json(const MapInfo& info) {
  Json loops = Json::array();
  const auto keyframe = [&](const KeyframeId& id) {
    return Json{{"id", id_text(id)}, {"client", info.client_of(id.epoch)}};
  };
  for (const MapInfo::Loop& loop : info.loops) {
    Json entry = {{"event", loops.size() + 1},
                  {"kind", loop.merges ? "merge" : "loop"},
                  {"query", keyframe(loop.query)},
                  {"candidate", keyframe(loop.candidate)},
                  {"inliers", loop.inliers}};
    if (loop.can_undo) entry["can_undo"] = *loop.can_undo;
    loops.push_back(std::move(entry));
  }
  return loops;
}

Json info_json(const MapInfo& info) {
  Json runs = Json::array();
  for (const MapInfo::Run& run : info.runs)
    runs.push_back({{"epoch", epoch_text(run.epoch)},
                    {"client", info.client_of(run.epoch)},
                    {"keyframes", run.keyframes},
                    {"path_m", run.path_m},
                    {"duration_s", run.duration_s}});
  return {{"id", epoch_text(info.id)},
          {"revision", info.revision},
          {"merge_epoch", info.merge_epoch},
          {"keyframes", info.keyframes},
          {"landmarks", info.landmarks},
          {"observations", info.observations},
          {"reprojection_rmse_px", info.reprojection_rmse},
          {"runs", runs},
          {"loops", loops_json(info)}};
}

// COLMAP counts cameras, images and points from 1.
struct ColmapNumbers {
  std::vector<PinholeCamera> cameras;
  std::map<KeyframeId, std::pair<int, int>> images;  // image and camera number
  std::unordered_map<LandmarkId, int> points;

  explicit ColmapNumbers(const Map& map) {
    for (const KeyframeId& id : map.keyframes.sorted_keys()) {
      const PinholeCamera& camera = map.keyframes.at(id).rig().camera;
      auto at = std::find(cameras.begin(), cameras.end(), camera);
      if (at == cameras.end()) at = cameras.insert(cameras.end(), camera);
      const int image = static_cast<int>(images.size()) + 1;
      images[id] = {image, static_cast<int>(at - cameras.begin()) + 1};
    }
    for (const LandmarkId& id : map.landmarks.sorted_keys()) {
      const int point = static_cast<int>(points.size()) + 1;
      points[id] = point;
    }
  }
};

Status write_file(const std::filesystem::path& path,
                  const std::function<void(std::ostream&)>& write) {
  std::ofstream out(path);
  if (out) write(out);
  out.flush();
  if (!out) return {ErrorCode::kUnavailable, path.string() + ": can't be written"};
  return {};
}

}  // namespace

MapInfo info_of(const Map& map) {
  MapInfo info;
  info.id = map.id.value;
  info.revision = map.revision;
  info.merge_epoch = map.merge_epoch;
  info.keyframes = map.keyframes.size();
  info.landmarks = map.landmarks.size();
  for (const std::uint64_t epoch : epochs_of(map)) {
    const Trajectory poses = keyframe_trajectory(map, epoch);
    MapInfo::Run run;
    run.epoch = epoch;
    run.keyframes = poses.size();
    for (std::size_t i = 1; i < poses.size(); ++i)
      run.path_m +=
          (poses[i].world_from_camera.origin() - poses[i - 1].world_from_camera.origin()).norm();
    run.duration_s = to_seconds(poses.back().stamp_ns - poses.front().stamp_ns);
    info.runs.push_back(run);
  }
  for (const LoopEdge& edge : map.loops)
    info.loops.push_back({edge.merges, edge.query, edge.candidate, edge.inliers, std::nullopt});
  add_landmarks(map, info);
  return info;
}

std::string MapInfo::client_of(std::uint64_t epoch) const {
  const auto run =
      std::find_if(runs.begin(), runs.end(), [&](const Run& r) { return r.epoch == epoch; });
  return run == runs.end() || run->client.empty() ? "?" : run->client;
}

void write_info_json(const MapInfo& info, std::ostream& out) {
  out << info_json(info).dump(1) << '\n';
}

Trajectory keyframe_trajectory(const Map& map, std::uint64_t epoch) {
  Trajectory out;
  map.keyframes.for_each([&](const KeyframeId& id, const KeyframeNode& node) {
    if (id.epoch == epoch) out.push_back({node.keyframe->stamp_ns, node.map_from_camera});
  });
  std::sort(out.begin(), out.end(),
            [](const auto& a, const auto& b) { return a.stamp_ns < b.stamp_ns; });
  return out;
}

void write_tum(const Map& map, std::ostream& out) {
  for (const std::uint64_t epoch : epochs_of(map)) {
    out << "# client run " << epoch_text(epoch) << ": timestamp tx ty tz qx qy qz qw\n";
    for (const StampedPose& pose : keyframe_trajectory(map, epoch)) out << tum_line(pose) << '\n';
  }
}

void write_ply(const Map& map, std::ostream& out) {
  fmt::print(out,
             "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\n"
             "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
             "end_header\n",
             map.landmarks.size() + map.keyframes.size());
  const auto vertex = [&](const Eigen::Vector3d& p, const char* colour) {
    fmt::print(out, "{:.4f} {:.4f} {:.4f} {}\n", p.x(), p.y(), p.z(), colour);
  };
  for (const LandmarkId& id : map.landmarks.sorted_keys())
    vertex(map.landmarks.at(id).position, "190 190 190");
  for (const KeyframeId& id : map.keyframes.sorted_keys())
    vertex(map.keyframes.at(id).map_from_camera.origin(), "220 40 40");
}

void write_json(const Map& map, const MapInfo& info, std::ostream& out) {
  Json keyframes = Json::array(), landmarks = Json::array();
  for (const KeyframeId& id : map.keyframes.sorted_keys()) {
    const KeyframeNode& node = map.keyframes.at(id);
    Json entry = {{"id", id_text(id)}, {"stamp_ns", node.keyframe->stamp_ns}};
    entry["map_from_camera"] = pose_json(node.map_from_camera);
    if (node.parent.is_valid()) entry["parent"] = id_text(node.parent);
    keyframes.push_back(std::move(entry));
  }
  for (const LandmarkId& id : map.landmarks.sorted_keys()) {
    const Landmark& landmark = map.landmarks.at(id);
    const auto& p = landmark.position;
    Json seen = Json::array();
    for (const Observation& o : landmark.observations)
      seen.push_back({id_text(o.keyframe), o.feature});
    landmarks.push_back({{"id", epoch_text(id.origin) + "/" + std::to_string(id.number)},
                         {"position", {p.x(), p.y(), p.z()}},
                         {"observations", std::move(seen)}});
  }
  const Json document = {{"info", info_json(info)},
                         {"keyframes", std::move(keyframes)},
                         {"landmarks", std::move(landmarks)}};
  out << document.dump(1) << '\n';
}

void write_colmap_cameras(const Map& map, std::ostream& out) {
  const ColmapNumbers numbers(map);
  out << "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n";
  for (std::size_t i = 0; i < numbers.cameras.size(); ++i) {
    const PinholeCamera& c = numbers.cameras[i];
    fmt::print(out, "{} PINHOLE {} {} {:.6f} {:.6f} {:.6f} {:.6f}\n", i + 1, c.width, c.height,
               c.fx, c.fy, c.cx + kColmapPixelShift, c.cy + kColmapPixelShift);
  }
}

void write_colmap_images(const Map& map, std::ostream& out) {
  const ColmapNumbers numbers(map);
  out << "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"
         "# POINTS2D[] as (X, Y, POINT3D_ID)\n";
  for (const auto& [id, number] : numbers.images) {
    const KeyframeNode& node = map.keyframes.at(id);
    const Rigid3 pose = node.map_from_camera.inverse();
    const auto& q = pose.rotation;
    const auto& t = pose.translation;
    fmt::print(out, "{} {:.9f} {:.9f} {:.9f} {:.9f} {:.7f} {:.7f} {:.7f} {} {}/{}.png\n",
               number.first, q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z(), number.second,
               epoch_text(id.epoch), seconds_text(node.keyframe->stamp_ns));
    const auto& points = node.features().points;
    for (std::size_t f = 0; f < points.size(); ++f) {
      const auto seen =
          f < node.landmarks.size() ? numbers.points.find(node.landmarks[f]) : numbers.points.end();
      fmt::print(out, "{}{:.3f} {:.3f} {}", f == 0 ? "" : " ", points[f].x + kColmapPixelShift,
                 points[f].y + kColmapPixelShift, seen == numbers.points.end() ? -1 : seen->second);
    }
    out << '\n';
  }
}

void write_colmap_points(const Map& map, std::ostream& out) {
  const ColmapNumbers numbers(map);
  out << "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n";
  for (const LandmarkId& id : map.landmarks.sorted_keys()) {
    const Landmark& landmark = map.landmarks.at(id);
    std::string track;
    double error_sum = 0;
    int errors = 0;
    for (const Observation& seen : landmark.observations) {
      const auto image = numbers.images.find(seen.keyframe);
      if (image == numbers.images.end()) continue;
      track += fmt::format(" {} {}", image->second.first, seen.feature);
      const KeyframeNode& node = map.keyframes.at(seen.keyframe);
      if (const auto error = reprojection_error(node, seen.feature, landmark.position)) {
        error_sum += *error;
        ++errors;
      }
    }
    const auto& p = landmark.position;
    fmt::print(out, "{} {:.6f} {:.6f} {:.6f} 190 190 190 {:.4f}{}\n", numbers.points.at(id), p.x(),
               p.y(), p.z(), errors > 0 ? error_sum / errors : 0.0, track);
  }
}

Status export_map(const Map& map, const MapInfo& info, MapFormat format, const std::string& path) {
  const auto of_map = [&map](void (*write)(const Map&, std::ostream&)) {
    return [&map, write](std::ostream& out) { write(map, out); };
  };
  switch (format) {
    case MapFormat::kTum:
      return write_file(path, of_map(write_tum));
    case MapFormat::kPly:
      return write_file(path, of_map(write_ply));
    case MapFormat::kJson:
      return write_file(path, [&](std::ostream& out) { write_json(map, info, out); });
    case MapFormat::kColmap:
      break;
  }
  const std::filesystem::path folder(path);
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) return {ErrorCode::kUnavailable, path + ": can't be made: " + error.message()};
  Status status = write_file(folder / "cameras.txt", of_map(write_colmap_cameras));
  if (status) status = write_file(folder / "images.txt", of_map(write_colmap_images));
  if (status) status = write_file(folder / "points3D.txt", of_map(write_colmap_points));
  return status;
}

}  // namespace cairn
