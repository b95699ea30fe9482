// What is known of a descriptor's 256 bits: in which order they are packed, which two earlier ones
// say most about each, and how often it is a 1, given these.
//
// Learned from photographs by tests/bench/learn_descriptor_statistics.cc for the tests in
// client/frontend/brief_pattern.cc. Descriptors made otherwise are packed as well, but less
// tightly. Part of the keyframe's format: another table is another version.
#pragma once

#include <array>
#include <cstdint>

namespace cairn::wire {

inline constexpr int kChanceBits = 12;

struct DescriptorBit {
  std::uint8_t bit;
  std::uint8_t first, second;  // come earlier; those of the very first bit count as 0
  // Of a 1, in 4096ths, by first and second: 00, 01, 10, 11. Neither 0 nor 4096.
  std::array<std::uint16_t, 4> chance;
};

extern const std::array<DescriptorBit, 256> kDescriptorBits;

}  // namespace cairn::wire
