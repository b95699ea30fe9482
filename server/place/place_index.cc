#include "server/place/place_index.h"

#include <algorithm>
#include <mutex>

namespace cairn {

void PlaceIndex::add(KeyframeId keyframe, Words words) {
  auto kept = std::make_shared<const Words>(std::move(words));
  const std::unique_lock lock(mutex_);
  if (const auto it = slot_of_.find(keyframe); it != slot_of_.end()) drop(it->second);
  if (free_slots_.empty()) {
    free_slots_.push_back(static_cast<std::uint32_t>(slots_.size()));
    slots_.emplace_back();
  }
  const std::uint32_t slot = free_slots_.back();
  free_slots_.pop_back();
  if (!kept->bag.empty() && kept->bag.back().word >= postings_.size())
    postings_.resize(std::size_t{kept->bag.back().word} + 1);
  for (const WordWeight& w : kept->bag) postings_[w.word].push_back({slot, w.weight});
  slots_[slot] = {keyframe, std::move(kept)};
  slot_of_[keyframe] = slot;
}

bool PlaceIndex::remove(KeyframeId keyframe) {
  const std::unique_lock lock(mutex_);
  const auto it = slot_of_.find(keyframe);
  if (it == slot_of_.end()) return false;
  drop(it->second);
  return true;
}

void PlaceIndex::drop(std::uint32_t slot) {
  for (const WordWeight& w : slots_[slot].words->bag) {
    // The order of postings says nothing: the last one takes the place.
    std::vector<Posting>& list = postings_[w.word];
    const auto it = std::find_if(list.begin(), list.end(),
                                 [&](const Posting& posting) { return posting.slot == slot; });
    *it = list.back();
    list.pop_back();
  }
  slot_of_.erase(slots_[slot].keyframe);
  slots_[slot] = {};
  free_slots_.push_back(slot);
}

std::vector<PlaceMatch> PlaceIndex::query(const BagOfWords& bag, double least_score,
                                          const Filter& accept) const {
  const std::shared_lock lock(mutex_);
  // A slot's sum goes over the words in ascending order, whatever came and went: scores repeat.
  std::vector<float> scores(slots_.size(), 0);
  for (const WordWeight& w : bag) {
    if (w.word >= postings_.size()) break;
    for (const Posting& posting : postings_[w.word])
      scores[posting.slot] += std::min(w.weight, posting.weight);
  }
  std::vector<PlaceMatch> matches;
  for (std::size_t slot = 0; slot < slots_.size(); ++slot) {
    const double score = std::min(scores[slot], 1.0f);
    if (score <= 0 || score < least_score) continue;
    if (!accept || accept(slots_[slot].keyframe)) matches.push_back({slots_[slot].keyframe, score});
  }
  std::sort(matches.begin(), matches.end(), [](const PlaceMatch& a, const PlaceMatch& b) {
    return a.score != b.score ? a.score > b.score : a.keyframe < b.keyframe;
  });
  return matches;
}

std::shared_ptr<const Words> PlaceIndex::words_of(KeyframeId keyframe) const {
  const std::shared_lock lock(mutex_);
  const auto it = slot_of_.find(keyframe);
  return it == slot_of_.end() ? nullptr : slots_[it->second].words;
}

std::size_t PlaceIndex::size() const {
  const std::shared_lock lock(mutex_);
  return slot_of_.size();
}

}  // namespace cairn
