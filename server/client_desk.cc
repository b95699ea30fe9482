#include "server/client_desk.h"

namespace cairn {

ClientDesk::ClientDesk(const ClientId& client, MapWriter& writer,
                       const LocalMappingOptions& options, const PublishOptions& publish)
    : epoch_(client.epoch), mapping_(writer, options), view_(client.epoch, publish) {}

Status ClientDesk::tell(const Map& map, bool settled,
                        const std::function<Status(const MapUpdate&)>& send) {
  const auto kind =
      wants_refresh_.exchange(false) ? ClientView::Kind::kRefresh : ClientView::Kind::kChanges;
  const auto update = view_.difference(map, map.mapped_of(epoch_), kind, settled);
  if (!update) return {};
  Status sent = send(*update);
  if (!sent) refresh();  // the view takes it as told
  return sent;
}

ClientDesks::Entry& ClientDesks::entry(const ClientId& client) {
  Entry& found = entries_[client];
  if (!found.desk) found.desk = make_(client);
  return found;
}

std::shared_ptr<ClientDesk> ClientDesks::of(const ClientId& client) {
  std::lock_guard lock(mutex_);
  return entry(client).desk;
}

std::shared_ptr<ClientDesk> ClientDesks::join(const ClientId& client) {
  std::lock_guard lock(mutex_);
  Entry& joined = entry(client);
  joined.is_there = true;
  return joined.desk;
}

std::shared_ptr<ClientDesk> ClientDesks::leave(const ClientId& client) {
  std::lock_guard lock(mutex_);
  const auto found = entries_.find(client);
  if (found == entries_.end()) return nullptr;
  found->second.is_there = false;
  return found->second.desk;
}

bool ClientDesks::is_there(const ClientId& client) const {
  std::lock_guard lock(mutex_);
  const auto found = entries_.find(client);
  return found != entries_.end() && found->second.is_there;
}

void ClientDesks::release(const ClientId& client) {
  std::shared_ptr<ClientDesk> freed;  // outside of the lock
  std::lock_guard lock(mutex_);
  const auto found = entries_.find(client);
  if (found == entries_.end() || found->second.is_there) return;
  freed = std::move(found->second.desk);
  entries_.erase(found);
}

std::vector<ClientId> ClientDesks::present() const {
  std::lock_guard lock(mutex_);
  std::vector<ClientId> clients;
  for (const auto& [client, entry] : entries_)
    if (entry.is_there) clients.push_back(client);
  return clients;
}

std::size_t ClientDesks::size() const {
  std::lock_guard lock(mutex_);
  return entries_.size();
}

}  // namespace cairn
