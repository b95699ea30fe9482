// The qualities of service that Cairn uses, each named once.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "common/dds/entity.h"

namespace cairn::dds {

enum class Quality : std::uint8_t {
  // Client to server: reliable, everything kept until it has arrived. A write waits up to 100 ms
  // for
  // room (longer while the link is down) and may then fail with kTimeout: write again.
  kStream,
  // The latest state of each instance, also for who comes later. Never blocks.
  kState,
  // Server to client: reliable, the last kHistory of each instance, also for who comes later. Never
  // blocks, so that a client that hangs cannot hold up the server; it sees the gap by the
  // revisions.
  kHistory,
  // Reliable, the latest of each instance and only to who is there: what is not yet sent when a
  // newer one is written never is. Never blocks.
  kLatest,
};

inline constexpr std::int32_t kHistoryDepth = 64;

struct QosDeleter {
  void operator()(dds_qos* qos) const;
};
using QosPtr = std::unique_ptr<dds_qos, QosDeleter>;

QosPtr make_qos(Quality quality);
QosPtr make_partition_qos(const std::string& partition);

}  // namespace cairn::dds
