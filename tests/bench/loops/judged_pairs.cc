#include "tests/bench/loops/judged_pairs.h"

#include <ctime>

#include <algorithm>
#include <map>

#include "server/place/loop_candidates.h"

namespace cairn::bench {
namespace {

// Of this thread: what others do on the machine does not count.
double cpu_ms() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) * 1e3 + static_cast<double>(t.tv_nsec) * 1e-6;
}

std::vector<KeyframeId> by_arrival(const KnownMap& known) {
  std::vector<KeyframeId> ids;
  for (const auto& [id, pose] : known.world_from_camera) ids.push_back(id);
  std::sort(ids.begin(), ids.end(), [&](KeyframeId a, KeyframeId b) {
    return known.map.keyframes.at(a).arrival < known.map.keyframes.at(b).arrival;
  });
  return ids;
}

bool share_landmarks(const Map& map, KeyframeId a, KeyframeId b) {
  const auto& list = map.keyframes.at(a).covisible;
  return std::any_of(list.begin(), list.end(), [&](const Covisible& c) { return c.keyframe == b; });
}

Rigid3 true_candidate_from_query(const KnownMap& known, KeyframeId query, KeyframeId candidate) {
  return known.world_from_camera.at(candidate).inverse() * known.world_from_camera.at(query);
}

JudgedPair unjudged(const KnownMap& known, const KeyframePair& pair) {
  const Rigid3 truth = true_candidate_from_query(known, pair.query, pair.candidate);
  JudgedPair judged{pair.query, pair.candidate, {}};
  judged.distance_m = truth.translation.norm();
  judged.turn_rad = rotation_angle(truth);
  return judged;
}

}  // namespace

JudgedPair judge(const KnownMap& known, KeyframeId query, KeyframeId candidate,
                 const VerifyOptions& options) {
  JudgedPair pair = unjudged(known, {query, candidate});
  const double start = cpu_ms();
  pair.verification = verify_loop(known.map, query, candidate, options);
  pair.milliseconds = cpu_ms() - start;
  const Rigid3 truth = true_candidate_from_query(known, query, candidate);
  if (!pair.verification.loop) return pair;
  const Sim3& found = pair.verification.loop->candidate_from_query;
  const Rigid3 off = truth.inverse() * Rigid3(found.rotation, found.translation);
  pair.off_m = off.translation.norm();
  pair.off_rad = rotation_angle(off);
  return pair;
}

std::vector<KeyframePair> some_pairs(const KnownMap& known, std::size_t most,
                                     const std::function<bool(KeyframeId, KeyframeId)>& wanted) {
  std::vector<KeyframePair> chosen, others;
  const std::vector<KeyframeId> ids = by_arrival(known);
  for (std::size_t q = 0; q < ids.size(); ++q)
    for (std::size_t c = 0; c < q; ++c) {
      if (wanted && !wanted(ids[q], ids[c])) continue;
      if (share_landmarks(known.map, ids[q], ids[c])) continue;
      const KeyframePair pair{ids[q], ids[c]};
      (unjudged(known, pair).is_near() ? chosen : others).push_back(pair);
    }
  const std::size_t step = (others.size() + most - 1) / std::max<std::size_t>(most, 1);
  for (std::size_t i = 0; i < others.size(); i += std::max<std::size_t>(step, 1))
    chosen.push_back(others[i]);
  return chosen;
}

std::vector<JudgedPair> judge_all(const KnownMap& known, const std::vector<KeyframePair>& pairs,
                                  const VerifyOptions& options) {
  std::vector<JudgedPair> judged;
  judged.reserve(pairs.size());
  for (const KeyframePair& pair : pairs)
    judged.push_back(judge(known, pair.query, pair.candidate, options));
  return judged;
}

std::vector<JudgedPair> judge_candidates(const KnownMap& known, const Vocabulary& vocabulary,
                                         const VerifyOptions& options) {
  std::vector<JudgedPair> pairs;
  PlaceIndex index;
  std::map<std::uint64_t, LoopCandidates> finders;  // by run
  for (const KeyframeId id : by_arrival(known)) {
    index.add(id, vocabulary.words(known.map.keyframes.at(id).features().descriptors));
    for (const LoopCandidate& c : finders[id.epoch].find(known.map, index, id))
      pairs.push_back(judge(known, id, c.keyframe, options));
  }
  return pairs;
}

int wrong_events(const KnownMap& known) {
  int wrong = 0;
  for (const LoopEdge& edge : known.map.loops) {
    if (!known.world_from_camera.contains(edge.query) ||
        !known.world_from_camera.contains(edge.candidate))
      continue;
    const Rigid3 truth = true_candidate_from_query(known, edge.query, edge.candidate);
    JudgedPair pair;
    pair.verification.loop.emplace();
    const Rigid3 off = truth.inverse() * Rigid3(edge.candidate_from_query.rotation,
                                                edge.candidate_from_query.translation);
    pair.off_m = off.translation.norm();
    pair.off_rad = rotation_angle(off);
    wrong += pair.is_wrong();
  }
  return wrong;
}

}  // namespace cairn::bench
