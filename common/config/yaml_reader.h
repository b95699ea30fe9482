// Typed reading of YAML configuration.
//
// A file becomes a Section; nested blocks become Sections of their own. Reading is straight-line
// code: the first error is kept, with file, line and key in one line, and every read after it gives
// back its fallback (or zero) and does nothing else. Ask once, at the end:
//
//   Result<Section> root = load_yaml("config/client.yaml");
//   if (!root) return root.error();
//   Section camera = root->section("camera");
//   config.rate_hz = camera.number_or("rate_hz", config.rate_hz, {1, 1000});
//   if (Status done = root->finish(); !done) return done.error();
//
// finish() also turns every key that nobody read into an error, so that a misspelt key is never a
// silent default. Messages look like
//   config/client.yaml:7: camera.intrinsics: needs 4 numbers (fx fy cx cy), has 3
//
// Sections are handles to one shared document: copies are cheap and see the same state. One thread.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/util/status.h"

namespace cairn {

struct YamlDocument;  // yaml-cpp stays in the .cc

// Bounds of a number, both allowed. NaN and infinity are always refused.
struct Range {
  double min = std::numeric_limits<double>::lowest();
  double max = std::numeric_limits<double>::max();
};
struct IntRange {
  std::int64_t min = std::numeric_limits<std::int32_t>::min();
  std::int64_t max = std::numeric_limits<std::int32_t>::max();
};

// Name in the file and what it stands for.
template <typename Enum>
using Choices = std::initializer_list<std::pair<std::string_view, Enum>>;

class Section {
 public:
  bool has(std::string_view key) const;

  // Without `_or` the key must be there.
  double number(std::string_view key, Range range = {});
  double number_or(std::string_view key, double fallback, Range range = {});
  std::int64_t integer(std::string_view key, IntRange range = {});
  std::int64_t integer_or(std::string_view key, std::int64_t fallback, IntRange range = {});
  bool flag(std::string_view key);
  bool flag_or(std::string_view key, bool fallback);
  std::string text(std::string_view key);
  std::string text_or(std::string_view key, std::string fallback);

  // A list of between `least` and `most` numbers. `what` names them in the error message.
  std::vector<double> numbers(std::string_view key, std::size_t least, std::size_t most,
                              std::string_view what, Range range = {});
  // A list of exactly N numbers.
  template <std::size_t N>
  std::array<double, N> numbers(std::string_view key, std::string_view what, Range range = {}) {
    std::array<double, N> out{};
    const std::vector<double> list = numbers(key, N, N, what, range);
    if (list.size() == N) std::copy(list.begin(), list.end(), out.begin());
    return out;
  }

  template <typename Enum>
  Enum choice(std::string_view key, Choices<Enum> choices) {
    return pick<Enum>(key, choices, std::nullopt);
  }
  template <typename Enum>
  Enum choice_or(std::string_view key, Enum fallback, Choices<Enum> choices) {
    return pick<Enum>(key, choices, fallback);
  }

  // A nested block of keys.
  Section section(std::string_view key);
  std::optional<Section> optional_section(std::string_view key);

  // Records an error of the caller's own about `key` of this section (its line is found when the
  // key is there). Only the first error of the document is kept.
  void fail(std::string_view key, std::string_view message);
  // No error so far. Unused keys show in finish() only.
  bool ok() const;
  // The first error so far, without looking for unused keys.
  Status status() const;
  // The first error, or else the first key of the whole document that no read has asked for.
  Status finish() const;

 private:
  friend Result<Section> parse_yaml(const std::string& text, const std::string& file);
  Section(std::shared_ptr<YamlDocument> document, std::size_t index)
      : document_(std::move(document)), index_(index) {}

  // Index into `names` of the value; nothing when the key is absent or wrong.
  std::optional<std::size_t> pick_index(std::string_view key,
                                        std::span<const std::string_view> names, bool required);
  template <typename Enum>
  Enum pick(std::string_view key, Choices<Enum> choices, std::optional<Enum> fallback) {
    std::vector<std::string_view> names;
    for (const auto& [name, value] : choices) names.push_back(name);
    const auto index = pick_index(key, names, !fallback.has_value());
    if (index) return (choices.begin() + *index)->second;
    return fallback.value_or(choices.begin()->second);
  }

  std::shared_ptr<YamlDocument> document_;
  std::size_t index_ = 0;
};

// The whole file as a section. Fails on files that can't be read, are no YAML, hold the same key
// twice, or whose top level is no block of keys. An empty file is a section without keys.
Result<Section> load_yaml(const std::string& path);
// As load_yaml, for text that is in memory already; `file` names it in messages.
Result<Section> parse_yaml(const std::string& text, const std::string& file);

}  // namespace cairn
