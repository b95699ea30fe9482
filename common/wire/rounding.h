// Geometry rounded to what it is worth on the wire. What was rounded once stays as it is.
#pragma once

#include <cstddef>

#include "common/geometry/rigid3.h"
#include "common/wire/bytes.h"

namespace cairn::wire {

// A point by its direction and distance from `centre`: off by at most 7e-5 of the distance across
// (a thirtieth of a pixel at 520 pixels a radian) and 1.3e-4 along. Nearer than 1 mm and farther
// than 10 km the direction alone is kept.
inline constexpr std::size_t kPointBytes = 6;
void put_point(ByteWriter& out, const Eigen::Vector3d& point, const Eigen::Vector3d& centre);
Eigen::Vector3d get_point(ByteReader& in, const Eigen::Vector3d& centre);

// A unit vector, off by at most 1e-3 rad; or zero.
inline constexpr std::size_t kNormalBytes = 3;
void put_normal(ByteWriter& out, const Eigen::Vector3d& normal);
Eigen::Vector3d get_normal(ByteReader& in);

// Two distances, 0 <= near <= far: `far` to 1.3e-4 within 1 mm to 10 km, `near` to 1.1 % of itself;
// 0 where it is less than a 240th of `far`.
inline constexpr std::size_t kRangeBytes = 3;
void put_range(ByteWriter& out, float near, float far);
void get_range(ByteReader& in, float& near, float& far);

// A pose: the rotation off by at most 2e-6 rad, the translation kept as floats from `centre`.
inline constexpr std::size_t kPoseBytes = 20;
void put_pose(ByteWriter& out, const Rigid3& pose, const Eigen::Vector3d& centre);
Rigid3 get_pose(ByteReader& in, const Eigen::Vector3d& centre);

}  // namespace cairn::wire
