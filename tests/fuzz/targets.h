// One function for each decoder of bytes from outside. Whatever the bytes, it must return: it ends
// the process when something decodes that is not sound or does not encode to itself again.
#pragma once

#include <cstddef>
#include <cstdint>

namespace cairn::fuzz {

void keyframe(const std::uint8_t* data, std::size_t size);
void map_update(const std::uint8_t* data, std::size_t size);
void answer(const std::uint8_t* data, std::size_t size);

}  // namespace cairn::fuzz
