#include "server/ingest/client_table.h"

#include <utility>

namespace cairn {

ClientTable::Answer ClientTable::on_state(const wire::ClientStateMessage& state,
                                          Clock::time_point now) {
  if (state.protocol != wire::kProtocol)
    return {.refusal = "it speaks protocol " + std::to_string(state.protocol) + ", the server " +
                       std::to_string(wire::kProtocol) + "; install the same version on both",
            .events = {},
            .ended = {}};
  if (state.leaving) return leave(state, now);
  const auto it = sessions_.find(state.client.name);
  if (it == sessions_.end()) return join(state, now);
  Session& session = it->second;
  if (session.client.epoch != state.client.epoch) {
    if (session.connected(now))
      return {.refusal = "a client of that name is connected; choose another with --name",
              .events = {},
              .ended = {}};
    return join(state, now);
  }
  Answer answer;
  session.last_seen = now;
  if (session.refresh_requests != state.refresh_requests)
    answer.events.push_back({ClientEvent::Kind::kRefresh, session.client, session.sensor, {}});
  session.refresh_requests = state.refresh_requests;
  if (state.finishing && !session.finishing)
    answer.events.push_back({ClientEvent::Kind::kFinishing, session.client, session.sensor, {}});
  session.finishing = state.finishing;
  return answer;
}

ClientTable::Answer ClientTable::leave(const wire::ClientStateMessage& state,
                                       Clock::time_point now) {
  Answer answer;
  const auto it = sessions_.find(state.client.name);
  if (it == sessions_.end() || it->second.client != state.client) return answer;
  answer.events.push_back({ClientEvent::Kind::kLeft, state.client, it->second.sensor, {}});
  it->second.last_seen = now;
  answer.ended.push_back(std::move(it->second));
  sessions_.erase(it);
  return answer;
}

ClientTable::Answer ClientTable::join(const wire::ClientStateMessage& state,
                                      Clock::time_point now) {
  Answer answer;
  const auto it = sessions_.find(state.client.name);
  if (it == sessions_.end() && sessions_.size() >= kMaxClients) {
    answer.refusal = "it serves " + std::to_string(kMaxClients) + " clients already";
    return answer;
  }
  if (it != sessions_.end()) {
    answer.events.push_back({ClientEvent::Kind::kLeft, it->second.client, it->second.sensor, {}});
    answer.ended.push_back(std::move(it->second));
  }
  sessions_[state.client.name] = {.client = state.client,
                                  .sensor = state.sensor,
                                  .last_seen = now,
                                  .refresh_requests = state.refresh_requests,
                                  .finishing = state.finishing,
                                  .joined = now,
                                  .traffic = {},
                                  .runs = {state.client.epoch}};
  answer.events.push_back({ClientEvent::Kind::kJoined, state.client, state.sensor, state.lockstep});
  if (state.finishing)
    answer.events.push_back({ClientEvent::Kind::kFinishing, state.client, state.sensor, {}});
  return answer;
}

ClientTable::Answer ClientTable::expire(Clock::time_point now, std::chrono::milliseconds silence) {
  Answer answer;
  for (auto it = sessions_.begin(); it != sessions_.end();) {
    Session& session = it->second;
    if (now - session.last_seen < silence) {
      ++it;
      continue;
    }
    answer.events.push_back({ClientEvent::Kind::kLeft, session.client, session.sensor, {}});
    answer.ended.push_back(std::move(session));
    it = sessions_.erase(it);
  }
  return answer;
}

ClientTable::Session* ClientTable::deliverer(const ClientId& client) {
  const auto it = sessions_.find(client.name);
  if (it == sessions_.end()) return nullptr;
  Session& session = it->second;
  if (!session.runs.contains(client.epoch)) {
    if (session.runs.size() >= kMaxRuns) return nullptr;
    session.runs.insert(client.epoch);
  }
  return &session;
}

ClientTable::Session* ClientTable::named(const std::string& name) {
  const auto it = sessions_.find(name);
  return it == sessions_.end() ? nullptr : &it->second;
}

const ClientTable::Session* ClientTable::find(const ClientId& client) const {
  const auto it = sessions_.find(client.name);
  return it == sessions_.end() || it->second.client != client ? nullptr : &it->second;
}

}  // namespace cairn
