// Identities. Relations between parts of the map are ids, never pointers.
//
// Ids are small values: ordered, hashable, comparable, meaningful across processes and restarts.
#pragma once

#include <compare>
#include <cstdint>
#include <functional>
#include <string>

namespace cairn {

// One run of one client. `name` is what the user gave; `epoch` is drawn at random at each start and
// never 0, so that a restarted client is told from its former self.
struct ClientId {
  std::string name;
  std::uint64_t epoch = 0;

  auto operator<=>(const ClientId&) const = default;
};

// The `sequence`-th keyframe (from 0, without gaps) that the client of that epoch has made.
struct KeyframeId {
  std::uint64_t epoch = 0;
  std::uint32_t sequence = 0;

  bool is_valid() const { return epoch != 0; }
  auto operator<=>(const KeyframeId&) const = default;
};

// Landmarks are named by whoever makes them. A client names the one it makes from feature f of its
// keyframe s (epoch, s << 16 | f); the server counts its own from 1 with origin 0. Both sides can
// so make landmarks without asking each other.
struct LandmarkId {
  std::uint64_t origin = 0;
  std::uint64_t number = 0;

  static constexpr std::uint64_t kServer = 0;
  static LandmarkId from_feature(KeyframeId keyframe, std::uint16_t feature) {
    return {keyframe.epoch, (std::uint64_t{keyframe.sequence} << 16) | feature};
  }
  bool is_valid() const { return origin != 0 || number != 0; }
  // The keyframe and feature that a client's landmark was made from.
  KeyframeId creator() const { return {origin, static_cast<std::uint32_t>(number >> 16)}; }
  std::uint16_t creator_feature() const { return static_cast<std::uint16_t>(number); }
  auto operator<=>(const LandmarkId&) const = default;
};

// A map of the server; drawn at random, never 0.
struct MapId {
  std::uint64_t value = 0;

  auto operator<=>(const MapId&) const = default;
};

namespace detail {
// Finaliser of splitmix64 (Steele et al. 2014): spreads consecutive numbers over all bits.
inline std::size_t mix(std::uint64_t x) {
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return static_cast<std::size_t>(x ^ (x >> 31));
}
}  // namespace detail

}  // namespace cairn

template <>
struct std::hash<cairn::KeyframeId> {
  std::size_t operator()(const cairn::KeyframeId& k) const {
    return cairn::detail::mix(k.epoch ^ (std::uint64_t{k.sequence} << 1));
  }
};
template <>
struct std::hash<cairn::LandmarkId> {
  std::size_t operator()(const cairn::LandmarkId& l) const {
    return cairn::detail::mix(l.origin ^ (l.number * 0x9e3779b97f4a7c15ULL));
  }
};
template <>
struct std::hash<cairn::MapId> {
  std::size_t operator()(const cairn::MapId& m) const { return cairn::detail::mix(m.value); }
};
