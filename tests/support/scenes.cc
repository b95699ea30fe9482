// The scenes by name.
#include <numbers>

#include "tests/support/scene.h"
#include "tests/support/scene_builder.h"

namespace cairn::synthetic {
namespace {

using Eigen::Vector3d;
using paint::Area;
using Paint = SceneBuilder::Paint;

constexpr double kPi = std::numbers::pi;

Paint plaster(double level, double contrast) {
  return [=](Random& r, const Area& a) { return paint::plaster(r, a, level, contrast); };
}
Paint leaves(double level, double contrast) {
  return [=](Random& r, const Area& a) { return paint::leaves(r, a, level, contrast); };
}
Paint boards(double level) {
  return [=](Random& r, const Area& a) { return paint::boards(r, a, level); };
}
Paint carpet(double level, double contrast) {
  return [=](Random& r, const Area& a) { return paint::carpet(r, a, level, contrast); };
}
Paint faint(double level, double contrast) {
  return [=](Random& r, const Area& a) { return paint::faint(r, a, level, contrast); };
}

// Floor and ceiling of a rectangular room.
void floor_and_ceiling(SceneBuilder& b, double width, double depth, double height,
                       const Paint& floor, const Paint& ceiling) {
  b.level({0, 0, 0}, 0, width, depth, 220, floor);
  b.ceiling({0, 0, height}, width, depth, 120, ceiling);
}

// `count` posters in a row along each wall of a room, in front of it by some millimetres.
void hang_posters(SceneBuilder& b, double width, double depth, int count) {
  for (int side = 0; side < 4; ++side) {
    const Vector3d out(side == 0 ? 1 : side == 2 ? -1 : 0, side == 1 ? 1 : side == 3 ? -1 : 0, 0);
    const Vector3d along(-out.y(), out.x(), 0);
    const double length = side % 2 == 0 ? depth : width;
    const double distance = (side % 2 == 0 ? width : depth) / 2 - 0.006;
    for (int i = 0; i < count; ++i) {
      const double w = b.random().uniform(0.45, 0.85), h = w * b.random().uniform(0.8, 1.5);
      const double x = ((i + b.random().uniform(0.3, 0.7)) / count - 0.5) * length;
      const double z = b.random().uniform(1.35, 1.75);
      b.upright(distance * out + x * along + z * Vector3d::UnitZ(), -out, w, h, 400, paint::poster);
    }
  }
}

// A desk at the origin with what lies on desks.
void furnish_desk(SceneBuilder& b) {
  constexpr double kTop = 0.74;
  b.box({0, 0, kTop - 0.05}, {1.7, 0.9, 0.05}, 0, 500, {boards(120), boards(165), {}});
  for (const double x : {-0.75, 0.75}) {
    b.box({x, 0, 0}, {0.1, 0.8, kTop - 0.05}, 0, 250, {leaves(90, 40), leaves(90, 40), {}});
  }
  const Paint dark = plaster(35, 3);
  b.box({-0.35, 0.2, kTop + 0.08}, {0.52, 0.05, 0.34}, 0.25, 600, {dark, dark, paint::screen});
  b.box({-0.35, 0.22, kTop}, {0.2, 0.15, 0.08}, 0.25, 400, {dark, dark, {}});
  b.box({0.35, 0.22, kTop + 0.08}, {0.52, 0.05, 0.34}, -0.3, 600, {dark, dark, paint::screen});
  b.box({0.35, 0.24, kTop}, {0.2, 0.15, 0.08}, -0.3, 400, {dark, dark, {}});
  b.box({-0.25, -0.2, kTop}, {0.46, 0.16, 0.02}, 0.1, 700, {plaster(60, 3), paint::keyboard, {}});
  for (int i = 0; i < 5; ++i) {
    const double x = -0.7 + 0.33 * i, y = -0.33 + 0.05 * b.random().uniform(-1, 1);
    if (i == 1 || i == 2) continue;  // where the keyboard is
    b.level({x, y, kTop + 0.004}, b.random().uniform(-0.6, 0.6), 0.21, 0.297, 800, paint::page);
  }
  for (int i = 0; i < 6; ++i) {
    const Vector3d size(b.random().uniform(0.07, 0.25), b.random().uniform(0.07, 0.2),
                        b.random().uniform(0.05, 0.24));
    const Vector3d base(-0.72 + 0.29 * i, (i % 2 == 0 ? 0.32 : -0.02) - 0.1 * (i > 3), kTop);
    const double tone = b.random().uniform(70, 190);
    b.box(base, size, b.random().uniform(-0.8, 0.8), 600,
          {leaves(tone, 60), leaves(tone, 60), paint::poster});
  }
}

void furnish_office(SceneBuilder& b, double width, double depth) {
  b.box({-width / 2 + 0.17, 0.5, 0}, {1.5, 0.3, 1.9}, kPi / 2, 350,
        {boards(130), boards(130), paint::books});
  b.box({width / 2 - 0.2, -0.9, 0}, {1.1, 0.35, 1.2}, -kPi / 2, 350,
        {boards(110), paint::page, paint::books});
  b.box({0.9, depth / 2 - 0.25, 0}, {1.6, 0.45, 0.85}, 0, 350,
        {boards(140), leaves(150, 50), leaves(120, 60)});
  b.box({-1.5, -depth / 2 + 0.25, 0}, {0.9, 0.45, 1.3}, kPi, 350,
        {plaster(175, 6), leaves(140, 50), paint::poster});
  for (int i = 0; i < 7; ++i) {
    const double angle = 2 * kPi * (i + 0.35) / 7;
    const double side = b.random().uniform(0.25, 0.5);
    const Vector3d base(0.40 * width * std::cos(angle), 0.38 * depth * std::sin(angle), 0);
    const double tone = b.random().uniform(80, 180);
    b.box(base, {side, side * b.random().uniform(0.7, 1.2), side * b.random().uniform(0.6, 1.3)},
          b.random().uniform(0, kPi), 350, {leaves(tone, 50), leaves(tone, 65), paint::poster});
  }
}

std::shared_ptr<const Scene> make_office(const std::string& name, std::uint64_t seed) {
  SceneBuilder b(name, seed);
  constexpr double kWidth = 6.4, kDepth = 5.6, kHeight = 2.7;
  b.walls(kWidth, kDepth, kHeight, true, 220, plaster(178, 6));
  floor_and_ceiling(b, kWidth, kDepth, kHeight, boards(115), plaster(205, 3));
  hang_posters(b, kWidth, kDepth, 4);
  furnish_desk(b);
  furnish_office(b, kWidth, kDepth);
  return b.build();
}

std::shared_ptr<const Scene> make_hall(const std::string& name, std::uint64_t seed) {
  SceneBuilder b(name, seed);
  constexpr double kWidth = 14, kDepth = 10, kHeight = 3.6;
  b.walls(kWidth, kDepth, kHeight, true, 130, leaves(150, 45));
  b.level({0, 0, 0}, 0, kWidth, kDepth, 130, carpet(110, 14));
  b.ceiling({0, 0, kHeight}, kWidth, kDepth, 60, boards(185));
  hang_posters(b, kWidth, kDepth, 6);
  for (const double x : {-3.5, 0.0, 3.5}) {
    for (const double y : {-1.5, 1.5}) {
      b.box({x, y, 0}, {0.45, 0.45, kHeight}, 0, 200, {leaves(140, 55), plaster(100, 5), {}});
    }
  }
  for (int i = 0; i < 8; ++i) {  // exhibition boards and crates between the pillars
    const double x = -4.9 + 1.4 * i, y = i % 2 == 0 ? 0.5 : -0.6;
    b.box({x, y, 0}, {1.0, 0.3, b.random().uniform(0.9, 1.8)}, b.random().uniform(-0.6, 0.6), 250,
          {leaves(125, 60), leaves(150, 50), paint::poster});
  }
  return b.build();
}

std::shared_ptr<const Scene> make_corridor(const std::string& name, std::uint64_t seed) {
  SceneBuilder b(name, seed);
  constexpr double kOuter = 12, kInner = 8, kHeight = 2.6;
  // Each side has its own look, so that places differ from each other.
  for (int side = 0; side < 4; ++side) {
    const Vector3d out(side == 0 ? 1 : side == 2 ? -1 : 0, side == 1 ? 1 : side == 3 ? -1 : 0, 0);
    const Paint paint = side % 2 == 0 ? plaster(150 + 12 * side, 9) : leaves(120 + 15 * side, 40);
    const Paint other = side % 2 == 0 ? leaves(130, 35) : plaster(170, 9);
    const Vector3d up = kHeight / 2 * Vector3d::UnitZ();
    b.upright(kOuter / 2 * out + up, -out, kOuter, kHeight, 200, paint);
    b.upright(kInner / 2 * out + up, out, kInner, kHeight, 200, other);
    const Vector3d along(-out.y(), out.x(), 0);
    for (int i = 0; i < 6; ++i) {
      const double x = -5.2 + 2.0 * i + b.random().uniform(-0.3, 0.3),
                   z = b.random().uniform(1.2, 1.7);
      const double w = b.random().uniform(0.5, 0.9);
      b.upright((kOuter / 2 - 0.006) * out + x * along + z * Vector3d::UnitZ(), -out, w,
                w * b.random().uniform(0.8, 1.4), 350,
                i % 3 == 2 ? Paint(paint::books) : paint::poster);
      if (std::abs(x) > 3.4) continue;
      b.upright((kInner / 2 + 0.006) * out + (x + 0.4) * along + 1.5 * Vector3d::UnitZ(), out, w,
                w * b.random().uniform(0.8, 1.4), 350, paint::poster);
    }
    const double crate = b.random().uniform(0.3, 0.5);
    b.box((kOuter / 2 - 0.3) * out + b.random().uniform(-3, 3) * along, {crate, crate, 1.8 * crate},
          b.random().uniform(0, 1.5), 300, {leaves(110, 60), leaves(150, 50), paint::poster});
  }
  b.level({0, 0, 0}, 0, kOuter, kOuter, 110, carpet(105, 13));
  b.ceiling({0, 0, kHeight}, kOuter, kOuter, 60, boards(195));
  return b.build();
}

std::shared_ptr<const Scene> make_weak(const std::string& name, std::uint64_t seed) {
  SceneBuilder b(name, seed);
  constexpr double kSide = 5.4, kHeight = 2.6;
  b.walls(kSide, kSide, kHeight, true, 220, faint(165, 34));
  floor_and_ceiling(b, kSide, kSide, kHeight, faint(115, 24), faint(205, 16));
  for (int i = 0; i < 5; ++i) {
    const double angle = 2 * kPi * (i + 0.2) / 5, side = b.random().uniform(0.3, 0.6);
    b.box({2.2 * std::cos(angle), 2.2 * std::sin(angle), 0}, {side, side, 1.2 * side},
          b.random().uniform(0, kPi), 300, {faint(120, 40), faint(150, 36), {}});
  }
  return b.build();
}

std::shared_ptr<const Scene> make_textureless(const std::string& name, std::uint64_t seed) {
  SceneBuilder b(name, seed);
  constexpr double kSide = 5.0, kHeight = 2.5;
  b.walls(kSide, kSide, kHeight, true, 220, faint(170, 6));
  floor_and_ceiling(b, kSide, kSide, kHeight, faint(150, 6), faint(190, 5));
  return b.build();
}

// Two walls are richly textured, the two opposite ones dim and all but flat: who looks from the
// ones to the others needs the faint marks there.
std::shared_ptr<const Scene> make_bare(const std::string& name, std::uint64_t seed) {
  SceneBuilder b(name, seed);
  constexpr double kSide = 5.2, kHeight = 2.6;
  const Vector3d up = kHeight / 2 * Vector3d::UnitZ();
  for (const Vector3d& side : {Vector3d(1, 0, 0), Vector3d(0, 1, 0)}) {
    b.upright(kSide / 2 * side + up, -side, kSide, kHeight, 220, leaves(140, 45));
    b.upright(-kSide / 2 * side + up, side, kSide, kHeight, 220, faint(55, 7));
  }
  floor_and_ceiling(b, kSide, kSide, kHeight, faint(50, 6), faint(70, 5));
  return b.build();
}

std::shared_ptr<const Scene> make_posters(const std::string& name, std::uint64_t seed) {
  SceneBuilder b(name, seed);
  constexpr double kWidth = 7, kDepth = 6, kHeight = 2.7;
  b.walls(kWidth, kDepth, kHeight, true, 200, plaster(170, 7));
  floor_and_ceiling(b, kWidth, kDepth, kHeight, boards(115), plaster(205, 3));
  const int same = b.texture(0.6, 0.8, 400, paint::poster);
  for (int side = 0; side < 4; ++side) {
    const Vector3d out(side == 0 ? 1 : side == 2 ? -1 : 0, side == 1 ? 1 : side == 3 ? -1 : 0, 0);
    const Vector3d along(-out.y(), out.x(), 0);
    const double distance = (side % 2 == 0 ? kWidth : kDepth) / 2 - 0.006;
    for (int i = -2; i <= 2; ++i) {
      b.upright(distance * out + 1.05 * i * along + 1.5 * Vector3d::UnitZ(), -out, 0.6, 0.8, same);
    }
  }
  return b.build();
}

std::shared_ptr<const Scene> make_bricks(const std::string& name, std::uint64_t seed) {
  SceneBuilder b(name, seed);
  constexpr double kWidth = 7, kDepth = 6, kHeight = 2.7;
  b.walls(kWidth, kDepth, kHeight, true, 220, paint::bricks);
  floor_and_ceiling(b, kWidth, kDepth, kHeight, carpet(110, 9), plaster(205, 3));
  for (int i = 0; i < 3; ++i) {
    const double angle = 2 * kPi * i / 3;
    b.box({2.6 * std::cos(angle), 2.2 * std::sin(angle), 0}, {0.5, 0.5, 0.7}, angle, 300,
          {leaves(120, 50), leaves(150, 50), {}});
  }
  return b.build();
}

using Maker = std::shared_ptr<const Scene> (*)(const std::string&, std::uint64_t);
struct Entry {
  SceneInfo info;
  Maker make;
};

const std::vector<Entry>& entries() {
  static const std::vector<Entry> list = {
      {{"desk", "office with a desk in the middle; rich texture"}, make_office},
      {{"hall", "14 x 10 m hall with pillars and exhibition boards"}, make_hall},
      {{"corridor", "square loop corridor, 37 m round"}, make_corridor},
      {{"weak", "room with weak texture"}, make_weak},
      {{"textureless", "room where next to nothing stands out"}, make_textureless},
      {{"bare", "two rich walls, two dim and all but flat ones"}, make_bare},
      {{"turn", "the office, for turning on the spot"}, make_office},
      {{"posters", "room with the same poster again and again"}, make_posters},
      {{"bricks", "room of brick walls"}, make_bricks},
  };
  return list;
}

}  // namespace

const std::vector<SceneInfo>& scene_list() {
  static const std::vector<SceneInfo> list = [] {
    std::vector<SceneInfo> infos;
    for (const Entry& entry : entries()) infos.push_back(entry.info);
    return infos;
  }();
  return list;
}

Result<std::shared_ptr<const Scene>> make_scene(const std::string& name, std::uint64_t seed) {
  std::string known;
  for (const Entry& entry : entries()) {
    if (entry.info.name == name) return entry.make(name, seed);
    known += (known.empty() ? "" : ", ") + std::string(entry.info.name);
  }
  return {ErrorCode::kInvalidArgument, "unknown scene '" + name + "'; there are: " + known};
}

}  // namespace cairn::synthetic
