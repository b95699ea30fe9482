#include "tests/bench/paper/views.h"

#include <algorithm>
#include <cmath>

#include <opencv2/imgproc.hpp>

#include "client/capture/image_reader.h"
#include "client/capture/recordings.h"
#include "common/model/trajectory.h"
#include "common/util/clock.h"
#include "tests/bench/paper/data_sets.h"
#include "tests/support/random.h"
#include "tests/support/renderer.h"
#include "tests/support/sensor_noise.h"
#include "tests/support/trajectory.h"

namespace cairn::bench {
namespace {

using synthetic::Random;

constexpr double kRadians = M_PI / 180;
constexpr double kExposure = 0.020;  // seconds
constexpr int kSubExposures = 15;
constexpr std::uint64_t kSeed = 1;

// A camera in an embedded scene that turns while it takes a picture.
class TurningCamera {
 public:
  static Result<TurningCamera> make(const std::string& scene) {
    auto painted = synthetic::make_scene(scene, kSeed);
    if (!painted) return painted.error();
    auto path = synthetic::Trajectory::make(scene, 0, kSeed);
    if (!path) return path.error();
    return TurningCamera(*painted, *path);
  }

  const Camera& camera() const { return camera_; }
  const synthetic::Trajectory& path() const { return path_; }

  // `turn`: radians a second about the camera's own axes.
  View take(const Rigid3& world_from_camera, const Eigen::Vector3d& turn) {
    View view{{}, {}, world_from_camera, turn.norm()};
    cv::Mat sum;
    const int count = turn.norm() > 1e-6 ? kSubExposures : 1;
    for (int i = 0; i < count; ++i) {
      const double seconds = kExposure * ((i + 0.5) / count - 0.5);
      const Rigid3 turned(so3_exp(turn * seconds), Eigen::Vector3d::Zero());
      const synthetic::Rendering image = renderer_.render(world_from_camera * turned);
      if (i == count / 2) view.depth = image.depth;
      sum = sum.empty() ? image.radiance : cv::Mat(sum + image.radiance);
    }
    view.gray = noise_.gray(sum / count, taken_++, /*threads=*/2);
    return view;
  }

 private:
  TurningCamera(std::shared_ptr<const synthetic::Scene> scene, const synthetic::Trajectory& path)
      : camera_(LensModel::kPinhole, 640, 480, {525, 525, 319.5, 239.5}, {}),
        path_(path),
        renderer_(std::move(scene), camera_, /*threads=*/2),
        noise_(kSeed) {}

