#include "client/frontend/kernels.h"

#include "client/frontend/kernels_avx2.h"

namespace cairn {

const Kernels* avx2_kernels() {
#if defined(__x86_64__)
  static const bool runs = __builtin_cpu_supports("avx2");
  return runs ? kAvx2Kernels : nullptr;
#else
  return nullptr;
#endif
}

const Kernels& best_kernels() {
  const Kernels* const avx2 = avx2_kernels();
  return avx2 ? *avx2 : baseline_kernels();
}

}  // namespace cairn
