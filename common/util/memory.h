#pragma once

namespace cairn {

// Gives memory that is free back to the system: for after work that took much of it for a while,
// of which the C library would keep most. Takes milliseconds, during which others may wait for
// memory. Does nothing where the C library has no such call.
void release_free_memory();

}  // namespace cairn
