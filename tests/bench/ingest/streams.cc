#include "tests/bench/ingest/streams.h"

#include "tests/unit/server/synthetic_map.h"

namespace cairn::bench {

using std::chrono::system_clock;

Result<std::unique_ptr<Link>> connect(const ClientId& client, const std::filesystem::path& outbox,
                                      const dds::ParticipantOptions& dds) {
  LinkOptions options;
  options.client = client;
  options.domain = dds.domain;
  options.dds_config = dds.config;
  options.outbox = outbox;
  return Link::start(options);
}

Result<std::unique_ptr<Stream>> Stream::make(const StreamOptions& options) {
  auto link = connect({options.name, 100 + options.number}, options.outbox, options.dds);
  if (!link) return link.error();
  return std::unique_ptr<Stream>(new Stream(options, std::move(*link)));
}

Stream::Stream(const StreamOptions& options, std::unique_ptr<Link> link)
    : options_(options), link_(std::move(link)) {
  constexpr double kStep = 0.1;
  const double length = kStep * options.keyframes;
  keyframes_ = SyntheticMap({.keyframes = options.keyframes,
                             .points = static_cast<int>(235 * (length + 5)),
                             .seed = options.number,
                             .epoch = 100 + options.number,
                             .step = kStep,
                             .length = length})
                   .keyframes;
}

void Stream::start() {
  thread_ = std::jthread([this](std::stop_token stop) { run(stop); });
}

std::vector<Acknowledged> Stream::stop() {
  thread_.request_stop();
  thread_.join();
  link_->stop();
  return noted_;
}

void Stream::run(std::stop_token stop) {
  const auto period = std::chrono::duration_cast<system_clock::duration>(
      std::chrono::duration<double>(1 / options_.keyframes_per_s));
  // Not all clients at once.
  auto due = system_clock::now() + period * (options_.number % 3) / 3;
  for (const KeyframePtr& keyframe : keyframes_) {
    std::this_thread::sleep_until(due);
    if (stop.stop_requested()) return;
    link_->send(keyframe);
    while (!link_->wait_delivered(std::chrono::seconds(10), stop))
      if (stop.stop_requested()) return;
    const std::chrono::duration<double, std::milli> took = system_clock::now() - due;
    noted_.push_back({due, took.count()});
    while (link_->poll_update()) {
    }
    due += period;
  }
}

}  // namespace cairn::bench
