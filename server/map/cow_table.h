// Table with cheap copies: a copy shares all entries with the original, and whichever of the two is
// changed first makes its own copy of the part that changes. This is what makes a snapshot of a map
// cost microseconds while its owner goes on changing it.
//
// Two levels: kShards small sorted arrays, each shared between copies until written to, of values
// that are again shared until written to. Reading a copy from other threads while the original is
// changed is safe (see cow_ptr.h); one object itself has one writer and no concurrent readers.
#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <utility>
#include <vector>

#include "server/map/cow_ptr.h"

namespace cairn {

// Which keys stand together. Specialise it where keys that are changed together can be told: fewer
// shards are copied then.
template <typename Key>
struct CowShardHash {
  std::size_t operator()(const Key& key) const { return std::hash<Key>{}(key); }
};

template <typename Key, typename Value>
class CowTable {
 public:
  // Null when there is none. Valid until this object is changed or destroyed.
  const Value* find(const Key& key) const {
    const CowPtr<Shard>& shard = shards_[shard_of(key)];
    if (!shard) return nullptr;
    const auto it = position(*shard, key);
    return it != shard->end() && it->first == key ? it->second.get() : nullptr;
  }
  bool contains(const Key& key) const { return find(key) != nullptr; }
  const Value& at(const Key& key) const { return *find(key); }

  // The value to change; null when there is none. Copies what other copies still share.
  Value* edit(const Key& key) {
    CowPtr<Shard>& shard = shards_[shard_of(key)];
    if (!shard) return nullptr;
    const auto it = position(*shard, key);
    if (it == shard->end() || it->first != key) return nullptr;
    const auto index = it - shard->begin();
    return &shard.edit()[static_cast<std::size_t>(index)].second.edit();
  }

  // Replaces a value of the same key.
  Value& insert(const Key& key, Value value) {
    CowPtr<Shard>& shared = shards_[shard_of(key)];
    if (!shared) shared = CowPtr<Shard>::make();
    Shard& shard = shared.edit();
    auto it = position(shard, key);
    if (it == shard.end() || it->first != key) {
      it = shard.emplace(it, key, CowPtr<Value>());
      ++size_;
    }
    it->second = CowPtr<Value>::make(std::move(value));
    return it->second.edit();
  }

  bool erase(const Key& key) {
    if (!contains(key)) return false;
    Shard& shard = shards_[shard_of(key)].edit();
    shard.erase(position(shard, key));
    --size_;
    return true;
  }

  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }

  // In ascending order, so that loops over the table run alike in every run.
  std::vector<Key> sorted_keys() const {
    std::vector<Key> keys;
    keys.reserve(size_);
    for_each([&](const Key& key, const Value&) { keys.push_back(key); });
    std::sort(keys.begin(), keys.end());
    return keys;
  }

  // Calls f(key, value) for each entry; the order is the same for the same keys.
  template <typename F>
  void for_each(F&& f) const {
    for (const CowPtr<Shard>& shard : shards_)
      if (shard)
        for (const auto& [key, value] : *shard) f(key, *value);
  }

 private:
  // 300 000 landmarks make shards of about 300; copying one costs a microsecond or two.
  static constexpr std::size_t kShards = 1024;
  using Shard = std::vector<std::pair<Key, CowPtr<Value>>>;  // ascending by key

  static std::size_t shard_of(const Key& key) { return (CowShardHash<Key>{}(key) >> 40) % kShards; }
  template <typename S>
  static auto position(S& shard, const Key& key) {
    return std::lower_bound(shard.begin(), shard.end(), key,
                            [](const auto& entry, const Key& k) { return entry.first < k; });
  }

  std::vector<CowPtr<Shard>> shards_ = std::vector<CowPtr<Shard>>(kShards);
  std::size_t size_ = 0;
};

}  // namespace cairn
