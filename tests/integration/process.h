// Starts the real programs for integration tests, each test on a DDS network of its own.
#pragma once

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace cairn::testing {

// How many times longer everything may take in this build: sanitizers cost time.
inline constexpr int kTimeScale = CAIRN_TEST_TIMEOUT_SCALE;
// Too slow to keep up with a camera: recordings at their own pace lose most of their frames.
inline constexpr bool kSlowBuild = kTimeScale > 1;

// A child process with its output in files. Killed, with SIGKILL, when this goes out of scope.
class Process {
 public:
  // `environment` entries NAME=VALUE are added to our own.
  Process(const std::string& program, const std::vector<std::string>& arguments,
          const std::vector<std::string>& environment, const std::filesystem::path& output_stem);
  ~Process();
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  void signal(int number);
  int pid() const { return pid_; }
  // Exit code, or 128 + signal; nothing when it is still running after `timeout` times kTimeScale.
  std::optional<int> wait(std::chrono::seconds timeout);
  // Lets it run for exactly that long; false when it has ended by then.
  bool runs_for(std::chrono::milliseconds time);
  // Waits until `text` stands in stderr; false after `timeout` times kTimeScale or when the process
  // has ended before.
  bool wait_for_log(const std::string& text, std::chrono::seconds timeout);

  std::string out() const;  // stdout so far
  std::string err() const;  // stderr so far
  // The number behind `name` in stdout, as cairn-client reports; NaN when there is none.
  double reported(const std::string& name) const;

 private:
  bool has_ended();

  std::filesystem::path out_file_, err_file_;
  int pid_ = -1;
  std::optional<int> exit_code_;
};

// A folder of its own and a DDS network of its own for one test; removed at the end unless the test
// has failed. Clients get the default --timeout times kTimeScale, and an outbox named after them,
// unless their test gives others.
class Deployment {
 public:
  Deployment();
  ~Deployment();

  std::filesystem::path file(const std::string& name) const { return folder_ / name; }
  // What sanitizers have complained about in the programs so far; a test fails at its end if any.
  std::string sanitizer_reports() const;
  // Writes a file into the folder and returns its path.
  std::string write(const std::string& name, const std::string& text) const;

  std::unique_ptr<Process> server(const std::vector<std::string>& arguments = {});
  std::unique_ptr<Process> client(const std::string& name, const std::string& input,
                                  const std::vector<std::string>& arguments = {},
                                  const std::string& config = "");
  std::unique_ptr<Process> tool(const std::vector<std::string>& arguments);

 private:
  std::unique_ptr<Process> start(const std::string& program, const std::string& label,
                                 const std::vector<std::string>& arguments);
  std::filesystem::path folder_;
  std::string dds_config_;
  int started_ = 0;
};

// Where the recordings for tests are, or nothing: $CAIRN_DATA, or shared/data beside the source.
std::optional<std::filesystem::path> recording(const std::string& name);

}  // namespace cairn::testing
