// Puts rooms and furniture together. Surfaces are declared first and painted all at once at the
// end, each with a seed of its own, so that painting in parallel changes nothing.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Geometry>

#include "tests/support/paint.h"
#include "tests/support/scene.h"

namespace cairn::synthetic {

class SceneBuilder {
 public:
  using Paint = std::function<cv::Mat(Random&, const paint::Area&)>;
  // One paint for each side of a box; the sides in the order front, right, back, left.
  struct BoxPaint {
    Paint side;
    Paint top;
    Paint front;  // `side` when empty
  };

  SceneBuilder(std::string name, std::uint64_t seed) : name_(std::move(name)), seed_(seed) {}

  // Declares a texture; several surfaces of the same size may show it.
  int texture(double width, double height, double pixels_per_metre, Paint paint);

  // Upright surface with its centre at `centre`, seen from the side that `facing` (horizontal, any
  // length) points to.
  void upright(const Eigen::Vector3d& centre, const Eigen::Vector3d& facing, double width,
               double height, double pixels_per_metre, const Paint& paint);
  void upright(const Eigen::Vector3d& centre, const Eigen::Vector3d& facing, double width,
               double height, int texture);
  // Level surface seen from above; its u axis points `yaw` radians from the world's x axis.
  void level(const Eigen::Vector3d& centre, double yaw, double width, double depth,
             double pixels_per_metre, const Paint& paint);
  // The same seen from below.
  void ceiling(const Eigen::Vector3d& centre, double width, double depth, double pixels_per_metre,
               const Paint& paint);
  // A box that stands on `base` (centre of its bottom); size along its own x, y and z. Its front is
  // the side towards its own -y.
  void box(const Eigen::Vector3d& base, const Eigen::Vector3d& size, double yaw,
           double pixels_per_metre, const BoxPaint& paint);
  // Four walls seen from inside, or from outside for a block to walk round.
  void walls(double width, double depth, double height, bool inside, double pixels_per_metre,
             const Paint& paint);

  Random& random() { return random_; }
  std::shared_ptr<const Scene> build() const;

 private:
  struct Surface {
    paint::Area area;
    Paint paint;
  };

  void add(const Eigen::Vector3d& centre, const Eigen::Vector3d& u, const Eigen::Vector3d& v,
           double width, double height, int texture);

  std::string name_;
  std::uint64_t seed_;
  Random random_{derive_seed(seed_, 0x5ce7e)};
  std::vector<Surface> surfaces_;
  std::vector<Quad> quads_;
};

}  // namespace cairn::synthetic
