#include "common/wire/envelope.h"

#include <array>
#include <cstring>
#include <string>

namespace cairn::wire {
namespace {

constexpr std::array<std::uint32_t, 256> make_crc_table() {
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t value = i;
    for (int bit = 0; bit < 8; ++bit) value = (value >> 1) ^ (value & 1 ? 0xEDB88320u : 0u);
    table[i] = value;
  }
  return table;
}
constexpr auto kCrcTable = make_crc_table();

std::uint32_t crc32(std::uint32_t crc, Bytes bytes) {
  crc = ~crc;
  for (const std::uint8_t byte : bytes) crc = (crc >> 8) ^ kCrcTable[(crc ^ byte) & 0xff];
  return ~crc;
}

Error corrupt(const Format& format, const std::string& what) {
  return {ErrorCode::kCorrupt, std::string(format.name) + ": " + what};
}

}  // namespace

Blob seal(const Format& format, Bytes payload) {
  ByteWriter out(kEnvelopeSize + payload.size());
  for (int i = 0; i < 4; ++i) out.put(static_cast<std::uint8_t>(format.kind[i]));
  out.put(format.version);
  out.put(std::uint16_t{0});
  out.put(static_cast<std::uint32_t>(payload.size()));
  out.put(std::uint32_t{0});
  out.put_bytes(payload);
  Blob blob = out.take();
  const std::uint32_t crc =
      crc32(crc32(0, Bytes(blob).first(12)), Bytes(blob).subspan(kEnvelopeSize));
  for (int i = 0; i < 4; ++i) blob[12 + i] = static_cast<std::uint8_t>(crc >> (8 * i));
  return blob;
}

Result<Bytes> unseal(const Format& format, Bytes blob) {
  if (blob.size() < kEnvelopeSize) return corrupt(format, "shorter than its header");
  if (std::memcmp(blob.data(), format.kind, 4) != 0) return corrupt(format, "not one at all");
  ByteReader header(blob.subspan(4, 12));
  const auto version = header.get<std::uint16_t>();
  const auto zero = header.get<std::uint16_t>();
  const auto length = header.get<std::uint32_t>();
  const auto checksum = header.get<std::uint32_t>();
  const Bytes payload = blob.subspan(kEnvelopeSize);
  if (length != payload.size()) return corrupt(format, "length differs from its header's");
  if (checksum != crc32(crc32(0, blob.first(12)), payload))
    return corrupt(format, "checksum does not match");
  // After the checksum: damage to the version field is damage, not another version.
  if (version != format.version)
    return Error{ErrorCode::kVersion, std::string(format.name) + " of version " +
                                          std::to_string(version) + "; this program reads " +
                                          std::to_string(format.version)};
  if (zero != 0) return corrupt(format, "reserved field is not zero");
  return payload;
}

}  // namespace cairn::wire
