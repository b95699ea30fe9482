#include "server/server_metrics.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace cairn {

void RecentValues::add(double value) {
  std::lock_guard lock(mutex_);
  if (values_.size() < capacity_)
    values_.push_back(value);
  else
    values_[next_] = value;
  next_ = (next_ + 1) % capacity_;
}

double RecentValues::quantile(double share) const {
  std::vector<double> sorted;
  {
    std::lock_guard lock(mutex_);
    sorted = values_;
  }
  if (sorted.empty()) return 0;
  const auto at = static_cast<std::ptrdiff_t>(share * static_cast<double>(sorted.size() - 1));
  std::nth_element(sorted.begin(), sorted.begin() + at, sorted.end());
  return sorted[static_cast<std::size_t>(at)];
}

namespace {

struct Topic {
  const char* name;
  std::uint64_t Traffic::*bytes;
};
// As the DDS topics are called, without what they all have in common.
constexpr Topic kTopics[] = {{"keyframe", &Traffic::keyframes},
                             {"relocalise_request", &Traffic::questions},
                             {"map_update", &Traffic::map_updates},
                             {"relocalise_answer", &Traffic::answers}};

nlohmann::json bytes_by_topic(const Traffic& traffic) {
  nlohmann::json json;
  for (const Topic& topic : kTopics) json[topic.name] = traffic.*topic.bytes;
  return json;
}

double kilobytes_a_second(std::uint64_t bytes, double seconds) {
  return seconds > 0 ? std::round(static_cast<double>(bytes) / seconds / 100) / 10 : 0.0;
}

// Client names are letters, digits and a few signs that need no escape (check_client_name).
void add_traffic(const ServerState& s, std::string& text) {
  text +=
      "# HELP cairn_client_bytes_total Bytes by topic since the client joined\n"
      "# TYPE cairn_client_bytes_total counter\n";
  for (const ClientInfo& c : s.clients)
    for (const Topic& topic : kTopics)
      text += fmt::format("cairn_client_bytes_total{{client=\"{}\",topic=\"{}\"}} {}\n",
                          c.client.name, topic.name, c.traffic.*topic.bytes);
}

}  // namespace

std::string to_json(const ServerState& s) {
  nlohmann::json json;
  json["uptime_s"] = s.uptime_s;
  json["map"] = {{"id", fmt::format("{:016x}", s.map_id)},
                 {"revision", s.map_revision},
                 {"keyframes", s.keyframes},
                 {"keyframes_ever", s.keyframes_ever},
                 {"landmarks", s.landmarks}};
  json["mapping"] = {{"waiting", s.awaiting_mapping},
                     {"mapped", s.mapped},
                     {"runs", s.desks},
                     {"ms_median", s.mapping_ms_median},
                     {"ms_p95", s.mapping_ms_p95},
                     {"solve_ms_median", s.solving_ms_median},
                     {"answer_ms_median", s.answer_ms_median},
                     {"answer_ms_p95", s.answer_ms_p95}};
  json["relocalisation"] = {
      {"asked", s.ingest.questions}, {"found", s.located}, {"ms_median", s.locate_ms_median}};
  json["ingest"] = {
      {"accepted", s.ingest.accepted},        {"duplicates", s.ingest.duplicates},
      {"malformed", s.ingest.malformed},      {"journal_failures", s.ingest.journal_failures},
      {"refused", s.ingest.refused},          {"bytes_in", s.ingest.traffic.up()},
      {"bytes_out", s.ingest.traffic.down()}, {"queued", s.ingest.queued}};
  json["bytes"] = bytes_by_topic(s.ingest.traffic);
  json["clients"] = nlohmann::json::array();
  for (const ClientInfo& c : s.clients)
    json["clients"].push_back({{"name", c.client.name},
                               {"epoch", fmt::format("{:016x}", c.client.epoch)},
                               {"connected", c.connected},
                               {"queued", c.queued},
                               {"keyframes", c.next_sequence},
                               {"bytes", bytes_by_topic(c.traffic)},
                               {"up_kB_per_s", kilobytes_a_second(c.traffic.up(), c.seconds)},
                               {"down_kB_per_s", kilobytes_a_second(c.traffic.down(), c.seconds)}});
  return json.dump(2) + "\n";
}

std::string to_prometheus(const ServerState& s) {
  std::string text;
  const auto add = [&](const char* type, const char* name, const char* help, double value) {
    text += fmt::format("# HELP cairn_{0} {1}\n# TYPE cairn_{0} {2}\ncairn_{0} {3}\n", name, help,
                        type, value);
  };
  const auto gauge = [&](const char* name, const char* help, auto value) {
    add("gauge", name, help, static_cast<double>(value));
  };
  const auto counter = [&](const char* name, const char* help, auto value) {
    add("counter", name, help, static_cast<double>(value));
  };
  gauge("uptime_seconds", "Time since the start", s.uptime_s);
  gauge("keyframes", "Keyframes in the map", s.keyframes);
  gauge("landmarks", "Landmarks in the map", s.landmarks);
  gauge("awaiting_mapping", "Keyframes in the map that local mapping has not seen",
        s.awaiting_mapping);
  gauge("clients", "Clients known", s.clients.size());
  gauge("mapping_ms_median",
        "Local mapping of one keyframe without the solve, median of the recent ones",
        s.mapping_ms_median);
  gauge("answer_ms_median", "From a keyframe's arrival to its corrections sent, median",
        s.answer_ms_median);
  gauge("answer_ms_p95", "From a keyframe's arrival to its corrections sent, 95th percentile",
        s.answer_ms_p95);
  counter("keyframes_accepted_total", "Keyframes journaled and acknowledged", s.ingest.accepted);
  counter("keyframes_duplicate_total", "Keyframes that came again", s.ingest.duplicates);
  counter("keyframes_mapped_total", "Keyframes that have been through local mapping", s.mapped);
  counter("keyframes_malformed_total", "Keyframes that failed the checks", s.ingest.malformed);
  counter("relocalisations_asked_total", "Views of clients that do not know where they are",
          s.ingest.questions);
  counter("relocalisations_found_total", "Those that were answered with a place", s.located);
  gauge("relocalisation_ms_median", "From such a view's arrival to its answer sent, median",
        s.locate_ms_median);
  counter("journal_failures_total", "Keyframes that could not be journaled",
          s.ingest.journal_failures);
  counter("received_bytes_total", "Bytes of keyframes and questions received",
          s.ingest.traffic.up());
  counter("sent_bytes_total", "Bytes of map updates and answers sent", s.ingest.traffic.down());
  add_traffic(s, text);
  return text;
}

}  // namespace cairn
