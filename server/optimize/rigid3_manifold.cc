#include "server/optimize/rigid3_manifold.h"

#include <algorithm>

#include "common/geometry/rigid3.h"

namespace cairn {
namespace {

using Vector3 = Eigen::Map<const Eigen::Vector3d>;
using Quaternion = Eigen::Map<const Eigen::Quaterniond>;

Eigen::Map<Eigen::Vector3d> vector3(double* numbers) {
  return Eigen::Map<Eigen::Vector3d>(numbers);
}

}  // namespace

bool Rigid3Manifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  const Eigen::Quaterniond rotation = (so3_exp(Vector3(delta)) * Quaternion(x)).normalized();
  std::copy_n(rotation.coeffs().data(), 4, x_plus_delta);
  vector3(x_plus_delta + 4) = Vector3(x + 4) + Vector3(delta + 3);
  return true;
}

bool Rigid3Manifold::PlusJacobian(const double*, double* jacobian) const {
  Eigen::Map<Eigen::Matrix<double, 7, 6, Eigen::RowMajor>>(jacobian).setIdentity();
  return true;
}

bool Rigid3Manifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  const Eigen::Quaterniond turn = Quaternion(y) * Quaternion(x).conjugate();
  vector3(y_minus_x) = so3_log(turn);
  vector3(y_minus_x + 3) = Vector3(y + 4) - Vector3(x + 4);
  return true;
}

bool Rigid3Manifold::MinusJacobian(const double*, double* jacobian) const {
  Eigen::Map<Eigen::Matrix<double, 6, 7, Eigen::RowMajor>>(jacobian).setIdentity();
  return true;
}

}  // namespace cairn
