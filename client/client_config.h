// Everything that a client's YAML file can say. Every key but `camera` has a default; the files in
// config/ list them with unit and range.
#pragma once

#include <optional>
#include <string>

#include "client/frontend/frontend.h"
#include "client/tracking/tracker.h"
#include "common/config/camera_config.h"
#include "common/util/status.h"

namespace cairn {

struct ClientConfig {
  std::optional<CameraConfig> camera;  // absent: the source knows its own
  FrontendOptions frontend;
  TrackerOptions tracker;
  std::uint32_t domain = 0;
  std::string partition = "cairn";
  std::string log_level = "info";
};

// One line with file, key and line on what is wrong.
Result<ClientConfig> load_client_config(const std::string& path);

}  // namespace cairn
