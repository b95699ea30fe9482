#include "common/dds/participant.h"

#include <dds/dds.h>

namespace cairn::dds {

Result<std::shared_ptr<Participant>> Participant::create(const ParticipantOptions& options) {
  const std::string number = std::to_string(options.domain);
  if (options.domain > 232)
    return Error{ErrorCode::kInvalidArgument, "DDS domain " + number + ": use 0 to 232"};
  Entity domain;
  if (!options.config.empty()) {
    auto made = own("DDS configuration of domain " + number,
                    dds_create_domain(options.domain, options.config.c_str()));
    if (!made) return made.error();
    domain = std::move(*made);
  }
  auto participant = own("joining DDS domain " + number + " (check the network and CYCLONEDDS_URI)",
                         dds_create_participant(options.domain, nullptr, nullptr));
  if (!participant) return participant.error();
  return std::shared_ptr<Participant>(new Participant(std::move(domain), std::move(*participant)));
}

Status Participant::set_cut(bool cut) {
  const dds_return_t rc = dds_domain_set_deafmute(handle(), cut, cut, DDS_INFINITY);
  if (rc < 0) return dds_error("cutting the network", rc);
  return {};
}

}  // namespace cairn::dds
