// cairn-client: the command line of one camera.
#include <pthread.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <stop_token>
#include <thread>

#include <CLI/CLI.hpp>

#include "client/calibrate_entropy.h"
#include "client/session.h"
#include "common/util/clock.h"
#include "common/util/log.h"

namespace {

enum ExitCode { kAllDelivered = 0, kFailed = 1, kBadUsage = 2, kUndelivered = 3 };

// Turns SIGINT and SIGTERM into a stop token. Make it before any other thread starts, so that all
// inherit the mask and the signals wait for its own.
class Interrupt {
 public:
  Interrupt() {
    sigemptyset(&signals_);
    sigaddset(&signals_, SIGINT);
    sigaddset(&signals_, SIGTERM);
    pthread_sigmask(SIG_BLOCK, &signals_, nullptr);
    thread_ = std::thread([this] {
      int signal = 0;
      sigwait(&signals_, &signal);
      stop_.request_stop();
    });
  }
  ~Interrupt() {
    pthread_kill(thread_.native_handle(), SIGTERM);  // wakes it, if nobody has
    thread_.join();
  }
  Interrupt(const Interrupt&) = delete;
  Interrupt& operator=(const Interrupt&) = delete;

  std::stop_token token() const { return stop_.get_token(); }

 private:
  sigset_t signals_{};
  std::stop_source stop_;
  std::thread thread_;
};

double percentile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

// Results on stdout, one `name value` pair a line.
void print_report(const cairn::SessionReport& r) {
  const double seconds = std::max(r.seconds, 1e-9);
  fmt::print("frames {}\ntracked {}\ndropped {}\nskipped {}\n", r.frames, r.tracked, r.dropped,
             r.skipped);
  fmt::print("parts {}\n", r.parts);
  fmt::print("keyframes {}\nmapped {}\nacknowledged {}\nundelivered {}\n", r.keyframes, r.mapped,
             r.acknowledged, r.undelivered);
  fmt::print("tracking_ms_median {:.2f}\ntracking_ms_p95 {:.2f}\nextraction_ms_median {:.2f}\n",
             percentile(r.tracking_ms, 0.5), percentile(r.tracking_ms, 0.95),
             percentile(r.extraction_ms, 0.5));
  fmt::print("correction_ms_median {:.1f}\ncorrection_ms_p95 {:.1f}\n",
             percentile(r.correction_ms, 0.5), percentile(r.correction_ms, 0.95));
  fmt::print("up_kB_per_s {:.1f}\ndown_kB_per_s {:.1f}\n",
             static_cast<double>(r.bytes_up) / seconds / 1000,
             static_cast<double>(r.bytes_down) / seconds / 1000);
}

// A trajectory in several files is no matter to overlook.
void tell_of_parts(const cairn::SessionReport& r) {
  if (r.trajectories.size() < 2) return;
  fmt::print(stderr,
             "cairn-client: {} parts of the map were never merged; each has a file and a frame of "
             "its own:\n",
             r.trajectories.size());
  for (const cairn::TrajectoryFile& t : r.trajectories)
    fmt::print(stderr, "  {}: {} frames, {:.3f} s to {:.3f} s\n", t.file, t.frames,
               cairn::to_seconds(t.first_ns), cairn::to_seconds(t.last_ns));
}

int exit_code(const cairn::Error& error) {
  return error.code == cairn::ErrorCode::kInvalidArgument ||
                 error.code == cairn::ErrorCode::kNotFound
             ? kBadUsage
             : kFailed;
}

// --calibrate-entropy: the first pass over a scene; what it finds goes to stdout and into the
// config.
int calibrate(const std::string& config_path, const cairn::ClientConfig& config,
              const std::string& input) {
  const Interrupt interrupt;
  const auto found = cairn::calibrate_entropy(input, config, interrupt.token());
  if (!found) {
    fmt::print(stderr, "cairn-client: {}\n", found.message());
    return exit_code(found.error());
  }
  fmt::print("frames {}\nscene_mean {:.4f}\nthreshold {:.4f}\n", found->frames, found->scene_mean,
             found->threshold);
  if (cairn::Status s = cairn::store_scene_mean(config_path, found->scene_mean); !s) {
    fmt::print(stderr,
               "cairn-client: {}; write `mode: calibrated` and `scene_mean: {:.4f}` into frontend: "
               "sharpen: yourself\n",
               s.message(), found->scene_mean);
    return exit_code(s.error());
  }
  fmt::print(stderr, "cairn-client: {} now says mode: calibrated, scene_mean: {:.4f}\n",
             config_path, found->scene_mean);
  return kAllDelivered;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Tracks one camera and shares what it sees with cairn-server."};
  app.set_version_flag("--version", CAIRN_VERSION);
  std::string config_path;
  cairn::SessionOptions options;
  std::optional<std::uint32_t> domain;
  double timeout_s = options.timeout.count();
  std::string log_level;
  app.add_option("--config", config_path, "YAML file with the camera and settings")->required();
  app.add_option("--input", options.input,
                 "tum:DIR, euroc:DIR, kitti:DIR, folder:DIR, video:FILE, camera:N or "
                 "synth:SCENE[?key=value&...]")
      ->required();
  app.add_option("--name", options.name, "name of this client, unique among those of a server")
      ->capture_default_str();
  app.add_option("--domain", domain, "DDS domain, 0 to 232; overrides the config")
      ->check(CLI::Range(0, 232));
  app.add_option("--trajectory", options.trajectory,
                 "file for the corrected trajectory, TUM format; OUT.part2.tum and so on for parts "
                 "of the map that were never merged");
  app.add_option("--outbox", options.outbox,
                 "file that keeps keyframes until the server has them [NAME.outbox]");
  app.add_flag("--max-rate", options.max_rate,
               "every frame, as fast as tracking and mapping allow, instead of real time");
  app.add_flag("--lockstep", options.lockstep,
               "wait for the server's answer to each keyframe; repeatable, for tests");
  app.add_flag("--no-server", options.no_server, "track alone; keyframes stay in the outbox");
  bool calibrate_entropy = false;
  app.add_flag("--calibrate-entropy", calibrate_entropy,
               "read all of the input, print the mean entropy of the scene, store it in the config "
               "for `mode: calibrated`, and end");
  app.add_option("--timeout", timeout_s, "seconds to wait for delivery and corrections at the end")
      ->check(CLI::Range(0.0, 1e6))
      ->capture_default_str();
  app.add_option("--log-level", log_level, "debug, info, warn, error or off; overrides the config")
      ->check([](const std::string& level) {
        const cairn::Status known = cairn::log::check_level(level);
        return known ? std::string() : known.message();
      });
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? kAllDelivered : kBadUsage;
  }

