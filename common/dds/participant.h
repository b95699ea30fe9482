// A process's membership of a DDS domain. Configuration comes from the environment variable
// CYCLONEDDS_URI, as everywhere with Cyclone, unless `config` gives it.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "common/dds/entity.h"

namespace cairn::dds {

struct ParticipantOptions {
  std::uint32_t domain = 0;  // 0 to 232
  // XML. A process can configure each domain number once; a second time is an error.
  std::string config;
};

// Shared by the readers and writers made from it, and so outlives them.
class Participant {
 public:
  static Result<std::shared_ptr<Participant>> create(const ParticipantOptions& options);

  std::int32_t handle() const { return participant_.handle(); }

  // For tests: with `cut`, the domain of this participant neither sends nor receives packets.
  // Participants of the same domain number in the same process are not cut from each other.
  Status set_cut(bool cut);

 private:
  Participant(Entity domain, Entity participant)
      : domain_(std::move(domain)), participant_(std::move(participant)) {}

  Entity domain_;  // only with a configuration of its own; goes last
  Entity participant_;
};

}  // namespace cairn::dds
