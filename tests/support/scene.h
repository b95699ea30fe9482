// A synthetic world: textured rectangles, rooms made of them, known by name.
//
// World frame: z up, metres, the floor at z = 0, the origin in the middle of the room.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <Eigen/Core>

#include "common/util/status.h"
#include "tests/support/texture.h"

namespace cairn::synthetic {

// A rectangle, seen from one side only: from where `u` points right and `v` down in the picture, so
// that its normal towards the viewer is v x u. The texture covers it once.
struct Quad {
  Eigen::Vector3d corner;  // top left, world
  Eigen::Vector3d u, v;    // unit length, at right angles
  double width = 0, height = 0;
  int texture = 0;
  float gain = 1;  // how bright the light falls on it
};

struct Scene {
  std::string name;
  std::vector<Quad> quads;
  std::vector<Texture> textures;
};

struct SceneInfo {
  std::string_view name;
  std::string_view description;
};

// What there is:
//   desk         office: desk in the middle, shelves, boxes, posters; rich texture
//   hall         14 x 10 m hall with pillars and exhibition boards
//   corridor     square loop corridor, 37 m round, its texture varied along it
//   weak         room with weak texture and a few objects
//   textureless  room where next to nothing stands out: contrasts of a few grey levels
//   bare         room with two rich walls and two that are dim and all but flat
//   turn         the office, for turning on the spot
//   posters      room with the same poster again and again
//   bricks       room of brick walls
const std::vector<SceneInfo>& scene_list();

// Paints the textures (up to a second of work, on two threads). The same name and seed give the
// same scene. Unknown names are an error that lists the known ones.
Result<std::shared_ptr<const Scene>> make_scene(const std::string& name, std::uint64_t seed);

}  // namespace cairn::synthetic
