#include "server/ingest/channel.h"

#include <utility>
#include <vector>

#include "common/wire/map_update_codec.h"
#include "common/wire/relocalise_codec.h"

namespace cairn {

Result<std::shared_ptr<Channel>> Channel::open(std::shared_ptr<dds::Participant> participant,
                                               const std::string& deployment,
                                               const std::string& client, std::uint64_t server,
                                               std::uint64_t last_revision) {
  const std::string partition = wire::client_partition(deployment, client);
  auto acks = wire::Writer<wire::ServerAckMessage>::create(participant, partition);
  if (!acks) return acks.error();
  auto updates = wire::Writer<wire::MapUpdateMessage>::create(participant, partition);
  if (!updates) return updates.error();
  auto answers =
      wire::Writer<wire::RelocaliseAnswerMessage>::create(std::move(participant), partition);
  if (!answers) return answers.error();
  return std::shared_ptr<Channel>(new Channel(server, last_revision, std::move(*acks),
                                              std::move(*updates), std::move(*answers)));
}

std::uint64_t Channel::last_revision() const {
  std::lock_guard lock(mutex_);
  return revision_;
}

std::uint64_t Channel::revision() const {
  std::lock_guard lock(mutex_);
  return published_ ? revision_ : 0;
}

Status Channel::acknowledge(wire::ServerAckMessage ack) {
  ack.server = server_;
  ack.published_revision = revision();
  return acks_.write(ack);
}

Result<Channel::Published> Channel::publish(const ClientId& client, MapUpdate update) {
  std::lock_guard publishing(publishing_);
  // Only this function, under this lock, changes the revision.
  if (!update.is_refresh()) update.base_revision = revision_;
  update.epoch = client.epoch;
  const std::vector<MapUpdate> parts = wire::split_map_update(update, revision_ + 1);
  std::vector<wire::Blob> blobs;
  for (const MapUpdate& part : parts) {
    auto blob = wire::encode_map_update(client.name, part);
    if (!blob) return blob.error();
    blobs.push_back(std::move(*blob));
  }
  Published published;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const Status s = updates_.write({.client = client,
                                     .server = server_,
                                     .base_revision = parts[i].base_revision,
                                     .revision = parts[i].revision,
                                     .last_part = i + 1 == parts.size(),
                                     .blob = blobs[i]});
    // A part that was not sent leaves a gap, which the client notices.
    std::lock_guard lock(mutex_);
    revision_ = parts[i].revision;
    published_ = true;
    if (!s) return s.error();
    ++published.parts;
    published.bytes += blobs[i].size();
  }
  return published;
}

Result<std::uint64_t> Channel::answer(const ClientId& client, const RelocaliseAnswer& answer) {
  const auto blob = wire::encode_answer(client.name, answer);
  if (!blob) return blob.error();
  const Status s = answers_.write({.client = client, .number = answer.number, .blob = *blob});
  if (!s) return s.error();
  return std::uint64_t{blob->size()};
}

}  // namespace cairn
