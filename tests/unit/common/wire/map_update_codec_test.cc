#include "common/wire/map_update_codec.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "common/wire/envelope.h"
#include "tests/support/wire_samples.h"

namespace cairn::wire {
namespace {

using cairn::testing::sample_update;

constexpr std::uint64_t kEpoch = 0xabcdef0123456789;

// To within what the rounding allows.
void expect_near(const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                 const Eigen::Vector3d& centre) {
  EXPECT_LT((a - b).norm(), 1.4e-4 * (a - centre).norm());
}

void expect_equal(const MapUpdate& a, const MapUpdate& b) {
  EXPECT_EQ(a.map, b.map);
  EXPECT_EQ(a.base_revision, b.base_revision);
  EXPECT_EQ(a.revision, b.revision);
  EXPECT_EQ(a.merge_epoch, b.merge_epoch);
  EXPECT_EQ(a.centre, b.centre);
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
    const Sim3 &p = a.keyframes[i].map_from_camera, &q = b.keyframes[i].map_from_camera;
    EXPECT_LT(p.rotation.angularDistance(q.rotation), 4e-6);
    EXPECT_LT((p.translation - q.translation).norm(), 1e-6);
    EXPECT_NEAR(p.scale, q.scale, 1e-6 * p.scale);
  }
  ASSERT_EQ(a.removed_keyframes.size(), b.removed_keyframes.size());
  for (std::size_t i = 0; i < a.removed_keyframes.size(); ++i) {
    EXPECT_EQ(a.removed_keyframes[i].anchor, b.removed_keyframes[i].anchor);
    EXPECT_NEAR(a.removed_keyframes[i].anchor_from_camera.scale,
                b.removed_keyframes[i].anchor_from_camera.scale, 1e-6);
  }
  EXPECT_EQ(a.parts, b.parts);
  ASSERT_EQ(a.landmarks.size(), b.landmarks.size());
  for (std::size_t i = 0; i < a.landmarks.size(); ++i) {
    EXPECT_EQ(a.landmarks[i].id, b.landmarks[i].id);
    expect_near(a.landmarks[i].position, b.landmarks[i].position, a.centre);
    EXPECT_LT((a.landmarks[i].normal - b.landmarks[i].normal).norm(), 1.05e-3);
    EXPECT_EQ(a.landmarks[i].descriptor, b.landmarks[i].descriptor);
    EXPECT_EQ(a.landmarks[i].shown_by, b.landmarks[i].shown_by);
    EXPECT_EQ(a.landmarks[i].observers, b.landmarks[i].observers);
    EXPECT_NEAR(a.landmarks[i].max_distance / b.landmarks[i].max_distance, 1, 1.4e-4);
    EXPECT_NEAR(a.landmarks[i].min_distance / b.landmarks[i].min_distance, 1, 0.012);
  }
  ASSERT_EQ(a.moved_landmarks.size(), b.moved_landmarks.size());
  for (std::size_t i = 0; i < a.moved_landmarks.size(); ++i) {
    EXPECT_EQ(a.moved_landmarks[i].id, b.moved_landmarks[i].id);
    expect_near(a.moved_landmarks[i].position, b.moved_landmarks[i].position, a.centre);
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

// The scale of maps with depth never changes, and costs nothing.
TEST(MapUpdateCodec, UnitsAreToldOnlyWhereOneHasChanged) {
  MapUpdate update = sample_update(kEpoch, 0);
  const std::size_t with = encode_map_update("a", update)->size();
  update.keyframes[2].map_from_camera.scale = 1;
  const std::size_t without = encode_map_update("a", update)->size();
  EXPECT_EQ(with - without, 4 * (update.keyframes.size() + update.removed_keyframes.size()));
}

TEST(MapUpdateCodec, ALandmarkThatMovedTakesEightBytes) {
  MapUpdate update = sample_update(kEpoch, 0);
  const std::size_t before = encode_map_update("a", update)->size();
  for (std::uint64_t i = 1; i <= 100; ++i)
    update.moved_landmarks.push_back({{0, 40'000 + 20 * i}, {1, 2, 0.01 * static_cast<double>(i)}});
  const std::size_t grown = encode_map_update("a", update)->size() - before;
  EXPECT_LE(grown, 100 * usual_bytes(LandmarkMove{}));
  EXPECT_GE(grown, 90 * (usual_bytes(LandmarkMove{}) - 1));
  EXPECT_EQ(encoded_bytes("a", update), encode_map_update("a", update)->size());
}

TEST(MapUpdateCodec, ALandmarkIsSmallWhereTheClientKnowsWhatItLooksLike) {
  for (const bool known : {true, false}) {
    MapUpdate update = sample_update(kEpoch, 0);
    update.landmarks.clear();
    update.moved_landmarks.clear();
    const std::size_t before = encode_map_update("a", update)->size();
    std::size_t expected = 0;
    for (std::uint16_t i = 0; i < 100; ++i) {
      LandmarkState l;
      l.id = LandmarkId::from_feature({kEpoch, 9}, static_cast<std::uint16_t>(7 * i));
      l.position = {1, 2, 3};
      l.normal = {0, 0, -1};
      l.min_distance = 1;
      l.max_distance = 3.6f;
      if (known) l.shown_by = OwnFeature{9, i};
      l.observers = {{kEpoch, 9}, {kEpoch, 10}, {kEpoch, 11}};
      expected += usual_bytes(l);
      update.landmarks.push_back(l);
    }
    const std::size_t grown = encode_map_update("a", update)->size() - before;
    EXPECT_LE(grown, expected);
    EXPECT_GE(grown, expected * 8 / 10);
    EXPECT_LT(grown, known ? 2200u : 5200u);
  }
}

TEST(MapUpdateCodec, KeyframesFarFromTheMappedOnesComeBack) {
  MapUpdate sent = sample_update(kEpoch, 1);
  sent.mapped_keyframes = 100'000;
  sent.landmarks[0].observers = {{kEpoch, 0}, {kEpoch, 99'999}, {kEpoch, 4'000'000'000}, {8, 5}};
  sent.landmarks[0].shown_by = OwnFeature{200'000, 9999};
  const auto got = decode_map_update(*encode_map_update("a", sent));
  ASSERT_TRUE(got) << got.message();
  expect_equal(got->update, sent);
}

TEST(MapUpdateCodec, PartsChainAndJoinToTheWhole) {
  MapUpdate sent = sample_update(kEpoch, 5000);
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
      [](MapUpdate& u) { u.keyframes[1].map_from_camera.scale = 0; },
      [](MapUpdate& u) { u.removed_keyframes[0].anchor = u.removed_keyframes[0].id; },
      [](MapUpdate& u) { u.removed_keyframes[0].anchor_from_camera.scale = -1; },
      [](MapUpdate& u) { u.parts.erase(u.parts.begin()); },
      [](MapUpdate& u) { u.parts[2].first = 3; },
      [](MapUpdate& u) { u.landmarks[0].position.x() = std::nan(""); },
      [](MapUpdate& u) { u.landmarks[0].normal *= 2; },
      [](MapUpdate& u) { u.landmarks[0].min_distance = 99; },
      [](MapUpdate& u) {
        u.landmarks[0].observers.resize(7, {1, 1});
      },
      [](MapUpdate& u) { u.landmarks[1].observers = {{}}; },
      [](MapUpdate& u) { u.landmarks[1].id = u.landmarks[0].id; },
      [](MapUpdate& u) { std::swap(u.landmarks[1].id, u.landmarks[0].id); },
      [](MapUpdate& u) {
        u.landmarks[0].shown_by = OwnFeature{1, 60'000};
      },
      [](MapUpdate& u) { u.centre.y() = std::nan(""); },
      [](MapUpdate& u) { u.moved_landmarks[0].id = {}; },
      [](MapUpdate& u) { u.moved_landmarks[1].position.z() = HUGE_VAL; },
      [](MapUpdate& u) { std::swap(u.moved_landmarks[0], u.moved_landmarks[1]); },
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
