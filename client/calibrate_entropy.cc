#include "client/calibrate_entropy.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <vector>

#include <fmt/format.h>

#include "client/capture/frame_source.h"
#include "client/frontend/extractor.h"

namespace cairn {
namespace {

using Lines = std::vector<std::string>;

std::size_t indent_of(const std::string& line) {
  return std::min(line.find_first_not_of(' '), line.size());
}
bool says_nothing(const std::string& line) {
  const std::size_t i = indent_of(line);
  return i == line.size() || line[i] == '#' || line[i] == '\r';
}
bool has_key(const std::string& line, const std::string& key) {
  return line.compare(indent_of(line), key.size() + 1, key + ":") == 0;
}

// Lines begin .. end - 1 of the file are what a key holds.
struct Block {
  std::size_t begin = 0, end = 0;
  std::size_t indent = 0;  // of the keys in it
};

// What lies under the key in line `at`, whose keys are those indented alike.
Block block_under(const Lines& lines, std::size_t at) {
  const std::size_t parent = indent_of(lines[at]);
  Block block{at + 1, at + 1, parent + 2};
  bool first = true;
  for (std::size_t i = at + 1; i < lines.size(); ++i) {
    if (says_nothing(lines[i])) continue;
    if (indent_of(lines[i]) <= parent) break;
    if (first) block.indent = indent_of(lines[i]);
    first = false;
    block.end = i + 1;
  }
  return block;
}

std::optional<std::size_t> find_key(const Lines& lines, const Block& in, const std::string& key) {
  for (std::size_t i = in.begin; i < in.end; ++i)
    if (!says_nothing(lines[i]) && indent_of(lines[i]) == in.indent && has_key(lines[i], key))
      return i;
  return std::nullopt;
}

void insert(Lines& lines, std::size_t at, std::size_t indent, const std::string& text) {
  lines.insert(lines.begin() + static_cast<std::ptrdiff_t>(at), std::string(indent, ' ') + text);
}

// The block of a section, made where it is missing. Nothing when it is not written line by line.
std::optional<Block> section(Lines& lines, const Block& in, const std::string& key) {
  std::optional<std::size_t> at = find_key(lines, in, key);
  if (!at) {
    at = in.end;
    insert(lines, *at, in.indent, key + ":");
  }
  const std::string rest = lines[*at].substr(in.indent + key.size() + 1);
  const std::size_t value = rest.find_first_not_of(" \r");
  if (value != std::string::npos && rest[value] != '#') return std::nullopt;
  return block_under(lines, *at);
}

void set(Lines& lines, const Block& in, const std::string& key, const std::string& value) {
  const std::string text = key + ": " + value;
  const std::optional<std::size_t> at = find_key(lines, in, key);
  if (!at) return insert(lines, in.begin, in.indent, text);
  std::size_t comment = std::min(lines[*at].find(" #"), lines[*at].size());
  while (comment > 0 && lines[*at][comment - 1] == ' ') --comment;
  const std::string tail = lines[*at].substr(comment);
  lines[*at] = std::string(in.indent, ' ') + text + tail;
}

Status write_text(const std::filesystem::path& path, const std::string& text) {
  std::ofstream file(path, std::ios::binary);
  if (file << text << std::flush) return {};
  return {ErrorCode::kInvalidArgument, fmt::format("{}: can't be written", path.string())};
}

}  // namespace

Result<EntropyCalibration> calibrate_entropy(const std::string& input, const ClientConfig& config,
                                             std::stop_token stop) {
  Result<std::unique_ptr<FrameSource>> source = open_source(input, config.camera);
  if (!source) return source.error();
  ExtractorOptions options = config.frontend.extractor;
  options.entropy.mode = EntropyMode::kOnline;  // the mean that it ends with is the one wanted
  Extractor extractor(options);
  Features features;
  EntropyCalibration found;
  while (!stop.stop_requested()) {
    Result<std::optional<Frame>> frame = (*source)->next();
    if (!frame) return frame.error();
    if (!*frame) break;
    extractor.extract((*frame)->gray, features);
    ++found.frames;
  }
  if (found.frames == 0)
    return Error{ErrorCode::kInvalidArgument, fmt::format("{}: no usable frame in it", input)};
  found.scene_mean = extractor.scene_entropy();
  options.entropy.mode = EntropyMode::kCalibrated;
  options.entropy.scene_mean = found.scene_mean;
  found.threshold = EntropyThreshold(options.entropy).next(found.scene_mean);
  return found;
}

Result<std::string> with_scene_mean(const std::string& yaml, double scene_mean) {
  Lines lines;
  std::istringstream in(yaml);
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  const Error braces{ErrorCode::kInvalidArgument,
                     "frontend: and sharpen: must each stand on a line of their own"};
  const std::optional<Block> frontend = section(lines, {0, lines.size(), 0}, "frontend");
  if (!frontend) return braces;
  std::optional<Block> sharpen = section(lines, *frontend, "sharpen");
  if (!sharpen) return braces;
  if (const auto at = find_key(lines, *sharpen, "threshold"))
    lines[*at].insert(sharpen->indent, "# ");
  set(lines, *sharpen, "scene_mean", fmt::format("{:.4f}", scene_mean));
  ++sharpen->end;
  set(lines, *sharpen, "mode", "calibrated");
  std::string out;
  for (const std::string& line : lines) out += line + "\n";
  return out;
}

Status store_scene_mean(const std::string& path, double scene_mean) {
  namespace fs = std::filesystem;
  std::ifstream file(path, std::ios::binary);
  std::stringstream text;
  text << file.rdbuf();
  if (!file) return {ErrorCode::kNotFound, fmt::format("{}: can't be read", path)};
  const Result<std::string> changed = with_scene_mean(text.str(), scene_mean);
  if (!changed) return {changed.error().code, fmt::format("{}: {}", path, changed.message())};

  std::error_code error;
  const fs::path target = fs::canonical(path, error), draft = target.string() + ".new";
  if (Status s = write_text(draft, *changed); !s) return s;
  const Result<ClientConfig> loaded = load_client_config(draft.string());
  if (loaded) {
    fs::permissions(draft, fs::status(target).permissions(), error);
    fs::rename(draft, target, error);
    if (!error) return {};
  }
  std::error_code ignored;
  fs::remove(draft, ignored);
  return {ErrorCode::kInvalidArgument, fmt::format("{}: could not be changed: {}", path,
                                                   loaded ? error.message() : loaded.message())};
}

}  // namespace cairn