  cairn::log::initialise("cairn-client", log_level.empty() ? "info" : log_level);
  cairn::Result<cairn::ClientConfig> config = cairn::load_client_config(config_path);
  if (!config) {
    fmt::print(stderr, "cairn-client: {}\n", config.message());
    return kBadUsage;
  }
  if (calibrate_entropy) return calibrate(config_path, *config, options.input);
  options.config = *config;
  if (log_level.empty()) cairn::log::initialise("cairn-client", options.config.log_level);
  if (domain) options.config.domain = *domain;
  options.timeout = std::chrono::duration<double>(timeout_s);

  const Interrupt interrupt;
  const cairn::Result<cairn::SessionReport> report = cairn::run_session(options, interrupt.token());
  if (!report) {
    fmt::print(stderr, "cairn-client: {}\n", report.message());
    return exit_code(report.error());
  }
  print_report(*report);
  tell_of_parts(*report);
  if (report->tracked == 0) {
    fmt::print(stderr, "cairn-client: no frame was tracked; is there enough texture and depth?\n");
    return kFailed;
  }
  if (report->undelivered > 0) {
    if (!options.no_server)
      fmt::print(stderr,
                 "cairn-client: {} keyframes remain in the outbox; run again with the same "
                 "--outbox to deliver them\n",
                 report->undelivered);
    return kUndelivered;
  }
  return kAllDelivered;
}
