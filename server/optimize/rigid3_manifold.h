// The space of poses for Ceres. Private to server/optimize.
//
// A pose is stored as seven numbers (PoseState in reprojection.h) and moves in six directions by
// the left perturbation of rigid3.h, which the cost functions know: they write derivatives by those
// six directions into the first six of their seven columns. The Jacobian of `Plus` that maps stored
// numbers to directions is therefore simply [I; 0] here. This saves deriving by the four numbers of
// the quaternion only to project back, and it is exact; but a cost function that derives by the
// stored numbers themselves (automatic differentiation, say) can't be used with this manifold.
#pragma once

#include <ceres/manifold.h>

namespace cairn {

class Rigid3Manifold final : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  // y = Plus(x, y_minus_x).
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;
};

}  // namespace cairn
