#include "common/wire/descriptor_packing.h"

#include <algorithm>
#include <array>

#include "common/wire/descriptor_statistics.h"

namespace cairn::wire {
namespace {

constexpr std::size_t kLanes = 4;
// States are from here to 2^32; 16 bits come and go at once.
constexpr std::uint32_t kLow = 1u << 16;
constexpr std::uint32_t kAll = 1u << kChanceBits;

using Values = std::array<std::uint8_t, 256>;  // the bits of a descriptor

Values values_of(const Descriptor& descriptor) {
  Values values;
  for (std::size_t i = 0; i < values.size(); ++i)
    values[i] = static_cast<std::uint8_t>(descriptor[i / 64] >> (i % 64) & 1);
  return values;
}

// A state is a number that stands for all that follows; a bit is put on top of it, so that the bits
// are coded from the last to the first.
class Packer {
 public:
  void put(std::size_t lane, bool bit, std::uint32_t chance) {
    std::uint32_t& state = states_[lane];
    const std::uint32_t share = bit ? chance : kAll - chance;
    if (state >> (32 - kChanceBits) >= share) {
      backwards_.push_back(static_cast<std::uint16_t>(state));
      state >>= 16;
    }
    state = (state / share << kChanceBits) + state % share + (bit ? 0 : chance);
  }
  Blob finish() {
    ByteWriter out(4 * kLanes + 2 * backwards_.size());
    for (const std::uint32_t state : states_) out.put(state);
    std::for_each(backwards_.rbegin(), backwards_.rend(),
                  [&](std::uint16_t word) { out.put(word); });
    return out.take();
  }

 private:
  std::array<std::uint32_t, kLanes> states_{kLow, kLow, kLow, kLow};
  std::vector<std::uint16_t> backwards_;
};

class Unpacker {
 public:
  explicit Unpacker(Bytes packed) : in_(packed.data()), end_(packed.data() + packed.size()) {
    for (std::uint32_t& state : states_) state = word() | word() << 16;
  }

  std::uint8_t get(std::size_t lane, std::uint32_t chance) {
    std::uint32_t& state = states_[lane];
    const std::uint32_t top = state >> kChanceBits, rest = state & (kAll - 1);
    // Without a branch on the bit: it is as good as random.
    const std::uint32_t bit = rest < chance, zero = bit - 1;  // all ones for a bit that is 0
    state = (chance + (zero & (kAll - 2 * chance))) * top + rest - (zero & chance);
    if (state < kLow) state = state << 16 | word();
    return static_cast<std::uint8_t>(bit);
  }
  // Whether all bytes were used and every state is what it began as.
  bool is_done() const {
    return in_ == end_ && !ran_out_ &&
           std::all_of(states_.begin(), states_.end(), [](auto state) { return state == kLow; });
  }

 private:
  std::uint32_t word() {
    if (end_ - in_ < 2) {
      ran_out_ = true;
      return 0;
    }
    const std::uint32_t value = in_[0] | std::uint32_t{in_[1]} << 8;
    in_ += 2;
    return value;
  }

  const std::uint8_t *in_, *end_;
  bool ran_out_ = false;
  std::array<std::uint32_t, kLanes> states_;
};

// So many descriptors side by side; a fixed number lets the processor work on all at once.
template <std::size_t kCount>
void unpack_some(Unpacker& unpacker, Descriptor* to) {
  std::array<std::array<std::uint8_t, kCount>, 256> known{};
  for (const DescriptorBit& b : kDescriptorBits) {
    std::array<std::uint32_t, kCount> chance;
    for (std::size_t lane = 0; lane < kCount; ++lane)
      chance[lane] = b.chance[2u * known[b.first][lane] + known[b.second][lane]];
    for (std::size_t lane = 0; lane < kCount; ++lane)
      known[b.bit][lane] = unpacker.get(lane, chance[lane]);
  }
  for (std::size_t lane = 0; lane < kCount; ++lane) {
    to[lane] = {};
    for (std::size_t i = 0; i < 256; ++i)
      to[lane][i / 64] |= std::uint64_t{known[i][lane]} << (i % 64);
  }
}

}  // namespace

Blob pack_descriptors(std::span<const Descriptor> descriptors) {
  Packer packer;
  std::array<Values, kLanes> values;
  for (std::size_t end = descriptors.size(); end > 0;) {
    const std::size_t lanes = (end - 1) % kLanes + 1;
    end -= lanes;
    for (std::size_t lane = 0; lane < lanes; ++lane)
      values[lane] = values_of(descriptors[end + lane]);
    for (std::size_t i = kDescriptorBits.size(); i-- > 0;) {
      const DescriptorBit& b = kDescriptorBits[i];
      for (std::size_t lane = lanes; lane-- > 0;) {
        const Values& v = values[lane];
        const std::size_t context = i == 0 ? 0 : 2u * v[b.first] + v[b.second];
        packer.put(lane, v[b.bit] != 0, b.chance[context]);
      }
    }
  }
  return packer.finish();
}

bool unpack_descriptors(Bytes packed, std::span<Descriptor> descriptors) {
  Unpacker unpacker(packed);
  std::size_t next = 0;
  for (; next + kLanes <= descriptors.size(); next += kLanes)
    unpack_some<kLanes>(unpacker, &descriptors[next]);
  static_assert(kLanes == 4);
  switch (descriptors.size() - next) {
    case 3:
      unpack_some<3>(unpacker, &descriptors[next]);
      break;
    case 2:
      unpack_some<2>(unpacker, &descriptors[next]);
      break;
    case 1:
      unpack_some<1>(unpacker, &descriptors[next]);
      break;
  }
  return unpacker.is_done();
}

}  // namespace cairn::wire
