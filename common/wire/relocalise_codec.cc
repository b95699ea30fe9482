#include "common/wire/relocalise_codec.h"

#include <unordered_set>
#include <utility>

#include "common/wire/keyframe_codec.h"
#include "common/wire/map_update_codec.h"
#include "common/wire/values.h"

namespace cairn::wire {
namespace {

constexpr std::size_t kMostWords = 200;            // bytes of `why`
constexpr std::size_t kMinMatchBytes = 1 + 1 + 1;  // what a claimed length is checked against

Status unsound(const std::string& what) {
  return {ErrorCode::kInvalidArgument, "answer to a lost client: " + what};
}

Status check_matches(const RelocaliseAnswer& answer) {
  std::unordered_set<LandmarkId> told, matched;
  for (const LandmarkState& l : answer.around.landmarks) told.insert(l.id);
  int previous = -1;
  for (const LandmarkMatch& m : answer.matches) {
    if (m.feature <= previous || m.feature >= kMaxFeatures)
      return unsound("matches do not ascend by feature");
    previous = m.feature;
    if (!told.contains(m.landmark)) return unsound("match of a landmark that it does not tell of");
    if (!matched.insert(m.landmark).second) return unsound("two features match one landmark");
  }
  return {};
}

// Features are named by their distance from the one before.
void put_matches(ByteWriter& out, const std::vector<LandmarkMatch>& matches) {
  EpochTableWriter epochs;
  for (const LandmarkMatch& m : matches) epochs.add(m.landmark.origin);
  epochs.put_table(out);
  out.put_varint(matches.size());
  std::uint32_t next = 0;
  for (const LandmarkMatch& m : matches) {
    out.put_varint(m.feature - next);
    epochs.put(out, m.landmark);
    next = m.feature + 1u;
  }
}

bool get_matches(ByteReader& in, std::vector<LandmarkMatch>& matches) {
  EpochTableReader epochs;
  if (!epochs.read(in)) return false;
  const std::uint64_t count = in.get_varint();
  if (!in.fits(count, kMinMatchBytes)) return false;
  matches.reserve(count);
  std::uint64_t next = 0;
  for (std::uint64_t i = 0; i < count && in.ok(); ++i) {
    const std::uint64_t distance = in.get_varint();
    if (distance > kMaxFeatures || next + distance > kMaxFeatures) return false;
    matches.push_back({static_cast<std::uint16_t>(next + distance), epochs.get_landmark(in)});
    next += distance + 1;
  }
  return in.ok();
}

bool get_place(ByteReader& in, const std::string& client, RelocaliseAnswer& answer) {
  answer.reference.epoch = in.get<std::uint64_t>();
  answer.reference.sequence = in.get<std::uint32_t>();
  answer.map_from_reference = get_similarity(in);
  answer.map_from_camera = get_rigid(in);
  if (!get_matches(in, answer.matches)) return false;
  auto around = decode_map_update(in.get_bytes(in.get<std::uint32_t>()));
  if (!in.ok() || !around || around->client != client) return false;
  answer.around = std::move(around->update);
  return true;
}

}  // namespace

Status check_answer(const RelocaliseAnswer& answer) {
  if (answer.epoch == 0) return unsound("epoch is zero");
  if (!answer.found) return {};
  if (!answer.reference.is_valid()) return unsound("reference is no keyframe");
  if (!is_sound(answer.map_from_reference) || !is_sound(answer.map_from_camera))
    return unsound("pose is no similarity");
  if (answer.around.epoch != answer.epoch) return unsound("landmarks are for another run");
  if (answer.around.is_refresh()) return unsound("it would replace the client's map");
  if (Status s = check_map_update(answer.around); !s) return s;
  return check_matches(answer);
}

Result<Blob> encode_answer(std::string_view client, const RelocaliseAnswer& answer) {
  if (Status s = check_client_name(client); !s) return s.error();
  if (Status s = check_answer(answer); !s) return s.error();
  ByteWriter out(512);
  out.put_string(client);
  out.put(answer.epoch);
  out.put(answer.number);
  out.put(static_cast<std::uint8_t>(answer.found));
  if (!answer.found) {
    out.put_string(std::string_view(answer.why).substr(0, kMostWords));
  } else {
    out.put(answer.reference.epoch);
    out.put(answer.reference.sequence);
    put_similarity(out, answer.map_from_reference);
    put_rigid(out, answer.map_from_camera);
    put_matches(out, answer.matches);
    const auto around = encode_map_update(client, answer.around);
    if (!around) return around.error();
    out.put(static_cast<std::uint32_t>(around->size()));
    out.put_bytes(*around);
  }
  if (out.size() > kMaxAnswerBytes - kEnvelopeSize) return unsound("too large").error();
  return seal(kRelocaliseFormat, out.take());
}

Result<DecodedAnswer> decode_answer(Bytes blob) {
  if (blob.size() > kMaxAnswerBytes)
    return Error{ErrorCode::kCorrupt, "answer to a lost client: too large"};
  const Result<Bytes> payload = unseal(kRelocaliseFormat, blob);
  if (!payload) return payload.error();
  const Error malformed{ErrorCode::kCorrupt,
                        "answer to a lost client: contents contradict the format"};
  ByteReader in(*payload);
  DecodedAnswer decoded;
  RelocaliseAnswer& answer = decoded.answer;
  decoded.client = in.get_string();
  answer.epoch = in.get<std::uint64_t>();
  answer.number = in.get<std::uint32_t>();
  const auto found = in.get<std::uint8_t>();
  if (found > 1 || !check_client_name(decoded.client)) return malformed;
  answer.found = found == 1;
  if (!answer.found)
    answer.why = in.get_string();
  else if (!get_place(in, decoded.client, answer))
    return malformed;
  if (!in.at_end() || answer.why.size() > kMostWords) return malformed;
  if (Status s = check_answer(answer); !s) return Error{ErrorCode::kCorrupt, s.message()};
  return decoded;
}

}  // namespace cairn::wire
