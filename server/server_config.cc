#include "server/server_config.h"

#include "common/config/yaml_reader.h"
#include "common/util/log.h"

namespace cairn {

Result<ServerConfig> load_server_config(const std::string& path) {
  Result<Section> loaded = load_yaml(path);
  if (!loaded) return loaded.error();
  Section root = *loaded;
  ServerConfig config;
  config.domain = static_cast<std::uint32_t>(root.integer_or("domain", config.domain, {0, 232}));
  config.partition = root.text_or("partition", config.partition);
  config.map_file = root.text_or("map_file", config.map_file);
  config.http = root.text_or("http", config.http);
  config.log_level = root.text_or("log_level", config.log_level);
  if (Status known = log::check_level(config.log_level); !known)
    root.fail("log_level", known.message());
  config.save_every_s = root.number_or("save_every_s", config.save_every_s, {1, 86400});
  config.forget_client_s = root.number_or("forget_client_s", config.forget_client_s, {5, 86400});
  config.queue_capacity = static_cast<std::uint32_t>(
      root.integer_or("queue_capacity", config.queue_capacity, {1, 10000}));
  if (auto mapping = root.optional_section("mapping")) {
    config.mapping_threads =
        static_cast<int>(mapping->integer_or("threads", config.mapping_threads, {1, 64}));
    config.local_window =
        static_cast<int>(mapping->integer_or("local_window", config.local_window, {1, 200}));
    const auto budget = [&](const char* key, std::size_t& value) {
      value = static_cast<std::size_t>(
          mapping->integer_or(key, static_cast<std::int64_t>(value), {10, 100'000'000}));
    };
    budget("keyframe_budget", config.keyframe_budget);
    budget("landmark_budget", config.landmark_budget);
  }
  if (auto downlink = root.optional_section("downlink")) {
    PublishOptions& p = config.publish;
    p.bytes_per_s =
        1000 * downlink->number_or("kilobytes_per_s", p.bytes_per_s / 1000, {1, 100'000});
    p.most_saved_bytes =
        1000 * downlink->number_or("saved_kilobytes", p.most_saved_bytes / 1000, {1, 100'000});
  }
  if (auto loops = root.optional_section("loops")) {
    config.close_loops = loops->flag_or("close", config.close_loops);
    config.vocabulary = loops->text_or("vocabulary", config.vocabulary);
    VerifyOptions& v = config.verify;
    v.min_inliers = static_cast<int>(loops->integer_or("min_inliers", v.min_inliers, {10, 1000}));
    v.min_cells = static_cast<int>(loops->integer_or("min_cells", v.min_cells, {1, 48}));
    v.min_found = loops->number_or("min_found", v.min_found, {0, 1});
    v.max_contradicted = loops->number_or("max_contradicted", v.max_contradicted, {0, 1});
    v.max_rival = loops->number_or("max_rival", v.max_rival, {0, 1});
  }
  if (Status done = root.finish(); !done) return done.error();
  return config;
}

}  // namespace cairn