  Camera camera_;
  synthetic::Trajectory path_;
  synthetic::Renderer renderer_;
  synthetic::SensorNoise noise_;
  std::uint64_t taken_ = 0;
};

// About a random axis.
Eigen::Vector3d random_turn(Random& random) {
  const Eigen::Vector3d axis(random.normal(), random.normal(), random.normal());
  return axis.normalized() * random.uniform(0.5, 1.5);
}

Eigen::Quaterniond random_rotation(Random& random) {
  const double side = random.chance(0.5) ? 1 : -1;
  return so3_exp({random.uniform(-8, 8) * kRadians, random.uniform(-8, 8) * kRadians, 0}) *
         so3_exp({0, 0, side * random.uniform(20, 60) * kRadians});
}

// Interpolated; the nearest at the ends.
Rigid3 pose_at(const Trajectory& truth, std::int64_t stamp_ns) {
  const auto after =
      std::lower_bound(truth.begin(), truth.end(), stamp_ns,
                       [](const StampedPose& p, std::int64_t s) { return p.stamp_ns < s; });
  if (after == truth.begin()) return after->world_from_camera;
  const auto before = std::prev(after);
  if (after == truth.end()) return before->world_from_camera;
  const double share = static_cast<double>(stamp_ns - before->stamp_ns) /
                       static_cast<double>(after->stamp_ns - before->stamp_ns);
  return interpolate(before->world_from_camera, after->world_from_camera, share);
}

double angle_between(const Rigid3& a, const Rigid3& b) {
  return rotation_angle(a.inverse() * b);
}

double turn_rate(const Trajectory& truth, std::int64_t stamp_ns) {
  constexpr std::int64_t kReach = kNanosPerSecond / 60;
  return angle_between(pose_at(truth, stamp_ns - kReach), pose_at(truth, stamp_ns + kReach)) * 30;
}

}  // namespace

Result<ViewSet> rotated_pairs(const std::string& scene, int count) {
  auto camera = TurningCamera::make(scene);
  if (!camera) return camera.error();
  Random random(77);
  ViewSet set{scene + "_rotated",
              "embedded scene `" + scene + "`, rotated and blurred",
              camera->camera(),
              3,
              {},
              {}};
  for (int i = 0; i < count; ++i) {
    const Rigid3 first = camera->path().world_from_camera(camera->path().period() * i / count);
    const Rigid3 turned(random_rotation(random), Eigen::Vector3d::Zero());
    set.pairs.emplace_back(set.views.size(), set.views.size() + 1);
    set.views.push_back(camera->take(first, random_turn(random)));
    set.views.push_back(camera->take(first * turned, random_turn(random)));
  }
  return set;
}

Result<ViewSet> sharp_to_blurred(const std::string& scene, int count) {
  auto camera = TurningCamera::make(scene);
  if (!camera) return camera.error();
  ViewSet set{
      scene + "_accelerating", "embedded scene `" + scene + "`", camera->camera(), 3, {}, {}};
  const Rigid3 start = camera->path().world_from_camera(0);
  double yaw = 0;
  for (int i = 0; i < count; ++i) {
    const double rate = 2.5 * i / (count - 1);
    const Rigid3 turned(so3_exp({0, yaw, 0}), Eigen::Vector3d::Zero());
    if (i > 0) set.pairs.emplace_back(set.views.size() - 1, set.views.size());
    set.views.push_back(camera->take(start * turned, {0, rate, 0}));
    yaw += rate / 30;
  }
  return set;
}

Result<ViewSet> adjacent_frames(const std::filesystem::path& folder, const std::string& title) {
  auto camera = recording_camera();
  if (!camera) return camera.error();
  CameraConfig config;
  config.camera = *camera;
  auto recording = read_tum(folder, config);
  if (!recording) return recording.error();
  auto truth = read_trajectory((folder / "groundtruth.txt").string());
  if (!truth) return truth.error();
  // The motion capture is off by up to a degree and a centimetre against the images.
  ViewSet set{folder.filename().string(), title, *camera, 10, {}, {}};
  for (const FrameFiles& files : recording->frames) {
    auto gray = read_gray(files.gray, {camera->width(), camera->height()});
    if (!gray) return gray.error();
    auto depth = read_depth(files.depth, {camera->width(), camera->height()}, config.depth_scale);
    if (!depth) return depth.error();
    if (!set.views.empty()) set.pairs.emplace_back(set.views.size() - 1, set.views.size());
    set.views.push_back(
        {*gray, *depth, pose_at(*truth, files.stamp_ns), turn_rate(*truth, files.stamp_ns)});
  }
  return set;
}

ViewSet rotated_pairs(const ViewSet& recording, std::size_t count) {
  ViewSet set = recording;
  set.name += "_rotated";
  set.title += ", rotated and blurred";
  set.pairs.clear();
  std::vector<double> rates;
  for (const View& view : set.views) rates.push_back(view.turn_rate);
  const auto middle = rates.begin() + static_cast<std::ptrdiff_t>(rates.size() / 2);
  std::nth_element(rates.begin(), middle, rates.end());
  const double fast = rates.empty() ? 0 : *middle;
  std::vector<std::pair<std::size_t, std::size_t>> all;
  for (std::size_t i = 0; i < set.views.size(); ++i)
    for (std::size_t j = i + 1; j < set.views.size(); ++j) {
      const View &a = set.views[i], &b = set.views[j];
      const double angle = angle_between(a.world_from_camera, b.world_from_camera) / kRadians;
      if (std::min(a.turn_rate, b.turn_rate) > fast && angle >= 10 && angle <= 30)
        all.emplace_back(i, j);
    }
  const std::size_t taken = std::min(count, all.size());
  for (std::size_t i = 0; i < taken; ++i) set.pairs.push_back(all[i * all.size() / taken]);
  return set;
}

}  // namespace cairn::bench
