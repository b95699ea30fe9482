// DDS on the loopback interface, apart from every other test that runs at the same time.
#pragma once

#include <unistd.h>

#include <atomic>
#include <cstdint>
#include <string>

#include "common/dds/participant.h"

namespace cairn::testing {

// Two nodes with the same Loopback talk to each other over sockets, as two machines would, although
// they live in one process: each is a DDS domain of its own inside, and the same one outside.
class Loopback {
 public:
  Loopback() {
    static std::atomic<int> count{0};
    tag_ = "cairn-test-" + std::to_string(getpid()) + "-" + std::to_string(count++);
  }

  // Domain and configuration of a further node. Numbers are not used twice in a process, since a
  // domain that is going down still counts as there.
  dds::ParticipantOptions node() const {
    static std::atomic<std::uint32_t> next{1};
    return {next++ % 230, config(/*external_domain=*/0)};
  }

 private:
  std::string config(int external_domain) const {
    return "<CycloneDDS><Domain Id=\"any\"><General><Interfaces><NetworkInterface name=\"lo\"/>"
           "</Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery>"
           "<ExternalDomainId>" +
           std::to_string(external_domain) + "</ExternalDomainId><Tag>" + tag_ +
           "</Tag><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>100"
           "</MaxAutoParticipantIndex><Peers><Peer Address=\"127.0.0.1\"/></Peers>"
           "<SPDPInterval>100ms</SPDPInterval><LeaseDuration>1s</LeaseDuration></Discovery>"
           "</Domain></CycloneDDS>";
  }

  std::string tag_;
};

}  // namespace cairn::testing
