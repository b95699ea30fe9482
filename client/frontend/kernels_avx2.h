// Between kernels.cc and kernels_avx2.cc only: data, so that no code of the latter runs unasked.
#pragma once

#include "client/frontend/kernels.h"

namespace cairn {

extern const Kernels* const kAvx2Kernels;  // null when built without AVX2

}  // namespace cairn
