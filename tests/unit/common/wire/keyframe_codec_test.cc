#include "common/wire/keyframe_codec.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "common/wire/envelope.h"
#include "tests/support/wire_samples.h"

namespace cairn::wire {
namespace {

using cairn::testing::sample_keyframe;

constexpr KeyframeId kId{0xfedcba9876543210, 7};
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

TEST(KeyframeCodec, KeepsWhatItCarriesToWithinTheRounding) {
  const Keyframe sent = sample_keyframe(kId, 300);
  const auto blob = encode_keyframe("alice", sent);
  ASSERT_TRUE(blob) << blob.message();
  const auto got = decode_keyframe(*blob);
  ASSERT_TRUE(got) << got.message();
  EXPECT_EQ(got->client, (ClientId{"alice", kId.epoch}));
  const Keyframe& k = *got->keyframe;
  EXPECT_EQ(k.id, sent.id);
  EXPECT_EQ(k.stamp_ns, sent.stamp_ns);
  EXPECT_EQ(*k.rig, *sent.rig);
  EXPECT_EQ(k.reference, sent.reference);
  EXPECT_EQ(k.odom_from_camera.matrix(), sent.odom_from_camera.matrix());
  EXPECT_EQ(k.reference_from_camera.matrix(), sent.reference_from_camera.matrix());
  EXPECT_EQ(k.noise, sent.noise);
  EXPECT_EQ(k.matches, sent.matches);
  EXPECT_EQ(k.features.descriptors, sent.features.descriptors);
  ASSERT_EQ(k.features.size(), sent.features.size());
  for (std::size_t i = 0; i < k.features.size(); ++i) {
    const Feature &a = k.features.points[i], &b = sent.features.points[i];
    EXPECT_NEAR(a.x, b.x, 0.0074);  // half of 1.5 * 640 / 65535
    EXPECT_NEAR(a.y, b.y, 0.0056);
    EXPECT_NEAR(a.disparity, b.disparity, 0.5 / 128 + 1e-6);
    EXPECT_EQ(a.has_depth(), b.has_depth());
    EXPECT_NEAR(std::remainder(a.angle - b.angle, 2 * M_PI), 0, M_PI / 256 + 1e-6);
    EXPECT_EQ(a.octave, b.octave);
  }
}

TEST(KeyframeCodec, EncodingWhatWasDecodedGivesTheSameBytes) {
  for (const std::uint32_t sequence : {0u, 1u, 4'000'000'000u}) {
    const auto first = encode_keyframe("bob-2", sample_keyframe({5, sequence}, 200, sequence));
    const auto second = encode_keyframe("bob-2", *decode_keyframe(*first)->keyframe);
    EXPECT_EQ(*first, *second);
  }
}

// Random descriptors can't be packed: real ones take a quarter less (descriptor_packing_test.cc).
TEST(KeyframeCodec, TakesLessThanFiftyBytesAFeatureInAnyCase) {
  const auto blob = encode_keyframe("alice", sample_keyframe(kId, 1000));
  EXPECT_LT(blob->size(), 49'000u);
}

TEST(KeyframeCodec, ALandmarkMadeOfAFeatureTakesABit) {
  Keyframe keyframe = sample_keyframe(kId, 800);
  keyframe.matches.clear();
  const std::size_t without = encode_keyframe("alice", keyframe)->size();
  for (std::uint16_t f = 0; f < 800; ++f)
    keyframe.matches.push_back({f, LandmarkId::from_feature(kId, f)});
  const auto blob = encode_keyframe("alice", keyframe);
  EXPECT_EQ(blob->size(), without);
  EXPECT_EQ(decode_keyframe(*blob)->keyframe->matches, keyframe.matches);
}

TEST(KeyframeCodec, KeyframeWithoutFeaturesIsFine) {
  const auto blob = encode_keyframe("a", sample_keyframe({1, 0}, 0));
  ASSERT_TRUE(blob);
  EXPECT_TRUE(decode_keyframe(*blob));
}

TEST(KeyframeCodec, FeatureFarOutsideTheImageLosesDepthAndMatch) {
  Keyframe k = sample_keyframe(kId, 10);
  ASSERT_EQ(k.matches[0].feature, 0);
  k.features.points[0].x = 2000;
  k.features.points[0].disparity = 8;
  const auto got = decode_keyframe(*encode_keyframe("a", k));
  ASSERT_TRUE(got);
  EXPECT_EQ(got->keyframe->features.size(), 10u);
  EXPECT_FALSE(got->keyframe->features.points[0].has_depth());
  EXPECT_EQ(got->keyframe->matches.size(), k.matches.size() - 1);
}

TEST(KeyframeCodec, DisparityBeyondItsRangeIsUnknownAndNotClamped) {
  Keyframe k = sample_keyframe(kId, 2);
  k.features.points[0].disparity = 600;
  k.features.points[1].disparity = std::numeric_limits<float>::infinity();
  const auto got = decode_keyframe(*encode_keyframe("a", k));
  EXPECT_FALSE(got->keyframe->features.points[0].has_depth());
  EXPECT_FALSE(got->keyframe->features.points[1].has_depth());
}

TEST(KeyframeCodec, OfTwoMatchesOfOneLandmarkTheFirstIsSent) {
  Keyframe k = sample_keyframe(kId, 10);
  k.matches = {{1, {0, 5}}, {2, {0, 5}}, {3, {0, 6}}};
  const auto got = decode_keyframe(*encode_keyframe("a", k));
  EXPECT_EQ(got->keyframe->matches, (std::vector<LandmarkMatch>{{1, {0, 5}}, {3, {0, 6}}}));
}

TEST(KeyframeCodec, RefusesToEncodeWhatIsNotSound) {
  const auto rig_with = [](const std::function<void(Rig&)>& change) {
    return [change](Keyframe& k) {
      Rig rig = *k.rig;
      change(rig);
      k.rig = std::make_shared<Rig>(rig);
    };
  };
  const std::vector<std::function<void(Keyframe&)>> damages = {
      [](Keyframe& k) { k.id.epoch = 0; },
      [](Keyframe& k) { k.rig = nullptr; },
      [](Keyframe& k) { k.stamp_ns = INT64_MIN; },
      [](Keyframe& k) { k.odom_from_camera.translation.x() = kNan; },
      [](Keyframe& k) { k.odom_from_camera.rotation.w() += 0.1; },
      [](Keyframe& k) { k.odom_from_camera.scale = 0; },
      [](Keyframe& k) { k.reference_from_camera.scale = kNan; },
      [](Keyframe& k) { k.reference_from_camera.translation.y() = HUGE_VAL; },
      [](Keyframe& k) { k.reference = k.id; },
      [](Keyframe& k) { k.noise = 0; },
      [](Keyframe& k) { k.noise = std::nextafter(kMinNoise, 0.0f); },
      [](Keyframe& k) { k.noise = std::nextafter(kMaxNoise, 10.0f); },
      [](Keyframe& k) { k.noise = static_cast<float>(kNan); },
      [](Keyframe& k) { k.features.points[3].octave = 8; },
      [](Keyframe& k) { k.features.descriptors.pop_back(); },
      [](Keyframe& k) { std::swap(k.matches[0], k.matches[1]); },
      [](Keyframe& k) { k.matches.back().feature = 50; },
      [](Keyframe& k) { k.matches[0].landmark = {}; },
      [](Keyframe& k) { k.matches[0].landmark = LandmarkId::from_feature(k.id, 1); },
      [](Keyframe& k) {
        k.matches[0].landmark = {k.id.epoch, std::uint64_t{1} << 48};
      },
      [](Keyframe& k) {
        k.matches[0].landmark = LandmarkId::from_feature({k.id.epoch, 8}, 0);
      },
      rig_with([](Rig& r) { r.camera.fx = kNan; }),
      rig_with([](Rig& r) { r.camera.fy = -500; }),
      rig_with([](Rig& r) { r.camera.cx = 1e9; }),
      rig_with([](Rig& r) { r.camera.width = 0; }),
      rig_with([](Rig& r) { r.camera.height = 70000; }),
      rig_with([](Rig& r) { r.camera.baseline = 0; }),
      rig_with([](Rig& r) { r.max_depth = -1; }),
      rig_with([](Rig& r) { r.pyramid.factor = 1; }),
      rig_with([](Rig& r) { r.pyramid.levels = 0; }),
      rig_with([](Rig& r) { r.sensor = static_cast<Sensor>(9); }),
  };
  for (std::size_t i = 0; i < damages.size(); ++i) {
    Keyframe k = sample_keyframe(kId, 50);
    ASSERT_TRUE(encode_keyframe("a", k));
    damages[i](k);
    EXPECT_FALSE(encode_keyframe("a", k)) << "damage " << i;
  }
}

TEST(KeyframeCodec, ClientNamesAreFileNames) {
  for (const char* good : {"a", "robot-7", "A.b_c", "0"})
    EXPECT_TRUE(check_client_name(good)) << good;
  for (const char* bad : {"", ".hidden", "a/b", "a b", "*", "\xc3\xa4"})
    EXPECT_FALSE(check_client_name(bad)) << bad;
  EXPECT_TRUE(check_client_name(std::string(64, 'x')));
  EXPECT_FALSE(check_client_name(std::string(65, 'x')));
}

TEST(KeyframeCodec, EveryFlippedBitIsNoticed) {
  Blob blob = *encode_keyframe("alice", sample_keyframe(kId, 12));
  for (std::size_t bit = 0; bit < 8 * blob.size(); ++bit) {
    blob[bit / 8] ^= static_cast<std::uint8_t>(1 << (bit % 8));
    ASSERT_FALSE(decode_keyframe(blob)) << "bit " << bit;
    blob[bit / 8] ^= static_cast<std::uint8_t>(1 << (bit % 8));
  }
}

TEST(KeyframeCodec, EveryTruncationIsNoticed) {
  const Blob blob = *encode_keyframe("alice", sample_keyframe(kId, 12));
  for (std::size_t size = 0; size < blob.size(); ++size)
    ASSERT_FALSE(decode_keyframe(Bytes(blob).first(size))) << size;
}

// With the checksum made good again the damage reaches the decoder itself.
TEST(KeyframeCodec, DamageUnderAGoodChecksumNeverDecodesToSomethingUnsound) {
  const Blob blob = *encode_keyframe("alice", sample_keyframe(kId, 12));
  const Blob payload(blob.begin() + kEnvelopeSize, blob.end());
  for (std::size_t i = 0; i < payload.size(); ++i) {
    for (const std::uint8_t value : {0x00, 0x01, 0x7f, 0x80, 0xff}) {
      Blob damaged = payload;
      damaged[i] = value;
      if (const auto got = decode_keyframe(seal(kKeyframeFormat, damaged))) {
        ASSERT_TRUE(check_keyframe(*got->keyframe)) << "byte " << i;
      }
    }
    const Bytes cut = Bytes(payload).first(i);
    ASSERT_FALSE(decode_keyframe(seal(kKeyframeFormat, cut))) << "cut at " << i;
  }
}

TEST(KeyframeCodec, AnotherVersionIsTold) {
  Format later = kKeyframeFormat;
  ++later.version;
  const auto got = decode_keyframe(seal(later, Blob(100)));
  ASSERT_FALSE(got);
  EXPECT_EQ(got.error().code, ErrorCode::kVersion);
}

}  // namespace
}  // namespace cairn::wire
