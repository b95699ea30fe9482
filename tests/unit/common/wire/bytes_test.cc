#include "common/wire/bytes.h"

#include <gtest/gtest.h>

#include "common/wire/envelope.h"

namespace cairn::wire {
namespace {

TEST(Bytes, NumbersAreLittleEndian) {
  ByteWriter out;
  out.put(std::uint32_t{0x01020304});
  out.put(1.0);
  EXPECT_EQ(out.take(), (Blob{4, 3, 2, 1, 0, 0, 0, 0, 0, 0, 0xf0, 0x3f}));
}

TEST(Bytes, VarintsComeBackAndHaveOneForm) {
  for (const std::uint64_t value : {0ull, 1ull, 127ull, 128ull, 300ull, 1ull << 48, ~0ull}) {
    ByteWriter out;
    out.put_varint(value);
    const Blob blob = out.take();
    ByteReader in(blob);
    EXPECT_EQ(in.get_varint(), value);
    EXPECT_TRUE(in.at_end());
  }
  const Blob overlong{0x80, 0x00};
  ByteReader in(overlong);
  in.get_varint();
  EXPECT_FALSE(in.ok());
  const Blob too_big{0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x02};
  ByteReader in2(too_big);
  in2.get_varint();
  EXPECT_FALSE(in2.ok());
}

TEST(Bytes, ReadingPastTheEndGivesZerosAndIsRemembered) {
  const Blob blob{1, 2, 3};
  ByteReader in(blob);
  EXPECT_EQ(in.get<std::uint32_t>(), 0u);
  EXPECT_EQ(in.get<std::uint8_t>(), 0u);
  EXPECT_FALSE(in.ok());
  ByteReader sized(blob);
  EXPECT_TRUE(sized.fits(1, 3));
  EXPECT_FALSE(sized.fits(~0ull, 1));
}

TEST(Envelope, ChecksumIsTheCommonCrc32) {
  // The check value of CRC-32: "123456789" gives CBF43926. Here over header and payload, so the
  // expected value was worked out with another implementation (Python's zlib.crc32).
  const Blob blob = seal({"TEST", 1, "test"}, Blob{'1', '2', '3'});
  EXPECT_EQ(blob.size(), kEnvelopeSize + 3);
  ByteReader in(Bytes(blob).subspan(12, 4));
  EXPECT_EQ(in.get<std::uint32_t>(), 0x1a7e5e7bu);
}

TEST(Envelope, KindsAreNotMistakenForEachOther) {
  const Blob blob = seal(kKeyframeFormat, Blob{1, 2, 3});
  EXPECT_TRUE(unseal(kKeyframeFormat, blob));
  EXPECT_FALSE(unseal(kMapUpdateFormat, blob));
}

}  // namespace
}  // namespace cairn::wire
