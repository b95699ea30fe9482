#include "common/wire/relocalise_codec.h"

#include <gtest/gtest.h>

#include <functional>

#include "common/wire/keyframe_codec.h"
#include "tests/support/wire_samples.h"

namespace cairn::wire {
namespace {

using cairn::testing::sample_answer;

constexpr std::uint64_t kEpoch = 0xabcdef0123456789;

RelocaliseAnswer nowhere() {
  RelocaliseAnswer answer;
  answer.epoch = kEpoch;
  answer.number = 12;
  answer.why = "nothing in the map looks like it";
  return answer;
}

TEST(RelocaliseCodec, KeepsWhatItCarries) {
  const RelocaliseAnswer sent = sample_answer(kEpoch);
  const auto blob = encode_answer("alice", sent);
  ASSERT_TRUE(blob) << blob.message();
  const auto got = decode_answer(*blob);
  ASSERT_TRUE(got) << got.message();
  EXPECT_EQ(got->client, "alice");
  const RelocaliseAnswer& a = got->answer;
  EXPECT_EQ(a.epoch, sent.epoch);
  EXPECT_EQ(a.number, sent.number);
  EXPECT_TRUE(a.found);
  EXPECT_EQ(a.reference, sent.reference);
  EXPECT_EQ(a.map_from_reference.matrix(), sent.map_from_reference.matrix());
  EXPECT_EQ(a.map_from_camera.matrix(), sent.map_from_camera.matrix());
  EXPECT_EQ(a.matches, sent.matches);
  EXPECT_EQ(a.around.map, sent.around.map);
  EXPECT_EQ(a.around.merge_epoch, sent.around.merge_epoch);
  ASSERT_EQ(a.around.landmarks.size(), sent.around.landmarks.size());
  EXPECT_EQ(a.around.landmarks[7].descriptor, sent.around.landmarks[7].descriptor);
  EXPECT_EQ(*encode_answer("alice", a), *blob);
}

TEST(RelocaliseCodec, SaysWhyNothingWasFound) {
  RelocaliseAnswer sent = nowhere();
  const auto got = decode_answer(*encode_answer("alice", sent));
  ASSERT_TRUE(got) << got.message();
  EXPECT_FALSE(got->answer.found);
  EXPECT_EQ(got->answer.number, 12u);
  EXPECT_EQ(got->answer.why, sent.why);
  sent.why.assign(1000, 'x');
  EXPECT_EQ(decode_answer(*encode_answer("alice", sent))->answer.why.size(), 200u);
}

// A question is a keyframe's blob; what a lost client can say must pass the keyframe's checks.
TEST(RelocaliseCodec, AQuestionIsAKeyframeWithoutMatches) {
  Keyframe view = cairn::testing::sample_keyframe({kEpoch, 3});
  view.reference = {};
  view.reference_from_camera = {};
  view.odom_from_camera = {};
  view.matches.clear();
  const auto blob = encode_keyframe("alice", view);
  ASSERT_TRUE(blob) << blob.message();
  const auto got = decode_keyframe(*blob);
  ASSERT_TRUE(got) << got.message();
  EXPECT_EQ(got->keyframe->id.sequence, 3u);
  EXPECT_EQ(got->keyframe->features.descriptors, view.features.descriptors);
}

TEST(RelocaliseCodec, RefusesToEncodeWhatIsNotSound) {
  const std::vector<std::function<void(RelocaliseAnswer&)>> damages = {
      [](RelocaliseAnswer& a) { a.epoch = 0; },
      [](RelocaliseAnswer& a) { a.reference = {}; },
      [](RelocaliseAnswer& a) { a.map_from_camera.translation.x() = std::nan(""); },
      [](RelocaliseAnswer& a) { a.map_from_reference.rotation.coeffs() *= 2; },
      [](RelocaliseAnswer& a) { a.matches[1].feature = a.matches[0].feature; },
      [](RelocaliseAnswer& a) { a.matches[1].landmark = a.matches[0].landmark; },
      [](RelocaliseAnswer& a) {
        a.matches[2].landmark = {0, 123456};
      },
      [](RelocaliseAnswer& a) { a.matches.back().feature = 60000; },
      [](RelocaliseAnswer& a) { a.around.epoch = 1; },
      [](RelocaliseAnswer& a) { a.around.base_revision = 0; },
      [](RelocaliseAnswer& a) { a.around.landmarks[0].position.y() = std::nan(""); },
  };
  for (std::size_t i = 0; i < damages.size(); ++i) {
    RelocaliseAnswer a = sample_answer(kEpoch);
    damages[i](a);
    EXPECT_FALSE(encode_answer("alice", a)) << "damage " << i;
  }
}

TEST(RelocaliseCodec, EveryFlippedBitAndTruncationIsNoticed) {
  for (Blob blob :
       {*encode_answer("alice", sample_answer(kEpoch, 4)), *encode_answer("alice", nowhere())}) {
    for (std::size_t bit = 0; bit < 8 * blob.size(); ++bit) {
      blob[bit / 8] ^= static_cast<std::uint8_t>(1 << (bit % 8));
      ASSERT_FALSE(decode_answer(blob)) << "bit " << bit;
      blob[bit / 8] ^= static_cast<std::uint8_t>(1 << (bit % 8));
    }
    for (std::size_t size = 0; size < blob.size(); ++size)
      ASSERT_FALSE(decode_answer(Bytes(blob).first(size))) << size;
  }
}

TEST(RelocaliseCodec, DamageUnderAGoodChecksumNeverDecodesToSomethingUnsound) {
  const Blob blob = *encode_answer("alice", sample_answer(kEpoch, 4));
  const Blob payload(blob.begin() + kEnvelopeSize, blob.end());
  for (std::size_t i = 0; i < payload.size(); ++i) {
    for (const std::uint8_t value : {0x00, 0x01, 0x7f, 0x80, 0xff}) {
      Blob damaged = payload;
      damaged[i] = value;
      if (const auto got = decode_answer(seal(kRelocaliseFormat, damaged))) {
        ASSERT_TRUE(check_answer(got->answer)) << "byte " << i;
      }
    }
    ASSERT_FALSE(decode_answer(seal(kRelocaliseFormat, Bytes(payload).first(i))));
  }
}

}  // namespace
}  // namespace cairn::wire
