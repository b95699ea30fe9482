#include "client/session.h"

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <random>

#include "client/capture/frame_source.h"
#include "client/frontend/frontend.h"
#include "client/link/link.h"
#include "client/pacer.h"
#include "client/tracking/tracker.h"
#include "common/util/clock.h"
#include "common/util/log.h"

namespace cairn {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;
using std::chrono::nanoseconds;

constexpr int kMaxBacklog = 3;                    // keyframes awaiting mapping, with --max-rate
constexpr milliseconds kLinkCheck{100};           // how soon a wait notices that the link is down
constexpr std::chrono::seconds kConnectGrace{5};  // --max-rate goes on without a server after this
// The server answers the heartbeat of every second. A second longer without an answer, and
// keyframes are chosen as if there were none.
constexpr std::chrono::seconds kAnswerGrace{2};
// With --max-rate or --lockstep: how long a lost client waits for the server to say where it is.
constexpr std::chrono::seconds kAnswerPatience{2};
// With --lockstep: how long the first of two keyframes is waited for before the second is sent.
constexpr std::chrono::seconds kLockstepPatience{5};
constexpr std::chrono::seconds kProgressEvery{5};
// How long an interrupted client still tries to deliver; the outbox keeps the rest for later.
constexpr std::chrono::seconds kInterruptedPatience{2};

std::uint64_t random_epoch() {
  std::random_device device;
  std::uint64_t epoch = 0;
  while (epoch == 0) epoch = (std::uint64_t{device()} << 32) | device();
  return epoch;
}

// The parts of a run and the steps that it is made of.
class Session {
 public:
  Session(const SessionOptions& options, std::stop_token stop)
      : options_(options), stop_(std::move(stop)) {}

  Result<SessionReport> run();

 private:
  Status open();
  Status process(const Frame& frame);
  void meet_server();
  void look_after_link();
  void take_corrections(nanoseconds at_most);
  void take_answer(const RelocaliseAnswer& answer);
  void wait_for_answer();
  void send(const TrackingResult& result);
  void apply(const MapUpdate& update);
  Status wait_for_mapping(int backlog, Clock::time_point deadline, bool only_while_connected);
  void wait_for_delivery(Clock::time_point deadline);
  void wait_for_last_corrections(Clock::time_point deadline);
  Status after_keyframe();
  Status finish();
  void show_progress();

