#include "server/relocaliser.h"

#include <algorithm>
#include <chrono>
#include <unordered_set>
#include <utility>

#include <fmt/format.h>

#include "common/util/log.h"
#include "common/util/thread.h"
#include "server/map/connected.h"
#include "server/publish/landmark_state.h"

namespace cairn {
namespace {

struct Place {
  Location location;
  KeyframeId keyframe() const { return location.around.front(); }
  std::size_t inliers() const { return location.matches.size(); }
};

// Whether a keyframe, or one of those that see most of what it does, is of a place that has been
// found.
bool is_known(const Map& map, const std::vector<Place>& places, KeyframeId keyframe) {
  constexpr std::size_t kNeighbours = 10;
  std::unordered_set<KeyframeId> known;
  for (const Place& place : places)
    known.insert(place.location.around.begin(), place.location.around.end());
  if (known.contains(keyframe)) return true;
  const auto& covisible = map.keyframes.at(keyframe).covisible;
  for (std::size_t i = 0; i < std::min(kNeighbours, covisible.size()); ++i)
    if (known.contains(covisible[i].keyframe)) return true;
  return false;
}

bool is_elsewhere(const Map& map, const Place& a, const Place& b,
                  const RelocaliseOptions& options) {
  const Rigid3 apart = a.location.map_from_camera.inverse() * b.location.map_from_camera;
  if (apart.translation.norm() <= options.rival_shift &&
      rotation_angle(apart) <= options.rival_turn)
    return false;
  // Parts of the map that nothing connects may both show the place; they are merged some day.
  const auto part = connected_keyframes(map, a.keyframe());
  return std::binary_search(part.begin(), part.end(), b.keyframe());
}

// The place that explains most, unless another one explains nearly as much; `why` where there is
// none.
std::optional<Place> choose(const Map& map, std::vector<Place> places,
                            const RelocaliseOptions& options, std::string& why) {
  if (places.empty()) return std::nullopt;
  std::stable_sort(places.begin(), places.end(),
                   [](const Place& a, const Place& b) { return a.inliers() > b.inliers(); });
  const Place& best = places.front();
  for (std::size_t i = 1; i < places.size(); ++i) {
    const double share =
        static_cast<double>(places[i].inliers()) / static_cast<double>(best.inliers());
    if (share <= options.max_rival || !is_elsewhere(map, best, places[i], options)) continue;
    why = fmt::format("two places look like it, by {} and {} landmarks", best.inliers(),
                      places[i].inliers());
    return std::nullopt;
  }
  return best;
}

// The matched ones first, then what the keyframes around see, the nearest related first.
std::vector<LandmarkState> landmarks_around(const Map& map, const Location& location,
                                            std::size_t most) {
  std::vector<LandmarkState> told;
  std::unordered_set<LandmarkId> known;
  const auto tell = [&](LandmarkId id) {
    const Landmark* landmark = id.is_valid() ? map.landmarks.find(id) : nullptr;
    if (landmark && told.size() < most && known.insert(id).second)
      told.push_back(state_of(*landmark));
  };
  for (const LandmarkMatch& m : location.matches) tell(m.landmark);
  for (const KeyframeId id : location.around)
    for (const LandmarkId l : map.keyframes.at(id).landmarks) tell(l);
  return told;
}

void fill_in(const Map& map, const Place& place, const RelocaliseOptions& options,
             RelocaliseAnswer& answer) {
  answer.found = true;
  answer.reference = place.keyframe();
  answer.map_from_reference = map.keyframes.at(answer.reference).scaled_pose();
  answer.map_from_camera = place.location.map_from_camera;
  answer.matches = place.location.matches;
  MapUpdate& around = answer.around;
  around.map = map.id;
  around.merge_epoch = map.merge_epoch;
  around.epoch = answer.epoch;
  around.base_revision = 1;  // no refresh, and otherwise of no stream
  around.revision = 2;
  around.centre = answer.map_from_camera.translation;
  around.landmarks =
      landmarks_around(map, place.location, std::max(options.landmarks, answer.matches.size()));
  std::sort(around.landmarks.begin(), around.landmarks.end(),
            [](const LandmarkState& a, const LandmarkState& b) { return a.id < b.id; });
}

}  // namespace

RelocaliseAnswer relocalise(const Map& map, const PlaceIndex& index, const Vocabulary& vocabulary,
                            const Keyframe& view, const RelocaliseOptions& options) {
  RelocaliseAnswer answer;
  answer.epoch = view.id.epoch;
  answer.number = view.id.sequence;
  answer.why = "nothing in the map looks like it";
  const Words words = vocabulary.words(view.features.descriptors);
  const auto candidates = find_candidates(map, index, words.bag, options.candidates);
  const FeatureGrid grid(view.features, view.rig->camera);
  std::vector<Place> places;
  int left = options.most_held;
  for (const LoopCandidate& candidate : candidates) {
    if (is_known(map, places, candidate.keyframe)) continue;
    // Depth in metres means nothing where the unit is another one. Such a client starts a part of
    // its own, which gives that one its scale when they are merged.
    if (view.rig->sensor != Sensor::kMono && !is_metric(map, candidate.keyframe)) continue;
    if (left-- == 0) break;
    Locating held = locate(map, view, grid, candidate.keyframe, options.locate);
    log::debug("view {} of run {:x} may show what keyframe {} of {:x} does (score {:.3f}): {}",
               view.id.sequence, view.id.epoch, candidate.keyframe.sequence,
               candidate.keyframe.epoch, candidate.score,
               held.location ? fmt::format("{} inliers", held.inliers) : held.why);
    if (held.location)
      places.push_back({std::move(*held.location)});
    else if (&candidate == &candidates.front())
      answer.why = held.why;  // of the likeliest
  }
  if (const auto place = choose(map, std::move(places), options, answer.why)) {
    answer.why.clear();
    fill_in(map, *place, options, answer);
  }
  return answer;
}

Relocaliser::Relocaliser(const MapWriter& writer, const PlaceIndex& index,
                         std::shared_ptr<const Vocabulary> vocabulary,
                         const RelocaliseOptions& options)
    : writer_(writer), index_(index), vocabulary_(std::move(vocabulary)), options_(options) {}

Relocaliser::~Relocaliser() {
  close();
}

void Relocaliser::start(Send send) {
  send_ = std::move(send);
  thread_ = std::jthread([this](std::stop_token stop) {
    name_this_thread("relocaliser");
    run(stop);
  });
}

void Relocaliser::ask(const ClientId& client, KeyframePtr view) {
  {
    std::lock_guard lock(mutex_);
    const bool is_new =
        waiting_
            .insert_or_assign(client, Question{std::move(view), std::chrono::steady_clock::now()})
            .second;
    if (is_new) turns_.push_back(client);
  }
  asked_.notify_all();
}

void Relocaliser::forget(const ClientId& client) {
  std::lock_guard lock(mutex_);
  if (waiting_.erase(client) > 0) std::erase(turns_, client);
}

void Relocaliser::close() {
  if (!thread_.joinable()) return;
  thread_.request_stop();
  thread_.join();
}

void Relocaliser::run(std::stop_token stop) {
  while (true) {
    std::unique_lock lock(mutex_);
    asked_.wait(lock, stop, [&] { return !turns_.empty(); });
    if (stop.stop_requested()) return;
    const ClientId client = turns_.front();
    turns_.pop_front();
    const Question question = std::move(waiting_.extract(client).mapped());
    lock.unlock();
    const RelocaliseAnswer answer =
        relocalise(*writer_.snapshot(), index_, *vocabulary_, *question.view, options_);
    const double ms =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - question.asked)
            .count();
    send_(client, answer, ms);
  }
}

}  // namespace cairn
