#include "common/util/memory.h"

#include <malloc.h>

namespace cairn {

void release_free_memory() {
#ifdef __GLIBC__
  malloc_trim(0);
#endif
}

}  // namespace cairn
