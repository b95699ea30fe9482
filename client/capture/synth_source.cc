#include "client/capture/synth_source.h"

#include <charconv>
#include <cmath>
#include <functional>
#include <string_view>
#include <utility>
#include <vector>

#include "client/capture/read_ahead.h"

namespace cairn {
namespace {

using synthetic::SequenceOptions;
using synthetic::SyntheticSequence;

// Sets one option from its text; false when the text is no good.
using Setter = std::function<bool(SequenceOptions&, std::string_view)>;
struct Key {
  std::string_view name;
  Setter set;
};

bool parse(std::string_view text, auto& value) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size();
}

template <typename T>
Setter number(T SequenceOptions::*member) {
  return [member](SequenceOptions& o, std::string_view text) { return parse(text, o.*member); };
}

Setter flag(bool SequenceOptions::*member) {
  return [member](SequenceOptions& o, std::string_view text) {
    o.*member = text == "1" || text == "true" || text.empty();
    return o.*member || text == "0" || text == "false";
  };
}

bool set_sensor(SequenceOptions& o, std::string_view text) {
  if (text == "rgbd") {
    o.sensor = Sensor::kRgbd;
  } else if (text == "stereo") {
    o.sensor = Sensor::kStereo;
  } else if (text == "mono") {
    o.sensor = Sensor::kMono;
  } else {
    return false;
  }
  return true;
}

bool set_blur(SequenceOptions& o, std::string_view text) {
  double milliseconds = 0;
  if (text == "1" || text == "true" || text.empty()) {
    milliseconds = 20;
  } else if (text != "false" && !parse(text, milliseconds)) {
    return false;
  }
  o.exposure_s = milliseconds * 1e-3;
  return true;
}

// "60-120".
bool set_black(SequenceOptions& o, std::string_view text) {
  const auto dash = text.find('-');
  return dash != text.npos && parse(text.substr(0, dash), o.black_from) &&
         parse(text.substr(dash + 1), o.black_until);
}

// "120:7.5".
bool set_jump(SequenceOptions& o, std::string_view text) {
  const auto colon = text.find(':');
  return colon != text.npos && parse(text.substr(0, colon), o.jump_at) &&
         parse(text.substr(colon + 1), o.jump_s);
}

const std::vector<Key>& keys() {
  static const std::vector<Key> list = {
      {"frames", number(&SequenceOptions::frames)},
      {"path", number(&SequenceOptions::path)},
      {"seed", number(&SequenceOptions::seed)},
      {"sensor", set_sensor},
      {"blur", set_blur},
      {"noise", flag(&SequenceOptions::noise)},
      {"depth_noise", flag(&SequenceOptions::depth_noise)},
      {"rate", number(&SequenceOptions::rate_hz)},
      {"start", number(&SequenceOptions::start_s)},
      {"width", number(&SequenceOptions::width)},
      {"height", number(&SequenceOptions::height)},
      {"focal", number(&SequenceOptions::focal)},
      {"baseline", number(&SequenceOptions::baseline_m)},
      {"threads", number(&SequenceOptions::threads)},
      {"black", set_black},
      {"jump", set_jump},
  };
  return list;
}

Status apply(SequenceOptions& options, std::string_view setting) {
  const auto equals = std::min(setting.find('='), setting.size());
  const std::string_view name = setting.substr(0, equals);
  const std::string_view value = setting.substr(std::min(equals + 1, setting.size()));
  std::string known;
  for (const Key& key : keys()) {
    if (key.name == name) {
      if (key.set(options, value)) return {};
      return {ErrorCode::kInvalidArgument,
              "synth: '" + std::string(value) + "' is no value for " + std::string(name)};
    }
    known += (known.empty() ? "" : ", ") + std::string(key.name);
  }
  return {ErrorCode::kInvalidArgument,
          "synth: unknown key '" + std::string(name) + "'; there are: " + known};
}

}  // namespace

Result<SequenceOptions> parse_synth_spec(const std::string& spec, Sensor sensor) {
  SequenceOptions options;
  options.sensor = sensor;
  std::string_view rest = spec;
  const auto question = std::min(rest.find('?'), rest.size());
  options.scene = std::string(rest.substr(0, question));
  rest.remove_prefix(std::min(question + 1, rest.size()));
  while (!rest.empty()) {
    const auto end = std::min(rest.find('&'), rest.size());
    if (Status status = apply(options, rest.substr(0, end)); !status) return status.error();
    rest.remove_prefix(std::min(end + 1, rest.size()));
  }
  return options;
}

Result<std::unique_ptr<FrameSource>> open_synth(const std::string& spec,
                                                const std::optional<CameraConfig>& config) {
  auto options = parse_synth_spec(spec, config ? config->sensor : Sensor::kRgbd);
  if (!options) return options.error();
  auto sequence = SyntheticSequence::make(*options);
  if (!sequence) return {sequence.error().code, "synth: " + sequence.message()};
  CameraConfig camera;
  camera.sensor = options->sensor;
  camera.camera = (*sequence)->camera();
  camera.rate_hz = options->rate_hz;
  if (options->sensor == Sensor::kStereo) camera.baseline_m = options->baseline_m;
  const int count = (*sequence)->size();
  auto produce = [sequence = *sequence, count, index = 0]() mutable -> Produced {
    if (index >= count) return EndOfFrames{};
    const synthetic::SyntheticFrame rendered = sequence->frame(index++);
    return Frame{rendered.stamp_ns, rendered.gray, rendered.right, rendered.depth};
  };
  return std::unique_ptr<FrameSource>(
      std::make_unique<ReadAhead>("synth:" + spec, camera, count, std::move(produce)));
}

}  // namespace cairn
