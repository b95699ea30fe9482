// Hash table with cheap copies: a copy shares all entries with the original, and whichever of the
// two is changed first makes its own copy of the part that changes. This is what makes a snapshot of
// a map cost microseconds while its owner goes on changing it.
//
// Two levels: kShards small tables, each shared between copies until written to, of values that are
// again shared until written to. Reading a copy from other threads while the original is changed is
// safe; one object itself has one writer and no concurrent readers.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <unordered_map>
#include <utility>
#include <vector>
#include <algorithm>

namespace cairn {

template <typename Key, typename Value>
class CowTable {
 public:
  // Null when there is none. Valid until this object is changed or destroyed.
  const Value* find(const Key& key) const {
    const auto& shard = shards_[shard_of(key)];
    if (!shard) return nullptr;
    const auto it = shard->find(key);
    return it == shard->end() ? nullptr : it->second.get();
  }
  bool contains(const Key& key) const { return find(key) != nullptr; }
  const Value& at(const Key& key) const { return *find(key); }

  // The value to change; null when there is none. Copies what other copies still share.
  Value* edit(const Key& key) {
    if (!contains(key)) return nullptr;
    std::shared_ptr<Value>& value = own_shard(key).find(key)->second;
    if (value.use_count() > 1) value = std::make_shared<Value>(*value);
    return value.get();
  }

  // Replaces a value of the same key.
  Value& insert(const Key& key, Value value) {
    auto& slot = own_shard(key)[key];
    if (!slot) ++size_;
    slot = std::make_shared<Value>(std::move(value));
    return *slot;
  }

  bool erase(const Key& key) {
    if (!contains(key)) return false;
    own_shard(key).erase(key);
    --size_;
    return true;
  }

  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }

  // In ascending order, so that loops over the table run alike in every run.
  std::vector<Key> sorted_keys() const {
    std::vector<Key> keys;
    keys.reserve(size_);
    for (const auto& shard : shards_)
      if (shard)
        for (const auto& [key, value] : *shard) keys.push_back(key);
    std::sort(keys.begin(), keys.end());
    return keys;
  }

  // Calls f(key, value) for each entry, in no particular order.
  template <typename F>
  void for_each(F&& f) const {
    for (const auto& shard : shards_)
      if (shard)
        for (const auto& [key, value] : *shard) f(key, static_cast<const Value&>(*value));
  }

 private:
  // 100 000 landmarks make shards of about 100; copying one costs microseconds.
  static constexpr std::size_t kShards = 1024;
  using Shard = std::unordered_map<Key, std::shared_ptr<Value>>;

  static std::size_t shard_of(const Key& key) {
    // The low bits pick the bucket inside the shard, so take high ones here.
    return (std::hash<Key>{}(key) >> 40) % kShards;
  }
  Shard& own_shard(const Key& key) {
    auto& shard = shards_[shard_of(key)];
    if (!shard)
      shard = std::make_shared<Shard>();
    else if (shard.use_count() > 1)
      shard = std::make_shared<Shard>(*shard);
    return *shard;
  }

  std::vector<std::shared_ptr<Shard>> shards_ = std::vector<std::shared_ptr<Shard>>(kShards);
  std::size_t size_ = 0;
};

}  // namespace cairn
