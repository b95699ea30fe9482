// The real programs on a data set, with sharpening set one way or another.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "client/client_config.h"
#include "server/tool/evaluation.h"
#include "tests/bench/paper/data_sets.h"

namespace cairn::bench {

struct Variant {
  std::string name;                    // short, without blanks
  std::optional<std::string> sharpen;  // the config's frontend.sharpen, YAML; unset: as it stands
};

// What cairn-client makes of the variant, without a camera. Error: not understood.
Result<ClientConfig> client_config(const Variant& variant);

struct RunResult {
  // At least half of the frames were tracked and the trajectory could be judged. If not, only the
  // counts below mean anything.
  bool succeeded = false;
  Evaluation errors;
  int frames = 0, tracked = 0, keyframes = 0;
  double tracking_ms = 0;    // median, a frame, features included
  double extraction_ms = 0;  // median, features alone
  Trajectory estimate;
  double coverage() const { return frames > 0 ? static_cast<double>(tracked) / frames : 0; }
};

// A server and a client over loopback, apart from all others. Embedded scenes in lockstep, so that
// the result can be repeated; recordings at full rate. Error: a program that can't be started.
Result<RunResult> run_client(const DataSet& set, const RunInput& input, const Variant& variant);

}  // namespace cairn::bench
