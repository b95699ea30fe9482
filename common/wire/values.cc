#include "common/wire/values.h"

#include <cmath>
#include <unordered_set>

namespace cairn::wire {
namespace {

constexpr double kUnitTolerance = 1e-6;
constexpr double kMaxDistance = 1e7;  // metres
constexpr double kMaxScale = 1e6;     // between two maps, either way
constexpr std::uint64_t kMaxClientLandmark = (std::uint64_t{1} << 48) - 1;

bool is_unit(const Eigen::Quaterniond& q) {
  // NaN and infinity fail the comparison.
  return std::abs(q.norm() - 1.0) <= kUnitTolerance;
}

bool is_near(const Eigen::Vector3d& t) {
  return t.allFinite() && t.cwiseAbs().maxCoeff() <= kMaxDistance;
}

}  // namespace

bool is_sound(const Rigid3& t) {
  return is_unit(t.rotation) && is_near(t.translation);
}

bool is_sound(const Sim3& t) {
  return is_unit(t.rotation) && is_near(t.translation) && t.scale >= 1.0 / kMaxScale &&
         t.scale <= kMaxScale;
}

bool is_sound(const LandmarkId& id) {
  if (!id.is_valid()) return false;
  return id.origin == LandmarkId::kServer || id.number <= kMaxClientLandmark;
}

void put_rigid(ByteWriter& out, const Rigid3& t) {
  for (const double v : {t.rotation.w(), t.rotation.x(), t.rotation.y(), t.rotation.z(),
                         t.translation.x(), t.translation.y(), t.translation.z()})
    out.put(v);
}

Rigid3 get_rigid(ByteReader& in) {
  double v[7];
  for (double& value : v) value = in.get_double();
  return {Eigen::Quaterniond(v[0], v[1], v[2], v[3]), Eigen::Vector3d(v[4], v[5], v[6])};
}

void put_similarity(ByteWriter& out, const Sim3& t) {
  put_rigid(out, t.pose());
  out.put(t.scale);
}

Sim3 get_similarity(ByteReader& in) {
  Sim3 transform = get_rigid(in);
  transform.scale = in.get_double();
  return transform;
}

void put_descriptor(ByteWriter& out, const Descriptor& descriptor) {
  for (const std::uint64_t word : descriptor) out.put(word);
}

Descriptor get_descriptor(ByteReader& in) {
  Descriptor descriptor;
  for (std::uint64_t& word : descriptor) word = in.get<std::uint64_t>();
  return descriptor;
}

void EpochTableWriter::add(std::uint64_t epoch) {
  if (places_.try_emplace(epoch, static_cast<std::uint32_t>(epochs_.size())).second)
    epochs_.push_back(epoch);
}

void EpochTableWriter::put_table(ByteWriter& out) const {
  out.put_varint(epochs_.size());
  for (const std::uint64_t epoch : epochs_) out.put(epoch);
}

void EpochTableWriter::put(ByteWriter& out, KeyframeId id) const {
  out.put_varint(places_.at(id.epoch));
  out.put_varint(id.sequence);
}

void EpochTableWriter::put(ByteWriter& out, LandmarkId id) const {
  out.put_varint(places_.at(id.origin));
  out.put_varint(id.number);
}

bool EpochTableReader::read(ByteReader& in) {
  const std::uint64_t count = in.get_varint();
  if (!in.fits(count, 8)) return false;
  std::unordered_set<std::uint64_t> seen;
  for (std::uint64_t i = 0; i < count; ++i) {
    epochs_.push_back(in.get<std::uint64_t>());
    if (!seen.insert(epochs_.back()).second) return false;
  }
  return in.ok();
}

KeyframeId EpochTableReader::get_keyframe(ByteReader& in) const {
  const std::uint64_t place = in.get_varint(), sequence = in.get_varint();
  if (!in.ok() || place >= epochs_.size() || sequence > UINT32_MAX) return {};
  return {epochs_[place], static_cast<std::uint32_t>(sequence)};
}

LandmarkId EpochTableReader::get_landmark(ByteReader& in) const {
  const std::uint64_t place = in.get_varint(), number = in.get_varint();
  if (!in.ok() || place >= epochs_.size()) return {};
  return {epochs_[place], number};
}

// The lowest bit tells whether the epoch is that of the id before, and the rest how many numbers
// lie between the two, or else which epoch it is.
void AscendingIdsWriter::put(ByteWriter& out, LandmarkId id) {
  const bool follows =
      before_.is_valid() && id.origin == before_.origin && id.number > before_.number;
  const std::uint64_t between = follows ? id.number - before_.number - 1 : 0;
  if (follows && between >> 63 == 0) {
    out.put_varint(between << 1);
  } else {
    out.put_varint(std::uint64_t{epochs_.place(id.origin)} << 1 | 1);
    out.put_varint(id.number);
  }
  before_ = id;
}

LandmarkId AscendingIdsReader::get(ByteReader& in) {
  const std::uint64_t code = in.get_varint();
  if ((code & 1) != 0) {
    const std::uint64_t number = in.get_varint();
    const auto epoch = epochs_.epoch(code >> 1);
    before_ = epoch && in.ok() ? LandmarkId{*epoch, number} : LandmarkId{};
  } else {
    const std::uint64_t step = (code >> 1) + 1;
    const bool good = before_.is_valid() && in.ok() && before_.number <= UINT64_MAX - step;
    before_ = good ? LandmarkId{before_.origin, before_.number + step} : LandmarkId{};
  }
  return before_;
}

}  // namespace cairn::wire