  const SessionOptions& options_;
  const std::stop_token stop_;
  std::unique_ptr<FrameSource> source_;
  std::unique_ptr<Frontend> frontend_;
  std::unique_ptr<Tracker> tracker_;
  std::unique_ptr<Link> link_;
  std::map<std::uint32_t, Clock::time_point> sent_;  // keyframes not mapped yet
  // With the server, last; the start counts too.
  const Clock::time_point started_ = Clock::now();
  Clock::time_point in_touch_ = started_;
  bool settled_ = false;  // the server has no more corrections under way
  bool answers_ = true;   // as far as known: to the question where this is
  Clock::time_point next_progress_ = Clock::now() + kProgressEvery;
  SessionReport report_;
};

// That the trajectory can be written should show before the run and not after it. Leaves what is
// there as it is.
Status check_writable(const std::string& file) {
  namespace fs = std::filesystem;
  std::error_code ignored;
  const bool is_new = !fs::exists(file, ignored);
  if (!is_new && fs::is_other(file, ignored)) return {};  // a pipe: opening it would wait
  const bool opens = std::ofstream(file, std::ios::app).is_open();
  if (opens && is_new) fs::remove(file, ignored);
  if (opens) return {};
  return {ErrorCode::kInvalidArgument,
          fmt::format("--trajectory {}: can't be written; does the folder exist?", file)};
}

Status Session::open() {
  if (!options_.trajectory.empty())
    if (Status s = check_writable(options_.trajectory); !s) return s;
  Result<std::unique_ptr<FrameSource>> source = open_source(options_.input, options_.config.camera);
  if (!source) return source.error();
  source_ = std::move(*source);
  frontend_ = std::make_unique<Frontend>(source_->camera(), options_.config.frontend);

  const ClientId client{options_.name, random_epoch()};
  TrackerOptions tracking = options_.config.tracker;
  tracking.keep_every_pose = !options_.trajectory.empty();
  tracker_ =
      std::make_unique<Tracker>(client.epoch, std::make_shared<Rig>(frontend_->rig()), tracking);
  tracker_->set_has_server(!options_.no_server);

  LinkOptions link;
  link.client = client;
  link.sensor = source_->camera().sensor;
  link.domain = options_.config.domain;
  link.partition = options_.config.partition;
  link.outbox = options_.outbox.empty() ? options_.name + ".outbox" : options_.outbox;
  link.no_server = options_.no_server;
  link.lockstep = options_.lockstep;
  Result<std::unique_ptr<Link>> started = Link::start(link);
  if (!started) return started.error();
  link_ = std::move(*started);
  return {};
}

// Without depth a map can't start at the first frame, but the camera may begin in the server's.
// Where frames don't come by the clock there is time to hear of it.
void Session::meet_server() {
  const bool can_wait = options_.lockstep || options_.max_rate;
  if (options_.no_server || !can_wait || source_->camera().sensor != Sensor::kMono) return;
  const auto deadline = Clock::now() + kAnswerPatience;
  while (tracker_->map().id() == MapId{} && !stop_.stop_requested() && Clock::now() < deadline)
    take_corrections(kLinkCheck);
}

void Session::look_after_link() {
  const LinkStats link = link_->stats();
  const auto now = Clock::now();
  if (link.connected) in_touch_ = now;
  tracker_->set_in_touch(link.connected);
  tracker_->set_has_server(!options_.no_server &&
                           now - std::max(started_, link.heard) < kAnswerGrace);
}

// What another map's server does not get from the outbox has gone into the lost map.
void Session::apply(const MapUpdate& update) {
  log::debug("update {} -> {}: {} mapped, {} keyframes, {} landmarks, {} moved, {} removed",
             update.base_revision, update.revision, update.mapped_keyframes,
             update.keyframes.size(), update.landmarks.size(), update.moved_landmarks.size(),
             update.removed_landmarks.size());
  const bool lost = tracker_->map().is_of_another_map(update);
  tracker_->apply(update);
  settled_ = update.settled;
  if (!lost) return;
  const std::uint64_t made = tracker_->keyframes_made();
  const std::uint64_t waiting = std::min(made, link_->stats().keyframes_in_outbox);
  tracker_->write_off(static_cast<std::uint32_t>(made - waiting));
}

void Session::take_corrections(nanoseconds at_most) {
  look_after_link();
  auto update =
      at_most > nanoseconds::zero() ? link_->wait_update(at_most, stop_) : link_->poll_update();
  for (; update; update = link_->poll_update()) {
    apply(*update);
    const auto now = Clock::now();
    while (!sent_.empty() && sent_.begin()->first < tracker_->keyframes_mapped()) {
      report_.correction_ms.push_back(
          std::chrono::duration<double, std::milli>(now - sent_.begin()->second).count());
      sent_.erase(sent_.begin());
    }
  }
  if (const auto answer = link_->poll_answer()) take_answer(*answer);
}

Status Session::process(const Frame& frame) {
  const Stopwatch watch;
  ObservedFrame observed = frontend_->process(frame);
  report_.extraction_ms.push_back(watch.milliseconds());
  const TrackingResult result = tracker_->track(observed.stamp_ns, std::move(observed.features));
  report_.tracking_ms.push_back(watch.milliseconds());
  send(result);
  ++report_.frames;
  report_.tracked += result.state == TrackingState::kTracking;
  report_.tracked += static_cast<std::uint64_t>(result.earlier_frames);
  if (result.question) wait_for_answer();
  return result.keyframe || result.question ? after_keyframe() : Status();
}

void Session::send(const TrackingResult& result) {
  for (const KeyframePtr& keyframe : {result.first_keyframe, result.keyframe}) {
    if (!keyframe) continue;
    // A monocular map starts with two. The answer to the first must not depend on whether the
    // server has the second yet.
    if (keyframe != result.first_keyframe && result.first_keyframe && options_.lockstep &&
        !options_.no_server)
      (void)wait_for_mapping(1, Clock::now() + kLockstepPatience, false);
    sent_[keyframe->id.sequence] = Clock::now();
    link_->send(keyframe);
  }
  if (result.question) link_->ask(result.question);
}

void Session::take_answer(const RelocaliseAnswer& answer) {
  answers_ = true;
  const TrackingResult result = tracker_->take(answer);
  send(result);
  report_.tracked += result.keyframe != nullptr;  // the frame asked about, which had been lost
}

// Where frames don't come by the clock the camera need not have moved on when the answer comes.
void Session::wait_for_answer() {
  if ((!options_.lockstep && !options_.max_rate) || !answers_) return;
  const auto deadline = Clock::now() + kAnswerPatience;
  while (tracker_->awaits_answer() && !stop_.stop_requested() && link_->stats().connected &&
         Clock::now() < deadline) {
    if (const auto answer = link_->wait_answer(kLinkCheck, stop_)) take_answer(*answer);
    take_corrections(nanoseconds::zero());
  }
  answers_ = Clock::now() < deadline;
}

// Waits until at most `backlog` keyframes await mapping. Running into the deadline is an error,
// losing the server only where `only_while_connected` is not set.
Status Session::wait_for_mapping(int backlog, Clock::time_point deadline,
                                 bool only_while_connected) {
  while (tracker_->unmapped() > backlog && !stop_.stop_requested()) {
    const auto now = Clock::now();
    if (Status s = link_->status(); !s) return only_while_connected ? Status() : s;
    if (only_while_connected && (now - in_touch_ > kConnectGrace || now > deadline)) return {};
    if (now > deadline)
      return {ErrorCode::kTimeout,
              fmt::format("{} keyframes still await the server's mapping after {:.0f} s; is "
                          "cairn-server running in domain {}?",
                          tracker_->unmapped(), options_.timeout.count(), options_.config.domain)};
    take_corrections(std::min<nanoseconds>(kLinkCheck, deadline - now));
  }
  return {};
}

// Until every keyframe is acknowledged; shorter when interrupted.
void Session::wait_for_delivery(Clock::time_point deadline) {
  if (link_->wait_delivered(deadline - Clock::now(), stop_) || !stop_.stop_requested()) return;
  const auto now = Clock::now();
  (void)link_->wait_delivered(std::min<nanoseconds>(kInterruptedPatience, deadline - now));
}

// Until the server has closed its loops and adjusted the map as a whole. One that can't be heard
// has nothing more to say.
void Session::wait_for_last_corrections(Clock::time_point deadline) {
  link_->say_finishing();
  while (!settled_ && link_->status() && !stop_.stop_requested()) {
    const auto now = Clock::now();
    if (now >= deadline || now - in_touch_ > kConnectGrace) break;
    take_corrections(std::min<nanoseconds>(kLinkCheck, deadline - now));
  }
  if (!settled_ && !stop_.stop_requested())
    log::warn("the server's last corrections did not come in time: the trajectory is without them");
  take_corrections(nanoseconds::zero());
}

Status Session::after_keyframe() {
  if (options_.no_server) return {};
  const auto deadline = Clock::now() + std::chrono::duration_cast<nanoseconds>(options_.timeout);
  if (options_.lockstep) return wait_for_mapping(0, deadline, false);
  if (options_.max_rate) return wait_for_mapping(kMaxBacklog, deadline, true);
  return {};
}

// A line that renews itself on a terminal, a plain one now and then in a pipe.
void Session::show_progress() {
  static const bool terminal = isatty(STDERR_FILENO) == 1;
  if (Clock::now() < next_progress_) return;
  next_progress_ = Clock::now() + (terminal ? nanoseconds(milliseconds(200)) : kProgressEvery);
  const std::string total = source_->size() ? fmt::format("/{}", *source_->size()) : "";
  const std::string line =
      fmt::format("frame {}{}, {} tracked, {} keyframes, {} await mapping", report_.frames, total,
                  report_.tracked, tracker_->keyframes_made(), tracker_->unmapped());
  if (terminal)
    fmt::print(stderr, "\r{}\033[K", line);
  else
    log::info("{}", line);
}

// Every keyframe acknowledged, the last corrections in, the trajectory on disk.
Status Session::finish() {
  if (isatty(STDERR_FILENO) == 1) fmt::print(stderr, "\r\033[K");
  report_.keyframes = tracker_->keyframes_made();
  if (!options_.no_server) {
    const auto deadline = Clock::now() + std::chrono::duration_cast<nanoseconds>(options_.timeout);
    if (!stop_.stop_requested() &&
        (tracker_->unmapped() > 0 || link_->stats().keyframes_in_outbox > 0))
      log::info("waiting for the server: keyframes not mapped: {}, not delivered: {}",
                tracker_->unmapped(), link_->stats().keyframes_in_outbox);
    if (Status s = wait_for_mapping(0, deadline, false); !s) log::warn("{}", s.message());
    wait_for_delivery(deadline);
    wait_for_last_corrections(deadline);
  }
  link_->stop();
  const LinkStats stats = link_->stats();
  report_.mapped = tracker_->keyframes_mapped();
  report_.acknowledged = stats.keyframes_acked;
  report_.undelivered = stats.keyframes_in_outbox;
  report_.bytes_up = stats.bytes_up;
  report_.bytes_down = stats.bytes_down;
  const std::vector<Trajectory> parts = tracker_->trajectory_by_part();
  report_.parts = parts.size();
  if (options_.trajectory.empty()) return {};
  Result<std::vector<TrajectoryFile>> written = write_trajectories(options_.trajectory, parts);
  if (!written) return written.error();
  report_.trajectories = std::move(*written);
  return {};
}

Result<SessionReport> Session::run() {
  if (Status s = open(); !s) return s.error();
  meet_server();
  Pacer pacer(*source_, !options_.max_rate && !options_.lockstep);
  std::optional<Clock::time_point> start;
  std::int64_t first_stamp = 0, last_stamp = 0;
  Status trouble;  // ends the run, but not before what was tracked is delivered and written
  while (!stop_.stop_requested() && trouble) {
    Result<std::optional<Frame>> frame =
        pacer.next([&](nanoseconds remaining) { take_corrections(remaining); }, stop_);
    if (!frame) {
      trouble = frame.error();
      break;
    }
    if (!*frame) break;  // the end, or a stop
    if (!start) {
      start = Clock::now();
      first_stamp = (*frame)->stamp_ns;
    }
    last_stamp = (*frame)->stamp_ns;
    take_corrections(nanoseconds::zero());
    trouble = process(**frame);
    show_progress();
  }
  report_.seconds = to_seconds(last_stamp - first_stamp);
  report_.dropped = pacer.dropped();
  report_.skipped = source_->skipped();
  if (report_.frames == 0 && !trouble) return trouble.error();
  if (report_.frames == 0 && !stop_.stop_requested())
    return Error{ErrorCode::kInvalidArgument, fmt::format("{}: no usable frame in it ({} skipped)",
                                                          options_.input, report_.skipped)};
  if (Status s = finish(); !s) return s.error();
  if (!trouble) return trouble.error();
  return report_;
}

}  // namespace

Result<SessionReport> run_session(const SessionOptions& options, std::stop_token stop) {
  return Session(options, std::move(stop)).run();
}

}  // namespace cairn
