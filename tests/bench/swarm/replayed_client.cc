#include "tests/bench/swarm/replayed_client.h"

namespace cairn::bench {

using std::chrono::steady_clock;
using std::chrono::system_clock;

Result<std::unique_ptr<ReplayedClient>> ReplayedClient::make(const RecordedWalk& walk,
                                                             double keyframes_per_s,
                                                             const std::filesystem::path& outbox,
                                                             const dds::ParticipantOptions& dds) {
  LinkOptions options;
  options.client = {walk.name, walk.keyframes.front()->id.epoch};
  options.domain = dds.domain;
  options.dds_config = dds.config;
  options.outbox = outbox;
  Result<std::unique_ptr<Link>> link = Link::start(options);
  if (!link) return link.error();
  return std::unique_ptr<ReplayedClient>(
      new ReplayedClient(walk, keyframes_per_s, std::move(*link)));
}

ReplayedClient::ReplayedClient(const RecordedWalk& walk, double keyframes_per_s,
                               std::unique_ptr<Link> link)
    : walk_(walk),
      period_(static_cast<std::int64_t>(1e9 / keyframes_per_s)),
      link_(std::move(link)) {}

void ReplayedClient::start(std::chrono::nanoseconds delay) {
  thread_ = std::jthread([this, delay] { run(delay); });
}

ReplayResult ReplayedClient::finish() {
  thread_.join();
  for (const auto& [id, pose] : poses_)
    result_.keyframes.push_back({walk_.keyframes.at(id.sequence)->stamp_ns, pose.pose()});
  return std::move(result_);
}

void ReplayedClient::run(std::chrono::nanoseconds delay) {
  auto due = steady_clock::now() + delay;
  listen_until(due);
  const auto started = steady_clock::now();
  for (const KeyframePtr& keyframe : walk_.keyframes) {
    result_.sent[keyframe->id] = system_clock::now();
    link_->send(keyframe);
    ++sent_;
    due += period_;
    listen_until(due);
    result_.backlog.push_back(sent_ - mapped_);
  }
  result_.seconds = std::chrono::duration<double>(steady_clock::now() - started).count();
  result_.link = link_->stats();
  deliver();
  link_->stop();
}

void ReplayedClient::listen_until(steady_clock::time_point end) {
  for (auto now = steady_clock::now(); now < end; now = steady_clock::now())
    if (const auto update = link_->wait_update(end - now)) take(*update);
}

void ReplayedClient::take(const MapUpdate& update) {
  if (update.new_map_from_old_map)
    for (auto& [id, pose] : poses_) pose = *update.new_map_from_old_map * pose;
  for (const KeyframePose& keyframe : update.keyframes)
    poses_[keyframe.id] = keyframe.map_from_camera;
  for (const KeyframeRemoval& removal : update.removed_keyframes)
    if (const auto anchor = poses_.find(removal.anchor); anchor != poses_.end())
      poses_[removal.id] = anchor->second * removal.anchor_from_camera;
  for (; mapped_ < update.mapped_keyframes && mapped_ < sent_; ++mapped_) {
    const std::chrono::duration<double, std::milli> took =
        system_clock::now() - result_.sent.at(walk_.keyframes[mapped_]->id);
    result_.correction_ms.push_back(took.count());
  }
  result_.settled = update.settled;
}

void ReplayedClient::deliver() {
  constexpr auto kPatience = std::chrono::seconds(60);
  if (!link_->wait_delivered(kPatience)) return;
  link_->say_finishing();
  const auto deadline = steady_clock::now() + kPatience;
  while ((!result_.settled || mapped_ < sent_) && steady_clock::now() < deadline)
    if (const auto update = link_->wait_update(std::chrono::seconds(1))) take(*update);
}

}  // namespace cairn::bench
