#include "client/client_config.h"

#include "common/config/camera_config_reader.h"
#include "common/config/yaml_reader.h"
#include "common/util/log.h"

namespace cairn {
namespace {

void read_entropy(Section section, EntropyOptions& entropy) {
  entropy.mode = section.choice_or<EntropyMode>("mode", entropy.mode,
                                                {{"off", EntropyMode::kOff},
                                                 {"online", EntropyMode::kOnline},
                                                 {"calibrated", EntropyMode::kCalibrated},
                                                 {"fixed", EntropyMode::kFixed}});
  entropy.variant = section.choice_or<EntropyVariant>(
      "entropy", entropy.variant,
      {{"histogram", EntropyVariant::kHistogram}, {"shares", EntropyVariant::kShares}});
  entropy.block = static_cast<int>(section.integer_or("block", entropy.block, {8, 1024}));
  entropy.delta = section.number_or("delta", entropy.delta, {-8, 8});
  entropy.min_threshold = section.number_or("min_threshold", entropy.min_threshold, {0, 32});
  if (entropy.mode == EntropyMode::kCalibrated)
    entropy.scene_mean = section.number("scene_mean", {0, 32});
  if (entropy.mode == EntropyMode::kFixed)
    entropy.fixed_threshold = section.number("threshold", {0, 32});
}

void read_frontend(Section section, FrontendOptions& frontend) {
  ExtractorOptions& extractor = frontend.extractor;
  extractor.features =
      static_cast<int>(section.integer_or("features", extractor.features, {50, 10000}));
  extractor.pyramid.levels =
      static_cast<std::uint8_t>(section.integer_or("levels", extractor.pyramid.levels, {1, 16}));
  extractor.pyramid.factor =
      static_cast<float>(section.number_or("factor", extractor.pyramid.factor, {1.05, 2}));
  frontend.threads = static_cast<int>(section.integer_or("threads", frontend.threads, {1, 2}));
  frontend.depth_error_m = section.number_or("depth_error_m", frontend.depth_error_m, {0.005, 1});
  frontend.max_depth_m = section.number_or("max_depth_m", frontend.max_depth_m, {0.1, 1000});
  frontend.max_depth_baselines =
      section.number_or("max_depth_baselines", frontend.max_depth_baselines, {1, 1000});
  if (auto sharpen = section.optional_section("sharpen")) {
    read_entropy(*sharpen, extractor.entropy);
    if (sharpen->flag_or("as_in_paper", false)) extractor = as_in_paper(extractor);
  }
}

void read_tracking(Section section, TrackerOptions& tracker) {
  const auto count = [&](const char* key, int fallback, std::int64_t min, std::int64_t max) {
    return static_cast<int>(section.integer_or(key, fallback, {min, max}));
  };
  // Without the key each kind of sensor has its own default, here and below.
  if (section.has("min_inliers"))
    tracker.min_inliers = tracker.min_inliers_mono = count("min_inliers", 0, 6, 1000);
  tracker.min_inliers_after_loss =
      count("min_inliers_after_loss", tracker.min_inliers_after_loss, 6, 1000);
  tracker.lost.new_part_after_s =
      section.number_or("new_part_after_s", tracker.lost.new_part_after_s, {0.1, 1e6});
  tracker.min_start_features = count("min_start_features", tracker.min_start_features, 10, 10000);
  tracker.landmarks_per_keyframe =
      count("landmarks_per_keyframe", tracker.landmarks_per_keyframe, 50, 10000);
  tracker.min_new_landmarks = count("min_new_landmarks", tracker.min_new_landmarks, 0, 10000);
  tracker.last_frame_radius =
      section.number_or("last_frame_radius", tracker.last_frame_radius, {1, 200});
  tracker.local_map_radius =
      section.number_or("local_map_radius", tracker.local_map_radius, {0.1, 20});
  tracker.local_keyframes = static_cast<std::size_t>(
      count("local_keyframes", static_cast<int>(tracker.local_keyframes), 1, 1000));
  KeyframePolicyOptions& policy = tracker.keyframes;
  policy.max_frames_between = count("keyframe_max_frames", policy.max_frames_between, 1, 10000);
  policy.min_frames_between = count("keyframe_min_frames", policy.min_frames_between, 0, 10000);
  if (section.has("keyframe_min_shared"))
    policy.min_shared = policy.min_shared_mono = section.number("keyframe_min_shared", {0, 1});
}

}  // namespace

Result<ClientConfig> load_client_config(const std::string& path) {
  Result<Section> loaded = load_yaml(path);
  if (!loaded) return loaded.error();
  Section root = *loaded;
  ClientConfig config;
  if (root.has("camera")) {
    Result<CameraConfig> camera = read_camera_config(root);
    if (!camera) return camera.error();
    config.camera = *camera;
  } else {
    read_sensor(root);  // the source decides; asked for so that it does not count as unused
  }
  if (auto section = root.optional_section("frontend")) read_frontend(*section, config.frontend);
  if (auto section = root.optional_section("tracking")) read_tracking(*section, config.tracker);
  config.domain = static_cast<std::uint32_t>(root.integer_or("domain", config.domain, {0, 232}));
  config.partition = root.text_or("partition", config.partition);
  config.log_level = root.text_or("log_level", config.log_level);
  if (Status known = log::check_level(config.log_level); !known)
    root.fail("log_level", known.message());
  if (Status done = root.finish(); !done) return done.error();
  return config;
}

}  // namespace cairn
