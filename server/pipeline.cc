#include "server/pipeline.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "common/util/clock.h"
#include "common/util/log.h"
#include "common/util/thread.h"
#include "server/optimize/local_ba.h"
#include "server/place/default_vocabulary.h"

namespace cairn {
namespace {

using Clock = std::chrono::steady_clock;

std::uint64_t random_id() {
  std::random_device device;
  std::uint64_t id = 0;
  while (id == 0) id = (std::uint64_t{device()} << 32) | device();
  return id;
}

double milliseconds_since(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

ClientId client_of(const std::vector<ClientId>& clients, KeyframeId id) {
  for (const ClientId& client : clients)
    if (client.epoch == id.epoch) return client;
  return {"unknown", id.epoch};
}

MapDelta solve(const Map& map, const LocalWindow& window, std::stop_token stop) {
  LocalBaSummary summary;
  MapDelta delta = solve_local_ba(map, window, {}, &summary, stop);
  log::debug(
      "local BA: {} keyframes, {} fixed, {} landmarks, {} observations, {} outliers, "
      "{:.0f} ms: {}",
      summary.keyframes, summary.fixed_keyframes, summary.landmarks, summary.observations,
      summary.outliers, summary.extract_ms + summary.solve_ms, summary.message);
  return delta;
}

LocalWindowOptions window_options(const ServerConfig& config) {
  LocalWindowOptions options;
  options.max_free = static_cast<std::size_t>(config.local_window);
  return options;
}

LocalAdjusterOptions adjuster_options(const ServerConfig& config) {
  LocalAdjusterOptions options;
  options.window = window_options(config);
  options.cull.keyframe_budget = config.keyframe_budget;
  options.cull.landmark_budget = config.landmark_budget;
  return options;
}

}  // namespace

Result<std::unique_ptr<Pipeline>> Pipeline::start(const ServerConfig& config) {
  Result<std::unique_ptr<MapFile>> file = MapFile::open(config.map_file);
  if (!file) return file.error();
  Result<std::optional<Map>> loaded = (*file)->load_map();
  if (!loaded) return loaded.error();
  Map map;
  if (*loaded) {
    map = std::move(**loaded);
  } else {
    map.id = {random_id()};
    // Clients will hear this id: who is killed before the first save must come back with it.
    if (!config.map_file.empty())
      if (const auto saved = (*file)->save_map(map); !saved) return saved.error();
  }
  if (config.map_file.empty())
    log::warn("no map file given (--map FILE.db): the map is gone when the server ends");
  else
    log::info("map {}: {} keyframes, {} landmarks", config.map_file, map.keyframes.size(),
              map.landmarks.size());

  std::unique_ptr<Pipeline> pipeline(new Pipeline(config, std::move(*file), std::move(map)));
  if (Status s = pipeline->start_closing_loops(); !s) return s.error();
  if (Status s = pipeline->replay_journal(); !s) return s.error();
  if (Status s = pipeline->start_receiving(); !s) return s.error();
  return pipeline;
}

Pipeline::Pipeline(const ServerConfig& config, std::unique_ptr<MapFile> file, Map map)
    : config_(config),
      file_(std::move(file)),
      writer_(std::move(map)),
      desks_([this](const ClientId& client) {
        return std::make_shared<ClientDesk>(client, writer_, LocalMappingOptions{},
                                            config_.publish);
      }),
      adjuster_(writer_, solve, adjuster_options(config)) {}

Pipeline::~Pipeline() {
  if (!stopped_) (void)stop();
}

// Keyframes that were acknowledged and not mapped when the map was saved last: a crash costs their
// mapping only. First those that the map has, then those that came after it was saved.
Status Pipeline::replay_journal() {
  Result<std::vector<wire::DecodedKeyframe>> pending = file_->pending_keyframes();
  if (!pending) return pending.error();
  const Result<std::vector<ClientId>> clients = file_->clients();
  if (!clients) return clients.error();
  const std::vector<KeyframeId> unmapped = writer_.snapshot()->unmapped();
  if (!unmapped.empty() || !pending->empty())
    log::info("{} journaled keyframes to map again", unmapped.size() + pending->size());
  for (const KeyframeId id : unmapped)
    push_keyframe(client_of(*clients, id), id, Clock::now(), Origin::kFile);
  for (wire::DecodedKeyframe& decoded : *pending)
    insert(decoded.client, std::move(decoded.keyframe), Clock::now(), Origin::kFile);
  return {};
}

Status Pipeline::start_closing_loops() {
  if (!config_.close_loops) return {};
  Result<Vocabulary> vocabulary =
      config_.vocabulary.empty() ? default_vocabulary() : Vocabulary::load(config_.vocabulary);
  if (!vocabulary) return vocabulary.error();
  LoopCloserOptions options;
  options.verify = config_.verify;
  options.window = window_options(config_);
  LoopCloserHooks hooks;
  hooks.solve = solve;
  hooks.mapping_waits = [this] { return awaiting_mapping(); };
  if (!config_.map_file.empty())
    hooks.keep = [this](const Map& before) -> Status {
      const Result<CheckpointSummary> kept = file_->save_checkpoint(before);
      return kept ? Status() : kept.error();
    };
  hooks.changed = [this] { tell_everyone(); };
  const auto words = std::make_shared<const Vocabulary>(std::move(*vocabulary));
  closer_ = std::make_unique<LoopCloser>(writer_, words, options, std::move(hooks));
  relocaliser_ = std::make_unique<Relocaliser>(writer_, closer_->index(), words);
  return {};
}

std::size_t Pipeline::awaiting_mapping() const {
  return unextended_ + adjuster_.waiting();
}

// On any thread: must not block.
void Pipeline::tell_everyone() {
  for (const ClientId& client : desks_.present()) {
    const auto desk = desks_.of(client);
    // One in lockstep hears of all that follows from a keyframe with its answer.
    if (desk->lockstep && !closer_->settled(client.epoch)) continue;
    if (!desk->event_waits.exchange(true)) jobs_.push(client, Job{});
  }
}

Status Pipeline::start_receiving() {
  IngestOptions options;
  options.domain = config_.domain;
  options.partition = config_.partition;
  options.queue_capacity = config_.queue_capacity;
  options.map = writer_.snapshot()->id;
  options.forget_after = std::chrono::milliseconds(std::llround(1000 * config_.forget_client_s));
  options.on_event = [this](const ClientEvent& event) { on_client_event(event); };
  options.on_question = [this](const ClientId& client, KeyframePtr view) {
    on_question(client, std::move(view));
  };
  Result<std::unique_ptr<Ingest>> ingest = Ingest::start(options, *file_);
  if (!ingest) return ingest.error();
  ingest_ = std::move(*ingest);
  if (relocaliser_)
    relocaliser_->start([this](const auto& client, const auto& answer, double milliseconds) {
      send_answer(client, answer, milliseconds);
    });
  if (!config_.http.empty()) {
    const StatusPages pages{[this] { return to_json(state()); },
                            [this] { return to_prometheus(state()); }};
    Result<std::unique_ptr<StatusServer>> http = StatusServer::start(config_.http, pages);
    if (!http) return http.error();
    http_ = std::move(*http);
    log::info("status at http://{}:{}/status", config_.http.substr(0, config_.http.rfind(':')),
              http_->port());
  }

  for (int i = 0; i < config_.mapping_threads; ++i)
    mappers_.emplace_back([this] {
      name_this_thread("mapping");
      map_keyframes();
    });
  inserter_ = std::jthread([this] {
    name_this_thread("inserter");
    insert_keyframes();
  });
  saver_ = std::jthread([this](std::stop_token stop) {
    name_this_thread("saver");
    save_now_and_then(stop);
  });
  log::info("ready: domain {}, partition {}", config_.domain, config_.partition);
  return {};
}

// On ingest's thread: must not block.
void Pipeline::on_client_event(const ClientEvent& event) {
  const bool left = event.kind == ClientEvent::Kind::kLeft;
  const auto desk = left ? desks_.leave(event.client) : desks_.join(event.client);
  if (!desk) return;
  const bool finishing = event.kind == ClientEvent::Kind::kFinishing;
  // In its turn: behind the keyframes that wait to be mapped.
  if (finishing) jobs_.push(event.client, Job{Job::Kind::kFinish, {}});
  if (event.kind == ClientEvent::Kind::kJoined) desk->lockstep = event.lockstep;
  if (closer_ && left) closer_->forget(event.client.epoch);
  if (relocaliser_ && left) relocaliser_->forget(event.client);
  if (!left && !finishing) desk->refresh();
  if (!desk->event_waits.exchange(true)) jobs_.push(event.client, Job{});
}

// On ingest's thread. The answer will hold in the map as it is now: the client must have heard of
// all that has moved in it.
void Pipeline::on_question(const ClientId& client, KeyframePtr view) {
  if (!relocaliser_ || !desks_.is_there(client)) return;
  if (!desks_.of(client)->event_waits.exchange(true)) jobs_.push(client, Job{});
  relocaliser_->ask(client, std::move(view));
}

void Pipeline::send_answer(const ClientId& client, const RelocaliseAnswer& answer,
                           double milliseconds) {
  metrics_.locate_ms.add(milliseconds);
  metrics_.located += answer.found;
  if (Status s = ingest_->answer(client, answer); !s)
    return log::debug("no answer to {}: {}", client.name, s.message());
  if (answer.found)
    log::info("{} is at keyframe {} of run {:x}: {} landmarks fit, found in {:.0f} ms", client.name,
              answer.reference.sequence, answer.reference.epoch, answer.matches.size(),
              milliseconds);
  else
    log::debug("{} is nowhere to be found: {}; {:.0f} ms", client.name, answer.why, milliseconds);
}

void Pipeline::insert(const ClientId& client, KeyframePtr keyframe, Clock::time_point arrived,
                      Origin origin) {
  const KeyframeId id = keyframe->id;
  const Applied applied = writer_.submit(std::move(keyframe));
  log::debug("keyframe {} of {}: {} matches accepted, {} landmarks made, {} matches rejected",
             id.sequence, client.name, applied.keyframe.accepted, applied.keyframe.created,
             applied.keyframe.rejected);
  push_keyframe(client, id, arrived, origin);
}

void Pipeline::push_keyframe(const ClientId& client, KeyframeId id, Clock::time_point arrived,
                             Origin origin) {
  under_way_.add(id, {client, arrived, origin == Origin::kClient});
  ++unextended_;
  jobs_.push(client, Job{Job::Kind::kMap, id});
}

void Pipeline::insert_keyframes() {
  while (auto incoming = ingest_->next())
    insert(incoming->client, std::move(incoming->keyframe), incoming->arrived, Origin::kClient);
}

void Pipeline::map_keyframes() {
  while (const auto taken = jobs_.take()) {
    const ClientId& client = taken->party;
    const std::shared_ptr<ClientDesk> desk = desks_.of(client);
    carry_out(client, *desk, taken->item);
    if (taken->behind == 0) desks_.release(client);
    jobs_.done(client);
    // Whoever takes the last answer comes by here too.
    if (!jobs_.has_urgent()) adjust_what_waits();
  }
}

void Pipeline::carry_out(const ClientId& client, ClientDesk& desk, const Job& job) {
  switch (job.kind) {
    case Job::Kind::kMap:
      return extend(client, desk, job.keyframe);
    case Job::Kind::kAnswer:
      return answer(client, desk, job.keyframe);
    case Job::Kind::kTell:
      desk.event_waits = false;
      (void)tell(client, desk);
      return;
    case Job::Kind::kFinish:
      if (!under_way_.finish_later(client.epoch)) finish(client);
      (void)tell(client, desk);
  }
}

void Pipeline::extend(const ClientId& client, ClientDesk& desk, KeyframeId id) {
  --unextended_;
  const LocalMappingReport report = desk.extend(id, awaiting_mapping());
  log::debug(
      "extended keyframe {} of {} in {:.0f} ms: {} made, {} fused, {} added, {} landmarks culled",
      id.sequence, client.name, report.total_ms, report.landmarks_made, report.fused,
      report.observations_added, report.landmarks_culled);
  metrics_.mapping_ms.add(report.total_ms);
  adjuster_.add(id);
}

// With no client's desk in hand: a solve serves keyframes of several. Until there is someone to be
// answered, which goes before the next solve.
void Pipeline::adjust_what_waits() {
  bool answers = false;
  while (!answers) {
    const LocalAdjustment done = adjuster_.adjust(unextended_);
    if (done.keyframes.empty()) return;
    if (done.solved) metrics_.solving_ms.add(done.solve_ms);
    log::debug("adjusted around {} keyframes in {:.0f} ms: {} keyframes culled",
               done.keyframes.size(), done.window_ms + done.solve_ms + done.cull_ms,
               done.keyframes_culled);
    for (const KeyframeId id : done.keyframes) answers |= on_mapped(id);
  }
}

// Whether there is somebody to tell.
bool Pipeline::on_mapped(KeyframeId id) {
  ++metrics_.mapped;
  if (closer_) closer_->offer(id);
  const auto client = under_way_.client_of(id);
  if (!client) return false;
  const Job job{Job::Kind::kAnswer, id};
  // One in lockstep is answered when all that follows is done: others don't wait for that.
  if (desks_.of(*client)->lockstep)
    jobs_.push(*client, job);
  else
    jobs_.push_urgent(*client, job);
  return true;
}

void Pipeline::answer(const ClientId& client, ClientDesk& desk, KeyframeId id) {
  if (closer_ && desk.lockstep) closer_->wait_idle();
  const auto entry = under_way_.take(id);
  if (tell(client, desk) && entry) metrics_.answer_ms.add(milliseconds_since(entry->arrived));
  if (entry && entry->counts) ingest_->done(client);
  if (under_way_.finished(client.epoch)) finish(client);
}

void Pipeline::finish(const ClientId& client) {
  if (closer_) closer_->finish(client.epoch);
}

// False: the client is not there, or could not be told.
bool Pipeline::tell(const ClientId& client, ClientDesk& desk) {
  if (!desks_.is_there(client)) return false;
  // Before the snapshot: what is settled then is in it.
  const bool settled = !closer_ || closer_->settled(client.epoch);
  const Status told = desk.tell(*writer_.snapshot(), settled, [&](const MapUpdate& update) {
    return ingest_->publish(client, update);
  });
  if (!told) log::debug("no update to {}: {}", client.name, told.message());
  return told.ok();
}

void Pipeline::save_now_and_then(std::stop_token stop) {
  std::mutex mutex;
  std::condition_variable_any stopped;
  const auto pause = std::chrono::duration<double>(config_.save_every_s);
  std::unique_lock lock(mutex);
  while (!stopped.wait_for(lock, stop, pause, [&] { return stop.stop_requested(); }))
    if (Status s = save(); !s) log::error("{}", s.message());
}

Status Pipeline::save() {
  const Snapshot map = writer_.snapshot();
  if (config_.map_file.empty() || map->revision == saved_revision_) return {};
  const Result<SaveSummary> saved = file_->save_map(*map);
  if (!saved) return saved.error();
  saved_revision_ = map->revision;
  log::info("saved {} keyframes and {} landmarks to {} in {:.0f} ms", map->keyframes.size(),
            map->landmarks.size(), config_.map_file, saved->milliseconds);
  return {};
}

Status Pipeline::stop() {
  stopped_ = true;
  // A start that failed leaves the file as it was.
  const bool receiving = inserter_.joinable();
  if (ingest_) ingest_->close();
  if (relocaliser_) relocaliser_->close();
  if (inserter_.joinable()) inserter_.join();
  jobs_.close();
  if (closer_) closer_->stop_adjusting();  // a mapper may wait for it
  mappers_.clear();                        // each ends when the jobs are done
  if (closer_) closer_->close();
  saver_.request_stop();
  if (saver_.joinable()) saver_.join();
  http_.reset();
  return receiving ? save() : Status();
}

ServerState Pipeline::state() const {
  const Snapshot map = writer_.snapshot();
  ServerState state;
  state.map_id = map->id.value;
  state.map_revision = map->revision;
  state.keyframes = map->keyframes.size();
  state.landmarks = map->landmarks.size();
  state.keyframes_ever = map->keyframes_ever;
  state.awaiting_mapping = awaiting_mapping();
  state.mapped = metrics_.mapped;
  state.desks = desks_.size();
  state.uptime_s = started_.milliseconds() / 1000;
  state.mapping_ms_median = metrics_.mapping_ms.quantile(0.5);
  state.mapping_ms_p95 = metrics_.mapping_ms.quantile(0.95);
  state.solving_ms_median = metrics_.solving_ms.quantile(0.5);
  state.answer_ms_median = metrics_.answer_ms.quantile(0.5);
  state.answer_ms_p95 = metrics_.answer_ms.quantile(0.95);
  state.located = metrics_.located;
  state.locate_ms_median = metrics_.locate_ms.quantile(0.5);
  if (ingest_) {
    state.ingest = ingest_->stats();
    state.clients = ingest_->clients();
  }
  return state;
}

}  // namespace cairn
