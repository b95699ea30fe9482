// Where a view lies in the map: the server's answer to a client that is lost. The question is the
// view's features, as a keyframe without matches whose sequence is the question's number.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/model/keyframe.h"
#include "common/model/map_update.h"

namespace cairn {

struct RelocaliseAnswer {
  std::uint64_t epoch = 0;   // of the client's run
  std::uint32_t number = 0;  // of the question
  bool found = false;
  std::string why;  // where it was not found: in one line, for the log

  // The rest only where it was found. The keyframe, of any client, that shows most of what the view
  // does: what the view's own keyframe refers to.
  KeyframeId reference;
  Sim3 map_from_reference;             // with the size of its own unit (Keyframe)
  Rigid3 map_from_camera;              // of the view
  std::vector<LandmarkMatch> matches;  // of the view's features, ascending
  // The landmarks around, those of `matches` among them, as changes that may come at any point of
  // the client's stream of updates: they hold in the map of that id after that many loops and
  // merges (`map`, `merge_epoch`), and in no other.
  MapUpdate around;
};

}  // namespace cairn
