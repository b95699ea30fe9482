// Little-endian bytes: a writer that grows a blob and a reader that cannot run past its end.
#pragma once

#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace cairn::wire {

using Blob = std::vector<std::uint8_t>;
using Bytes = std::span<const std::uint8_t>;

class ByteWriter {
 public:
  explicit ByteWriter(std::size_t expected_size = 0) { bytes_.reserve(expected_size); }

  template <std::unsigned_integral T>
  void put(T value) {
    std::uint8_t raw[sizeof(T)];
    for (std::size_t i = 0; i < sizeof(T); ++i)
      raw[i] = static_cast<std::uint8_t>(static_cast<std::uint64_t>(value) >> (8 * i));
    bytes_.insert(bytes_.end(), raw, raw + sizeof(T));
  }
  void put(float value) { put(std::bit_cast<std::uint32_t>(value)); }
  void put(double value) { put(std::bit_cast<std::uint64_t>(value)); }
  // Seven bits a byte, the least significant first: small numbers take one byte.
  void put_varint(std::uint64_t value) {
    for (; value >= 0x80; value >>= 7) bytes_.push_back(static_cast<std::uint8_t>(value | 0x80));
    bytes_.push_back(static_cast<std::uint8_t>(value));
  }
  // At most 255 bytes.
  void put_string(std::string_view text) {
    bytes_.push_back(static_cast<std::uint8_t>(text.size()));
    bytes_.insert(bytes_.end(), text.begin(), text.end());
  }
  void put_bytes(Bytes bytes) { bytes_.insert(bytes_.end(), bytes.begin(), bytes.end()); }

  std::size_t size() const { return bytes_.size(); }
  Blob take() { return std::move(bytes_); }

 private:
  Blob bytes_;
};

// After the first read past the end, or of a malformed number, ok() is false and every further read
// gives zero. Check ok() before a value is used as a size or an index, and at the end.
class ByteReader {
 public:
  explicit ByteReader(Bytes bytes) : bytes_(bytes) {}

  template <std::unsigned_integral T>
  T get() {
    if (!has(sizeof(T))) return 0;
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < sizeof(T); ++i)
      value |= static_cast<std::uint64_t>(bytes_[position_ + i]) << (8 * i);
    position_ += sizeof(T);
    return static_cast<T>(value);
  }
  float get_float() { return std::bit_cast<float>(get<std::uint32_t>()); }
  double get_double() { return std::bit_cast<double>(get<std::uint64_t>()); }
  // Refuses more bytes than the number needs: each number has one form.
  std::uint64_t get_varint() {
    std::uint64_t value = 0;
    for (int shift = 0; shift < 64; shift += 7) {
      const auto byte = get<std::uint8_t>();
      if (!ok_) return 0;
      const std::uint64_t bits = byte & 0x7f;
      if ((shift == 63 && bits > 1) || (shift > 0 && byte == 0)) break;
      value |= bits << shift;
      if (byte < 0x80) return value;
    }
    ok_ = false;
    return 0;
  }
  std::string get_string() {
    const auto length = get<std::uint8_t>();
    if (!has(length)) return {};
    const auto* start = reinterpret_cast<const char*>(bytes_.data() + position_);
    position_ += length;
    return std::string(start, length);
  }

  // A view of what the reader was made from.
  Bytes get_bytes(std::size_t count) {
    if (!has(count)) return {};
    const Bytes bytes = bytes_.subspan(position_, count);
    position_ += count;
    return bytes;
  }

  bool ok() const { return ok_; }
  bool at_end() const { return ok_ && position_ == bytes_.size(); }
  std::size_t remaining() const { return ok_ ? bytes_.size() - position_ : 0; }
  // Whether `count` things of at least `size` bytes each can still follow: the check before a
  // container is made as large as the data claim.
  bool fits(std::uint64_t count, std::size_t size) {
    if (ok_ && count <= remaining() / size) return true;
    ok_ = false;
    return false;
  }

 private:
  bool has(std::size_t count) {
    if (ok_ && bytes_.size() - position_ >= count) return true;
    ok_ = false;
    return false;
  }

  Bytes bytes_;
  std::size_t position_ = 0;
  bool ok_ = true;
};

}  // namespace cairn::wire
