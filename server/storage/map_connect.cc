#include "server/storage/map_connect.h"

#include <algorithm>
#include <unordered_map>

namespace cairn::storage {
namespace {

Error contradiction(const char* what) {
  return {ErrorCode::kCorrupt, std::string("the saved map contradicts itself: ") + what};
}

bool is_seen_twice(const Landmark& landmark) {
  std::vector<KeyframeId> observers;
  for (const Observation& seen : landmark.observations) observers.push_back(seen.keyframe);
  std::sort(observers.begin(), observers.end());
  return std::adjacent_find(observers.begin(), observers.end()) != observers.end();
}

// Enters the landmarks into the keyframes that see them.
Status connect_landmarks(Map& map) {
  for (const LandmarkId id : map.landmarks.sorted_keys()) {
    const Landmark& landmark = map.landmarks.at(id);
    if (landmark.observations.empty()) return contradiction("a landmark is seen by no keyframe");
    if (is_seen_twice(landmark))
      return contradiction("a landmark is seen by two features of one keyframe");
    bool reference_sees = false;
    for (const Observation& seen : landmark.observations) {
      KeyframeNode* node = map.keyframes.edit(seen.keyframe);
      if (!node || seen.feature >= node->landmarks.size())
        return contradiction("a landmark is seen by a keyframe that is not there");
      if (node->landmarks[seen.feature].is_valid())
        return contradiction("one feature shows two landmarks");
      node->landmarks.edit()[seen.feature] = id;
      reference_sees |= seen.keyframe == landmark.reference;
    }
    if (!reference_sees) return contradiction("a landmark's reference keyframe does not see it");
  }
  return {};
}

void connect_covisible(Map& map, KeyframeNode& node) {
  std::unordered_map<KeyframeId, int> shared;
  for (const LandmarkId& id : node.landmarks) {
    if (!id.is_valid()) continue;
    for (const Observation& seen : map.landmarks.at(id).observations) ++shared[seen.keyframe];
  }
  shared.erase(node.keyframe->id);
  std::vector<Covisible> covisible;
  for (const auto& [keyframe, count] : shared) covisible.push_back({keyframe, count});
  std::sort(covisible.begin(), covisible.end(), stronger);
  node.covisible = std::move(covisible);
}

Status connect_tree(Map& map, const std::vector<KeyframeId>& keyframes) {
  for (const KeyframeId id : keyframes) {
    const KeyframeId parent = map.keyframes.at(id).parent;
    if (!parent.is_valid()) continue;
    KeyframeNode* node = map.keyframes.edit(parent);
    if (!node) return contradiction("a keyframe's parent is not there");
    node->children.push_back(id);  // ascending, as the loop is
  }
  // What roots lead to is all there is, unless parents make a cycle.
  std::vector<KeyframeId> reached;
  for (const KeyframeId id : keyframes)
    if (!map.keyframes.at(id).parent.is_valid()) reached.push_back(id);
  for (std::size_t i = 0; i < reached.size(); ++i) {
    const auto& children = map.keyframes.at(reached[i]).children;
    reached.insert(reached.end(), children.begin(), children.end());
  }
  if (reached.size() != keyframes.size()) return contradiction("a keyframe descends from itself");
  return {};
}

// Followed by Map::resolve() and Map::pose_of() to their end, which has to be there.
template <typename Key, typename Value, typename Next>
bool chains_end(const CowTable<Key, Value>& table, Next&& next) {
  bool all_end = true;
  table.for_each([&](const Key& key, const Value&) {
    std::size_t steps = 0;
    Key at = key;
    for (const Value* link = table.find(at); link && steps <= table.size(); ++steps) {
      at = next(*link);
      link = table.find(at);
    }
    all_end &= steps <= table.size();
  });
  return all_end;
}

}  // namespace

Status connect(Map& map) {
  if (!chains_end(map.replaced_landmarks, [](const FormerLandmark& f) { return f.now; }))
    return contradiction("landmarks replace each other in a circle");
  if (!chains_end(map.removed_keyframes, [](const FormerKeyframe& f) { return f.anchor; }))
    return contradiction("culled keyframes hang on each other in a circle");
  const std::vector<KeyframeId> keyframes = map.keyframes.sorted_keys();
  for (const KeyframeId id : keyframes) {
    KeyframeNode& node = *map.keyframes.edit(id);
    node.landmarks.edit().assign(node.features().size(), LandmarkId{});
    node.children.clear();
  }
  if (Status status = connect_landmarks(map); !status) return status;
  for (const KeyframeId id : keyframes) connect_covisible(map, *map.keyframes.edit(id));
  return connect_tree(map, keyframes);
}

}  // namespace cairn::storage
