// Owns one Cyclone DDS entity; deleting it deletes its children.
//
// None of the headers of this folder include DDS's own, so that the C API stays in this folder.
#pragma once

#include <cstdint>
#include <string>
#include <utility>

#include "common/util/status.h"

struct dds_qos;

namespace cairn::dds {

class Entity {
 public:
  Entity() = default;
  // Takes over a handle > 0.
  explicit Entity(std::int32_t handle) : handle_(handle) {}
  Entity(Entity&& other) noexcept : handle_(std::exchange(other.handle_, 0)) {}
  Entity& operator=(Entity&& other) noexcept {
    std::swap(handle_, other.handle_);
    return *this;
  }
  ~Entity();

  std::int32_t handle() const { return handle_; }

 private:
  std::int32_t handle_ = 0;
};

// One line for a return code of the C API: "<what> failed: <DDS's name for it>".
Error dds_error(const std::string& what, std::int32_t return_code);

// Wraps what a dds_create_* function returned.
Result<Entity> own(const std::string& what, std::int32_t handle_or_error);

}  // namespace cairn::dds
