// Compiled for AVX2; nothing in here may run before avx2_kernels() has asked the processor.
#include "client/frontend/kernels_avx2.h"

#ifdef __AVX2__
#include "client/frontend/kernels_body.h"

namespace cairn {
namespace {
constexpr Kernels kKernels = make_kernels("AVX2");
}
const Kernels* const kAvx2Kernels = &kKernels;
}  // namespace cairn
#else
namespace cairn {
const Kernels* const kAvx2Kernels = nullptr;
}
#endif
