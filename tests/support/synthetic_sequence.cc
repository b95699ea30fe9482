#include "tests/support/synthetic_sequence.h"

#include <cmath>

#include <opencv2/core.hpp>

#include "common/util/clock.h"
#include "tests/support/random.h"

namespace cairn::synthetic {
namespace {

// Recordings begin at some moment of our days, as real ones do, not at zero.
constexpr std::int64_t kFirstStamp = 1'700'000'000 * kNanosPerSecond;

Status validate(const SequenceOptions& o) {
  const auto bad = [](const std::string& what) {
    return Status(ErrorCode::kInvalidArgument, what);
  };
  if (o.frames < 0) return bad("frames: must be 0 (once round) or more");
  if (!(o.rate_hz > 0 && o.rate_hz <= 1000)) return bad("rate: must be above 0, at most 1000 Hz");
  if (o.width < 16 || o.height < 16 || o.width > 8192 || o.height > 8192) {
    return bad("width, height: must be 16 to 8192 pixels");
  }
  if (!(o.focal > 0)) return bad("focal: must be above 0 pixels");
  if (!(o.baseline_m > 0)) return bad("baseline: must be above 0 m");
  if (o.exposure_s && !(*o.exposure_s >= 0 && *o.exposure_s <= 1)) {
    return bad("exposure: must be 0 to 1 s");
  }
  if (o.black_from < 0 || o.black_until < o.black_from || o.jump_at < 0)
    return bad("black, jump: frames must ascend and not be below 0");
  if (!std::isfinite(o.jump_s)) return bad("jump: must be a number of seconds");
  if (o.sub_exposures < 1 || o.sub_exposures > 100) return bad("sub-exposures: must be 1 to 100");
  return {};
}

Camera pinhole(const SequenceOptions& o) {
  const double focal = o.focal * o.width / 640.0;
  return Camera(LensModel::kPinhole, o.width, o.height,
                {focal, focal, (o.width - 1) / 2.0, (o.height - 1) / 2.0}, {});
}

}  // namespace

Result<std::shared_ptr<const SyntheticSequence>> SyntheticSequence::make(
    const SequenceOptions& options) {
  if (Status status = validate(options); !status.ok()) return status.error();
  auto trajectory = Trajectory::make(options.scene, options.path, options.seed);
  if (options.path < 0) return trajectory.error();
  auto scene = make_scene(options.scene, options.seed);
  if (!scene) return scene.error();  // says which scenes there are
  if (!trajectory) return trajectory.error();
  const Camera camera = options.camera.value_or(pinhole(options));
  return std::shared_ptr<const SyntheticSequence>(
      new SyntheticSequence(options, camera, *scene, *trajectory));
}

SyntheticSequence::SyntheticSequence(const SequenceOptions& options, Camera camera,
                                     std::shared_ptr<const Scene> scene,
                                     const Trajectory& trajectory)
    : options_(options),
      camera_(camera),
      scene_(std::move(scene)),
      trajectory_(trajectory),
      renderer_(scene_, camera_, options.threads),
      // Those who walk different paths of one scene have sensors of their own.
      noise_(derive_seed(options.seed, 1000 + static_cast<std::uint64_t>(options.path))),
      exposure_s_(options.exposure_s.value_or(options.scene == "turn" ? 0.020 : 0.0)),
      frames_(options.frames > 0
                  ? options.frames
                  : static_cast<int>(std::lround(trajectory_.period() * options.rate_hz))) {}

double SyntheticSequence::seconds(int index) const {
  return options_.start_s + index / options_.rate_hz;
}

std::int64_t SyntheticSequence::stamp_ns(int index) const {
  // Whole microseconds, which is what text files hold.
  return kFirstStamp + 1000 * std::llround(seconds(index) * 1e6);
}

double SyntheticSequence::seconds_along_path(int index) const {
  const bool jumped = options_.jump_at > 0 && index >= options_.jump_at;
  return seconds(index) + (jumped ? options_.jump_s : 0);
}

bool SyntheticSequence::is_black(int index) const {
  return index >= options_.black_from && index < options_.black_until;
}

Rigid3 SyntheticSequence::world_from_camera(int index) const {
  return trajectory_.world_from_camera(seconds_along_path(index));
}

cv::Mat SyntheticSequence::expose(int index, int camera, cv::Mat* depth) const {
  const Rigid3 left_from_camera(Eigen::Quaterniond::Identity(),
                                {camera == 0 ? 0.0 : options_.baseline_m, 0, 0});
  const int count = exposure_s_ > 0 ? options_.sub_exposures : 1;
  cv::Mat sum;
  for (int i = 0; i < count; ++i) {
    const double moment = seconds_along_path(index) + exposure_s_ * ((i + 0.5) / count - 0.5);
    const Rendering image =
        renderer_.render(trajectory_.world_from_camera(moment) * left_from_camera);
    if (depth != nullptr && i == count / 2) *depth = image.depth;
    if (sum.empty()) {
      sum = image.radiance;
    } else {
      sum += image.radiance;
    }
  }
  if (count > 1) sum *= 1.0 / count;
  return sum;
}

SyntheticFrame SyntheticSequence::frame(int index) const {
  SyntheticFrame frame;
  frame.stamp_ns = stamp_ns(index);
  frame.world_from_camera = world_from_camera(index);
  if (is_black(index)) {
    const auto blank = [&](int type) {
      return cv::Mat(camera_.height(), camera_.width(), type, cv::Scalar(0));
    };
    frame.gray = blank(CV_8UC1);
    if (options_.sensor == Sensor::kStereo) frame.right = blank(CV_8UC1);
    if (options_.sensor == Sensor::kRgbd) frame.depth = blank(CV_32FC1);
    return frame;
  }
  const int threads = options_.threads;
  const auto finish = [&](const cv::Mat& radiance, std::uint64_t camera) {
    const std::uint64_t key = 4 * static_cast<std::uint64_t>(index) + camera;
    return options_.noise ? noise_.gray(radiance, key, threads) : quantised(radiance);
  };
  const bool rgbd = options_.sensor == Sensor::kRgbd;
  cv::Mat depth;
  frame.gray = finish(expose(index, 0, rgbd ? &depth : nullptr), 0);
  if (options_.sensor == Sensor::kStereo) frame.right = finish(expose(index, 1, nullptr), 1);
  if (rgbd) {
    const std::uint64_t key = 4 * static_cast<std::uint64_t>(index) + 2;
    frame.depth =
        options_.depth_noise ? noise_.depth(depth, camera_.intrinsics()[0], key, threads) : depth;
  }
  return frame;
}

}  // namespace cairn::synthetic
