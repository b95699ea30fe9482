#include "client/frontend/kernels_body.h"

namespace cairn {

const Kernels& baseline_kernels() {
  static constexpr Kernels kernels = make_kernels("baseline");
  return kernels;
}

}  // namespace cairn
