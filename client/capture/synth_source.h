// The embedded synthetic world as a frame source.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "client/capture/frame_source.h"
#include "tests/support/synthetic_sequence.h"

namespace cairn {

// "SCENE?key=value&key=value" as options of the synthetic sequence:
//   frames path seed rate start   numbers (start in seconds along the path)
//   sensor                        rgbd stereo mono
//   blur                          0, 1 (a shutter of 20 ms) or the shutter time in milliseconds
//   noise depth_noise             0 or 1
//   width height focal baseline   pixels, pixels, metres
//   threads                       that render a frame
//   black=A-B                     frames A .. B-1 show nothing
//   jump=A:S                      from frame A on the camera is S seconds further along the path
// `sensor` is what the sequence has when the text doesn't say. Unknown keys and bad values are an
// error that names what is known.
Result<synthetic::SequenceOptions> parse_synth_spec(const std::string& spec, Sensor sensor);

// Renders ahead on a thread. A camera in the config is not used but for its sensor.
Result<std::unique_ptr<FrameSource>> open_synth(const std::string& spec,
                                                const std::optional<CameraConfig>& config);

}  // namespace cairn
