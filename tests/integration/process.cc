#include "tests/integration/process.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <sstream>
#include <thread>

#include <gtest/gtest.h>

extern char** environ;

namespace cairn::testing {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
constexpr std::chrono::milliseconds kLookEvery{10};

std::string read_file(const fs::path& path) {
  std::ifstream in(path);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

std::vector<char*> pointers(std::vector<std::string>& strings) {
  std::vector<char*> out;
  for (std::string& s : strings) out.push_back(s.data());
  out.push_back(nullptr);
  return out;
}

}  // namespace

Process::Process(const std::string& program, const std::vector<std::string>& arguments,
                 const std::vector<std::string>& environment, const fs::path& output_stem)
    : out_file_(output_stem.string() + ".out"), err_file_(output_stem.string() + ".err") {
  std::vector<std::string> argv{program};
  argv.insert(argv.end(), arguments.begin(), arguments.end());
  std::vector<std::string> env = environment;
  for (char** e = environ; *e; ++e) env.emplace_back(*e);

  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  const int flags = O_WRONLY | O_CREAT | O_TRUNC;
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, out_file_.c_str(), flags, 0644);
  posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, err_file_.c_str(), flags, 0644);
  if (posix_spawn(&pid_, program.c_str(), &actions, nullptr, pointers(argv).data(),
                  pointers(env).data()) != 0)
    exit_code_ = 127;
  posix_spawn_file_actions_destroy(&actions);
}

Process::~Process() {
  if (has_ended()) return;
  kill(pid_, SIGKILL);
  waitpid(pid_, nullptr, 0);
}

void Process::signal(int number) {
  if (!has_ended()) kill(pid_, number);
}

bool Process::has_ended() {
  if (exit_code_) return true;
  int status = 0;
  if (waitpid(pid_, &status, WNOHANG) != pid_) return false;
  exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return true;
}

std::optional<int> Process::wait(std::chrono::seconds timeout) {
  for (const auto end = Clock::now() + timeout * kTimeScale; !has_ended() && Clock::now() < end;)
    std::this_thread::sleep_for(kLookEvery);
  return exit_code_;
}

bool Process::runs_for(std::chrono::milliseconds time) {
  for (const auto end = Clock::now() + time; !has_ended() && Clock::now() < end;)
    std::this_thread::sleep_for(std::min<Clock::duration>(kLookEvery, end - Clock::now()));
  return !has_ended();
}

bool Process::wait_for_log(const std::string& text, std::chrono::seconds timeout) {
  for (const auto end = Clock::now() + timeout * kTimeScale; Clock::now() < end;) {
    const bool ended = has_ended();
    if (err().find(text) != std::string::npos) return true;
    if (ended) return false;
    std::this_thread::sleep_for(kLookEvery);
  }
  return false;
}

std::string Process::out() const {
  return read_file(out_file_);
}
std::string Process::err() const {
  return read_file(err_file_);
}

double Process::reported(const std::string& name) const {
  std::istringstream lines(out());
  std::string word;
  double value = 0;
  while (lines >> word >> value)
    if (word == name) return value;
  return std::nan("");
}

Deployment::Deployment() {
  static int count = 0;
  const ::testing::TestInfo* test = ::testing::UnitTest::GetInstance()->current_test_info();
  const std::string tag = std::string(test ? test->name() : "setup") + "-" +
                          std::to_string(getpid()) + "-" + std::to_string(++count);
  folder_ = fs::temp_directory_path() / ("cairn-test-" + tag);
  fs::create_directories(folder_);
  // Loopback only; the tag keeps parallel tests from seeing each other.
  dds_config_ =
      "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name=\"lo\"/></Interfaces>"
      "</General><Discovery><Tag>" +
      tag +
      "</Tag><MaxAutoParticipantIndex>100</MaxAutoParticipantIndex></Discovery></Domain>"
      "</CycloneDDS>";
}

Deployment::~Deployment() {
  // A report changes the exit code of a program that ends by itself, but not of one that is killed.
  if (const std::string reports = sanitizer_reports(); !reports.empty()) ADD_FAILURE() << reports;
  if (::testing::Test::HasFailure()) {
    for (const auto& entry : fs::directory_iterator(folder_))
      if (entry.path().extension() == ".err")
        std::fprintf(stderr, "---- %s\n%s", entry.path().filename().c_str(),
                     read_file(entry.path()).c_str());
    return;
  }
  std::error_code ignored;
  fs::remove_all(folder_, ignored);
}

std::string Deployment::sanitizer_reports() const {
  std::string reports;
  for (const auto& entry : fs::directory_iterator(folder_)) {
    if (entry.path().extension() != ".err") continue;
    std::istringstream lines(read_file(entry.path()));
    for (std::string line; std::getline(lines, line);)
      for (const char* sign :
           {"ThreadSanitizer:", "AddressSanitizer:", "LeakSanitizer:", ": runtime error:"})
        if (line.find(sign) != std::string::npos)
          reports += entry.path().filename().string() + ": " + line + "\n";
  }
  return reports;
}

std::string Deployment::write(const std::string& name, const std::string& text) const {
  std::ofstream(file(name)) << text;
  return file(name).string();
}

std::unique_ptr<Process> Deployment::start(const std::string& program, const std::string& label,
                                           const std::vector<std::string>& arguments) {
  return std::make_unique<Process>(std::string(CAIRN_BINARY_DIR) + "/" + program, arguments,
                                   std::vector<std::string>{"CYCLONEDDS_URI=" + dds_config_},
                                   file(label + std::to_string(++started_)));
}

std::unique_ptr<Process> Deployment::server(const std::vector<std::string>& arguments) {
  return start("cairn-server", "server", arguments);
}

std::unique_ptr<Process> Deployment::client(const std::string& name, const std::string& input,
                                            const std::vector<std::string>& arguments,
                                            const std::string& config) {
  std::vector<std::string> all{"--config", config.empty() ? write("client.yaml", "{}\n") : config,
                               "--input",  input,
                               "--name",   name};
  const auto by_default = [&](const std::string& option, const std::string& value) {
    if (std::find(arguments.begin(), arguments.end(), option) == arguments.end())
      all.insert(all.end(), {option, value});
  };
  by_default("--outbox", file(name + ".outbox").string());
  by_default("--timeout", std::to_string(30 * kTimeScale));
  all.insert(all.end(), arguments.begin(), arguments.end());
  return start("cairn-client", name, all);
}

std::unique_ptr<Process> Deployment::tool(const std::vector<std::string>& arguments) {
  return start("cairn", "tool", arguments);
}

std::optional<fs::path> recording(const std::string& name) {
  const char* given = std::getenv("CAIRN_DATA");
  const fs::path folder =
      given ? fs::path(given) : fs::path(CAIRN_SOURCE_DIR) / ".." / "shared" / "data";
  if (fs::is_directory(folder / name)) return folder / name;
  return std::nullopt;
}

}  // namespace cairn::testing
