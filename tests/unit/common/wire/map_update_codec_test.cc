#include "common/wire/map_update_codec.h"

#include <gtest/gtest.h>

#include <functional>

#include "common/wire/envelope.h"
#include "tests/support/wire_samples.h"

namespace cairn::wire {
namespace {

using cairn::testing::sample_update;

constexpr std::uint64_t kEpoch = 0xabcdef0123456789;

void expect_equal(const MapUpdate& a, const MapUpdate& b) {
  EXPECT_EQ(a.map, b.map);
  EXPECT_EQ(a.base_revision, b.base_revision);
  EXPECT_EQ(a.revision, b.revision);
  EXPECT_EQ(a.merge_epoch, b.merge_epoch);
  EXPECT_EQ(a.settled, b.settled);
  EXPECT_EQ(a.landmarks_follow, b.landmarks_follow);
  EXPECT_EQ(a.epoch, b.epoch);
  EXPECT_EQ(a.mapped_keyframes, b.mapped_keyframes);
  ASSERT_EQ(a.new_map_from_old_map.has_value(), b.new_map_from_old_map.has_value());
  if (a.new_map_from_old_map) {
    EXPECT_EQ(a.new_map_from_old_map->scale, b.new_map_from_old_map->scale);
  }
  ASSERT_EQ(a.keyframes.size(), b.keyframes.size());
  for (std::size_t i = 0; i < a.keyframes.size(); ++i) {
    EXPECT_EQ(a.keyframes[i].id, b.keyframes[i].id);
    EXPECT_EQ(a.keyframes[i].map_from_camera.matrix(), b.keyframes[i].map_from_camera.matrix());
  }
  ASSERT_EQ(a.removed_keyframes.size(), b.removed_keyframes.size());
  for (std::size_t i = 0; i < a.removed_keyframes.size(); ++i)
    EXPECT_EQ(a.removed_keyframes[i].anchor, b.removed_keyframes[i].anchor);
  ASSERT_EQ(a.landmarks.size(), b.landmarks.size());
  for (std::size_t i = 0; i < a.landmarks.size(); ++i) {
    EXPECT_EQ(a.landmarks[i].id, b.landmarks[i].id);
    EXPECT_LT((a.landmarks[i].position - b.landmarks[i].position).norm(), 1e-6);
    EXPECT_LT((a.landmarks[i].normal - b.landmarks[i].normal).norm(), 5e-5);
    EXPECT_EQ(a.landmarks[i].descriptor, b.landmarks[i].descriptor);
    EXPECT_EQ(a.landmarks[i].observers, b.landmarks[i].observers);
    EXPECT_EQ(a.landmarks[i].max_distance, b.landmarks[i].max_distance);
  }
  ASSERT_EQ(a.removed_landmarks.size(), b.removed_landmarks.size());
  for (std::size_t i = 0; i < a.removed_landmarks.size(); ++i)
    EXPECT_EQ(a.removed_landmarks[i].replaced_by, b.removed_landmarks[i].replaced_by);
}

TEST(MapUpdateCodec, KeepsWhatItCarries) {
  MapUpdate sent = sample_update(kEpoch);
  sent.settled = true;
  sent.landmarks_follow = true;
  const auto blob = encode_map_update("alice", sent);
  ASSERT_TRUE(blob) << blob.message();
  const auto got = decode_map_update(*blob);
  ASSERT_TRUE(got) << got.message();
  EXPECT_EQ(got->client, "alice");
  expect_equal(got->update, sent);
  EXPECT_EQ(*encode_map_update("alice", got->update), *blob);
}

TEST(MapUpdateCodec, PartsChainAndJoinToTheWhole) {
  MapUpdate sent = sample_update(kEpoch, 3000);
  sent.base_revision = 0;
  std::vector<MapUpdate> parts = split_map_update(sent, 41);
  ASSERT_GT(parts.size(), 3u);
  MapUpdate joined;
  std::uint64_t revision = 0;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    EXPECT_EQ(parts[i].base_revision, revision);
    revision = 41 + i;
    EXPECT_EQ(parts[i].revision, revision);
    const auto blob = encode_map_update("alice", parts[i]);
    ASSERT_TRUE(blob) << blob.message();
    EXPECT_LE(blob->size(), kMapUpdatePartBytes);
    auto got = decode_map_update(*blob);
    ASSERT_TRUE(got);
    if (i == 0)
      joined = std::move(got->update);
    else
      append_part(joined, std::move(got->update));
  }
  sent.revision = revision;
  expect_equal(joined, sent);
}

TEST(MapUpdateCodec, EmptyUpdateIsOnePart) {
  MapUpdate update;
  update.map = {1};
  update.epoch = 2;
  update.revision = 9;
  const auto parts = split_map_update(update, 1);
  ASSERT_EQ(parts.size(), 1u);
  EXPECT_TRUE(encode_map_update("a", parts[0]));
}

TEST(MapUpdateCodec, RefusesToEncodeWhatIsNotSound) {
  const std::vector<std::function<void(MapUpdate&)>> damages = {
      [](MapUpdate& u) { u.map.value = 0; },
      [](MapUpdate& u) { u.epoch = 0; },
      [](MapUpdate& u) { u.revision = u.base_revision; },
      [](MapUpdate& u) { u.new_map_from_old_map->scale = 0; },
      [](MapUpdate& u) { u.new_map_from_old_map->scale = std::nan(""); },
      [](MapUpdate& u) { u.keyframes[0].id = {}; },
      [](MapUpdate& u) { u.keyframes[0].map_from_camera.translation.z() = std::nan(""); },
      [](MapUpdate& u) { u.keyframes[1].id = u.keyframes[0].id; },
      [](MapUpdate& u) { u.removed_keyframes[0].anchor = u.removed_keyframes[0].id; },
      [](MapUpdate& u) { u.landmarks[0].position.x() = std::nan(""); },
      [](MapUpdate& u) { u.landmarks[0].normal *= 2; },
      [](MapUpdate& u) { u.landmarks[0].min_distance = 99; },
      [](MapUpdate& u) {
        u.landmarks[0].observers.resize(7, {1, 1});
      },
      [](MapUpdate& u) { u.landmarks[1].observers = {{}}; },
      [](MapUpdate& u) { u.landmarks[1].id = u.landmarks[0].id; },
      [](MapUpdate& u) { u.removed_landmarks[0].id = {}; },
      [](MapUpdate& u) { u.removed_landmarks[1].replaced_by = u.removed_landmarks[1].id; },
  };
  for (std::size_t i = 0; i < damages.size(); ++i) {
    MapUpdate u = sample_update(kEpoch);
    damages[i](u);
    EXPECT_FALSE(encode_map_update("a", u)) << "damage " << i;
  }
}

TEST(MapUpdateCodec, EveryFlippedBitAndTruncationIsNoticed) {
  Blob blob = *encode_map_update("alice", sample_update(kEpoch, 5));
  for (std::size_t bit = 0; bit < 8 * blob.size(); ++bit) {
    blob[bit / 8] ^= static_cast<std::uint8_t>(1 << (bit % 8));
    ASSERT_FALSE(decode_map_update(blob)) << "bit " << bit;
    blob[bit / 8] ^= static_cast<std::uint8_t>(1 << (bit % 8));
  }
  for (std::size_t size = 0; size < blob.size(); ++size)
    ASSERT_FALSE(decode_map_update(Bytes(blob).first(size))) << size;
}

TEST(MapUpdateCodec, DamageUnderAGoodChecksumNeverDecodesToSomethingUnsound) {
  const Blob blob = *encode_map_update("alice", sample_update(kEpoch, 5));
  const Blob payload(blob.begin() + kEnvelopeSize, blob.end());
  for (std::size_t i = 0; i < payload.size(); ++i) {
    for (const std::uint8_t value : {0x00, 0x01, 0x7f, 0x80, 0xff}) {
      Blob damaged = payload;
      damaged[i] = value;
      if (const auto got = decode_map_update(seal(kMapUpdateFormat, damaged))) {
        ASSERT_TRUE(check_map_update(got->update)) << "byte " << i;
      }
    }
    ASSERT_FALSE(decode_map_update(seal(kMapUpdateFormat, Bytes(payload).first(i))));
  }
}

}  // namespace
}  // namespace cairn::wire
