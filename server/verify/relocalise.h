// Where was this view taken? Holds a view of a client that does not know where it is against one
// place of the map, a candidate of place recognition, and says how it lies there, or why it does
// not believe it.
//
// A view is less than verify_loop() has to go by, one image instead of two neighbourhoods, and a
// false answer folds the map as a false loop does: the client's next keyframe is made of it. The
// steps are alike, each can only say no:
//   1 match     the landmarks that the candidate and its most covisible keyframes see against the
//               view's features: mutually nearest, clearly nearer than anything elsewhere, turned
//               alike
//   2 agree     consensus of three-point poses (Fischler and Bolles 1981; AP3P: Ke and Roumeliotis
//               2017)
//   3 grow      refine the pose (view_pose.h) and look for everything that the keyframes around
//               know where it should show, twice
//   4 doubt     enough, spread over the image; is what should show there; is it more than one
//   poster;
//               does no other pose explain nearly as much?
// All descriptors are compared with all, some 3 ms for a place: a vocabulary's direct index would
// spare most of that and lose a third of the true matches.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/feature/feature_grid.h"
#include "server/map/map.h"

namespace cairn {

struct LocateOptions {
  // 1: keyframes besides the candidate, sharing at least so many landmarks with it; bits that may
  // differ; the nearest elsewhere must differ by this much more.
  int covisibles = 4, min_shared = 15;
  int max_distance = 60;
  float ratio = 0.85f;
  // 2: attempts, and how far in pixels from its projection a feature may lie.
  int iterations = 500;
  float pixels = 5;
  int min_consensus = 12;
  // 3: keyframes around that are looked into, those first that show most of what the view does; how
  // far from its projection (pixels at octave 0) and with how many bits changed a landmark is
  // found; by how much wider than the measurement's own its standard deviation is.
  std::size_t around = 20;
  double radius = 10;
  int grow_distance = 70;
  double slack = 1.5;
  // 4: landmarks that agree in the end; cells of 8 x 6 of the image that they lie in; share of what
  // should show that was found; share of the cells that something should show in where nothing of
  // it does.
  int min_inliers = 40;
  int min_cells = 8;
  double min_found = 0.15;
  double max_contradicted = 0.35;
  // Of the landmarks that agree, so many must have been distinctive by themselves (2): on a wall of
  // equal bricks everything fits once a few bricks do.
  double min_distinctive = 0.1;
  // A view of nothing but something flat could be of any print of one poster: it must be larger
  // than posters are. Metres or, of a view without depth, times its distance from the camera.
  double min_flat_extent_m = 2.0;
  double min_flat_extent = 1.5;
  // Another pose, by landmarks that look the same elsewhere around, must not explain more than this
  // share of what the best one does.
  double max_rival = 0.3;
};

struct Location {
  Rigid3 map_from_camera;
  std::vector<LandmarkMatch> matches;  // features ascending, no landmark twice
  // Keyframes that show most of the matched landmarks, the one with most first; not empty.
  std::vector<KeyframeId> around;
};

// The location, or one line on what it failed at; and the figures as far as they were found out.
struct Locating {
  std::optional<Location> location;
  std::string why;
  int matches = 0, consensus = 0, inliers = 0, cells = 0;
  double found = 0, contradicted = 0, rival = 0;
};

// `grid` is of the view's features. Works on the snapshot alone, in any thread; some milliseconds.
// The same input gives the same result.
Locating locate(const Map& map, const Keyframe& view, const FeatureGrid& grid, KeyframeId candidate,
                const LocateOptions& options);

}  // namespace cairn
