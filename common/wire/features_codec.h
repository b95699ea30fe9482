// The features of an image as bytes: about 31 each, 24 of them for the descriptor.
//
// Measurements are rounded to what they are worth:
//   position   16 bits over -1/4 .. +5/4 of the image (640 px wide: steps of 0.015 px)
//   disparity  16 bits of 1/128 px, up to 512 px; 0 is unknown
//   angle       8 bits of a turn, steps of 1.4 degrees
// Descriptors keep every bit (descriptor_packing.h).
#pragma once

#include "common/geometry/camera.h"
#include "common/model/features.h"
#include "common/wire/bytes.h"

namespace cairn::wire {

inline constexpr std::size_t kMaxFeatures = 10000;

// Whether a feature lies where its position can be told. One that does not keeps its place in the
// order, but not its depth.
bool is_tellable(const Feature& feature, const PinholeCamera& camera);

void put_features(ByteWriter& out, const Features& features, const PinholeCamera& camera);
// False when the bytes are not what put_features() writes; octaves may be any, up to 15.
bool get_features(ByteReader& in, const PinholeCamera& camera, Features& features);

}  // namespace cairn::wire
