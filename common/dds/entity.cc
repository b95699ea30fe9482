#include "common/dds/entity.h"

#include <dds/dds.h>

namespace cairn::dds {

Entity::~Entity() {
  // Fails only when the entity has gone with its parent, which is as good.
  if (handle_ > 0) (void)dds_delete(handle_);
}

Error dds_error(const std::string& what, std::int32_t return_code) {
  ErrorCode code = ErrorCode::kUnavailable;
  if (return_code == DDS_RETCODE_TIMEOUT) code = ErrorCode::kTimeout;
  if (return_code == DDS_RETCODE_BAD_PARAMETER) code = ErrorCode::kInvalidArgument;
  return {code, what + " failed: " + dds_strretcode(-return_code)};
}

Result<Entity> own(const std::string& what, std::int32_t handle_or_error) {
  if (handle_or_error > 0) return Entity(handle_or_error);
  return dds_error(what, handle_or_error);
}

}  // namespace cairn::dds
