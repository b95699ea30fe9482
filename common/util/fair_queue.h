// Work of several parties, served in turn: each party's items come out in their order, one at a
// time (the next only after done()), and no party waits for more than one item of each other's, but
// for urgent ones: they come before all that are not.
// Several threads may take work. Waits on conditions, never polls. All members are safe from any
// thread.
//
// Unbounded: whoever feeds it must be held back by other means (the server's credits do so).
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <stop_token>
#include <utility>

namespace cairn {

template <typename Party, typename Item>
class FairQueue {
 public:
  struct Taken {
    Party party;
    Item item;
    std::size_t behind = 0;  // items of this party that wait behind this one
  };

  void push(const Party& party, Item item) { add(party, std::move(item), false); }
  void push_urgent(const Party& party, Item item) { add(party, std::move(item), true); }

  // Waits for an item of a party that nobody else is busy with; the caller must say done() to it.
  // Nothing when a stop was asked for, or the queue is closed and empty.
  std::optional<Taken> take(std::stop_token stop = {}) {
    std::unique_lock lock(mutex_);
    typename Lanes::iterator lane;
    changed_.wait(lock, stop, [&] {
      lane = next_lane();
      return lane != lanes_.end() || (closed_ && size_ == 0);
    });
    if (lane == lanes_.end()) return std::nullopt;
    auto& [party, waiting] = *lane;
    const bool is_urgent = !waiting.urgent.empty();
    auto& items = is_urgent ? waiting.urgent : waiting.items;
    Taken taken{party, std::move(items.front()), waiting.size() - 1};
    items.pop_front();
    waiting.busy = true;
    (is_urgent ? last_urgent_ : last_) = party;
    --size_;
    urgent_ -= is_urgent ? 1 : 0;
    return taken;
  }

  void done(const Party& party) {
    {
      std::lock_guard lock(mutex_);
      const auto lane = lanes_.find(party);
      if (lane == lanes_.end()) return;
      lane->second.busy = false;
      if (lane->second.size() == 0) lanes_.erase(lane);
    }
    changed_.notify_all();
  }

  // No more items will come: take() returns nothing once all are out.
  void close() {
    {
      std::lock_guard lock(mutex_);
      closed_ = true;
    }
    changed_.notify_all();
  }

  bool has_urgent() const {
    std::lock_guard lock(mutex_);
    return urgent_ > 0;
  }
  std::size_t size() const {
    std::lock_guard lock(mutex_);
    return size_;
  }

 private:
  struct Lane {
    std::deque<Item> items, urgent;
    bool busy = false;

    std::size_t size() const { return items.size() + urgent.size(); }
  };
  using Lanes = std::map<Party, Lane>;

  void add(const Party& party, Item item, bool is_urgent) {
    {
      std::lock_guard lock(mutex_);
      Lane& lane = lanes_[party];
      (is_urgent ? lane.urgent : lane.items).push_back(std::move(item));
      ++size_;
      urgent_ += is_urgent ? 1 : 0;
    }
    changed_.notify_all();
  }

  typename Lanes::iterator next_lane() {
    const auto urgent = next_lane(&Lane::urgent, last_urgent_);
    return urgent != lanes_.end() ? urgent : next_lane(&Lane::items, last_);
  }
  // The first lane after `last`, in a circle, that has such an item and is not busy.
  typename Lanes::iterator next_lane(std::deque<Item> Lane::*which,
                                     const std::optional<Party>& last) {
    const auto ready = [&](const auto& lane) {
      return !lane.second.busy && !(lane.second.*which).empty();
    };
    const auto start = last ? lanes_.upper_bound(*last) : lanes_.begin();
    for (auto lane = start; lane != lanes_.end(); ++lane)
      if (ready(*lane)) return lane;
    for (auto lane = lanes_.begin(); lane != start; ++lane)
      if (ready(*lane)) return lane;
    return lanes_.end();
  }

  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  Lanes lanes_;
  std::optional<Party> last_, last_urgent_;  // whose item was taken last
  std::size_t size_ = 0, urgent_ = 0;
  bool closed_ = false;
};

}  // namespace cairn
