// The server's answer to a lost client as bytes. The landmarks around go as a map update does
// (map_update_codec.h). The question needs no codec of its own: it is a keyframe's blob.
//
// Pure functions, safe from any thread.
#pragma once

#include <string>
#include <string_view>

#include "common/model/relocalise.h"
#include "common/util/status.h"
#include "common/wire/bytes.h"
#include "common/wire/envelope.h"

namespace cairn::wire {

inline constexpr Format kRelocaliseFormat{"CRNR", 2, "answer to a lost client"};
inline constexpr std::size_t kMaxAnswerBytes = 1 << 18;

// Ranges, matches ascending and of landmarks that the answer tells of.
Status check_answer(const RelocaliseAnswer& answer);

// kInvalidArgument when check_answer objects. Of `why` the first 200 bytes are kept.
Result<Blob> encode_answer(std::string_view client, const RelocaliseAnswer& answer);

struct DecodedAnswer {
  std::string client;
  RelocaliseAnswer answer;
};
Result<DecodedAnswer> decode_answer(Bytes blob);

}  // namespace cairn::wire
