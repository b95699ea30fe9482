// Is this really the same place? Takes a candidate of place recognition, two keyframes that look
// alike, and says how one lies as seen from the other, or why it does not believe it.
//
// A loop that is missed costs a little accuracy until the next one; a false loop folds the map. So
// each step can only say no:
//   1 match     the landmarks of both neighbourhoods (a keyframe and its most covisible ones) by
//               descriptor: mutually nearest, clearly nearer than anything elsewhere, turned alike
//   2 agree     consensus of three-point alignments (Fischler and Bolles 1981; Umeyama 1991), with
//               reprojection errors in images of both sides as the test
//   3 refine    least squares of both directions' errors (server/optimize/relative_pose.h)
//   4 grow      each neighbourhood's landmarks searched for in all images of the other, both ways;
//               refine again
//   5 doubt     is it more than one object that looks the same? Is there no other transform that
//               explains nearly as much?
// What step 5 asks is what tells a place from a poster that hangs on two walls, and from a wall of
// equal bricks: see VerifyOptions.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/geometry/sim3.h"
#include "server/map/map.h"

namespace cairn {

struct VerifyOptions {
  // False when one side is monocular: then the sides' scales differ.
  bool fix_scale = true;
  std::uint64_t seed = 1;  // of the consensus search

  // Neighbourhood: so many keyframes besides the one named, each sharing at least so many
  // landmarks with it. They see what lies beside the object in common, which decides most doubts.
  int covisibles = 6;
  int min_shared = 15;

  // 1: descriptors may differ in so many bits; the nearest landmark elsewhere, in the other
  // neighbourhood and in the own one, must differ by this much more. What repeats fails here.
  int max_distance = 60;
  float ratio = 0.85f;

  // 2: consensus of fewer matches is what chance brings about: of 100 wrong matches some 5 to 8
  // agree with the best of 1000 transforms.
  int iterations = 1000;
  int min_consensus = 15;
  // Landmarks are less certain than pixels: standard deviations are taken so many times as wide.
  double slack = 1.5;

  // 4: how far from its projection (pixels, times the octave's scale), and with how many bits
  // changed, a landmark is found.
  double radius = 8;
  int grow_distance = 70;
  // So many pairs of landmarks must agree in the end.
  int min_inliers = 40;

  // 5: of an 8 x 6 grid over each of the two images, inliers must lie in so many cells.
  int min_cells = 8;
  // Parts of the scene, of 9 degrees, of whose landmarks none is found in the other side's images
  // though they should show there contradict the loop; those where some are found confirm it. An
  // object that looks the same stands amid things that don't. Occlusion, things that have moved and
  // dark corners make contradictions in true loops too: three quarters of those of a real kitchen
  // have less than this.
  double max_contradicted = 0.3;
  // Of the landmarks that should show, found. True revisits find a fifth to two thirds of them.
  double min_found = 0.15;
  // A flat set of points could be a poster. It must be larger than posters are: metres, or, without
  // a scale, times its distance from the camera.
  double min_flat_extent_m = 2.0;
  double min_flat_extent = 1.5;
  // Of the inliers, so many must be distinctive by themselves (step 1): on a wall of equal bricks
  // everything fits once three bricks do.
  double min_distinctive = 0.1;
  // Another transform of the same turn must not explain more than this share of as many landmarks
  // as agree with the best one; what differs by so few bits may be copies of one print. What
  // repeats along only one of the two walls of a corner explains a quarter and more, chance up to
  // 0.12.
  double max_rival = 0.15;
  int similar_distance = 45;
  // Where there are more copies than are looked at, each transform finds few of them: then it must
  // not find more than this share of what the best one does the same way.
  double max_rival_votes = 0.5;
};

struct VerifiedLoop {
  KeyframeId query, candidate;
  Sim3 candidate_from_query;  // camera frames; scale 1 with fix_scale
  // The same point, as each side knows it: landmarks to be fused. Each landmark at most once.
  struct Pair {
    LandmarkId of_query, of_candidate;
    auto operator<=>(const Pair&) const = default;
  };
  std::vector<Pair> same;  // ascending
  int inliers = 0;         // as many as `same` has pairs
};

// How it went: the loop, or one line on what it failed at; and the figures as far as they were
// found out, for logs and metrics.
struct Verification {
  std::optional<VerifiedLoop> loop;
  std::string why;
  int matches = 0;    // 1
  int consensus = 0;  // 2
  int grown = 0;      // 4
  int cells_query = 0, cells_candidate = 0;
  double contradicted = 0, found = 0;
  double distinctive = 0, rival = 0, rival_votes = 0;
  double flat_extent = 0;  // metres, of all in common where that is flat; else 0
};

// Works on the snapshot alone, in any thread; some tens of milliseconds. The same snapshot, ids and
// options give the same result.
Verification verify_loop(const Map& map, KeyframeId query, KeyframeId candidate,
                         const VerifyOptions& options);

}  // namespace cairn
