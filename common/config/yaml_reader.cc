#include "common/config/yaml_reader.h"

#include <charconv>
#include <cmath>
#include <deque>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

#include <yaml-cpp/yaml.h>

namespace cairn {

struct YamlDocument {
  struct Entry {
    YAML::Node value;
    int line = 0;  // of the key, from 1
    bool used = false;
    std::optional<std::size_t> section;  // index into `sections` once read as one
  };
  struct Block {
    std::string path;  // "camera.right"; empty at the top
    int line = 1;
    std::map<std::string, Entry, std::less<>> entries;
    std::vector<std::string> asked;  // keys that the program knows, present or not
  };

  std::string file;
  std::deque<Block> blocks;  // grows while references to earlier ones are held
  std::optional<Error> error;

  void fail(int line, const std::string& where, std::string_view message) {
    if (error) return;
    std::string text = file + ":" + std::to_string(line) + ": ";
    if (!where.empty()) text += where + ": ";
    error = Error{ErrorCode::kInvalidArgument, text.append(message)};
  }
};

namespace {

using Block = YamlDocument::Block;
using Entry = YamlDocument::Entry;

std::string join(const std::string& path, std::string_view key) {
  return path.empty() ? std::string(key) : path + "." + std::string(key);
}

// Letters to insert, delete, change or swap with their neighbour to get from a to b (Damerau 1964,
// each place edited once at most).
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::vector<std::size_t>> cost(a.size() + 1, std::vector<std::size_t>(b.size() + 1));
  for (std::size_t i = 0; i <= a.size(); ++i) {
    for (std::size_t j = 0; j <= b.size(); ++j) {
      if (i == 0 || j == 0) {
        cost[i][j] = i + j;
        continue;
      }
      const std::size_t change = cost[i - 1][j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1);
      cost[i][j] = std::min({cost[i - 1][j] + 1, cost[i][j - 1] + 1, change});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
        cost[i][j] = std::min(cost[i][j], cost[i - 2][j - 2] + 1);
    }
  }
  return cost[a.size()][b.size()];
}

// Close enough to be a misspelling: a third of the letters or less, or one the start of the other.
bool is_near(std::string_view a, std::string_view b) {
  const std::size_t shorter = std::min(a.size(), b.size());
  if (shorter >= 4 && a.substr(0, shorter) == b.substr(0, shorter)) return true;
  return edit_distance(a, b) <= std::max<std::size_t>(1, std::max(a.size(), b.size()) / 3);
}

// Takes a map node apart. Keys that are no plain words, or come twice, are errors of the document.
void fill_block(YamlDocument& document, Block& block, const YAML::Node& node) {
  for (const auto& item : node) {
    const int line = item.first.Mark().line + 1;
    if (!item.first.IsScalar()) {
      document.fail(line, block.path, "keys must be plain words");
      return;
    }
    const std::string key = item.first.Scalar();
    const auto [it, fresh] = block.entries.try_emplace(key, Entry{item.second, line, false, {}});
    if (!fresh) {
      document.fail(line, join(block.path, key),
                    "is given twice, first on line " + std::to_string(it->second.line));
      return;
    }
  }
}

std::string describe(const YAML::Node& node) {
  if (node.IsScalar()) return "'" + node.Scalar() + "'";
  if (node.IsSequence()) return "a list";
  if (node.IsMap()) return "a block of keys";
  return "nothing";
}

std::string number_text(double value) {
  std::ostringstream out;
  out.precision(12);
  out << value;
  return out.str();
}

// Whether the whole of `text` is one number.
template <typename T>
bool parse_whole(std::string_view text, T& value) {
  if (text.starts_with('+')) text.remove_prefix(1);
  const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
  return code == std::errc() && end == text.data() + text.size();
}

std::optional<std::string> check_number(const YAML::Node& node, Range range, double& value) {
  if (!node.IsScalar()) return "needs a number, has " + describe(node);
  std::string_view text = node.Scalar();
  // YAML writes .nan and .inf where C++ writes nan and inf.
  const bool yaml_special = text.starts_with(".n") || text.starts_with(".N") ||
                            text.find(".i") != text.npos || text.find(".I") != text.npos;
  if (!yaml_special && !parse_whole(text, value)) return "needs a number, has " + describe(node);
  if (yaml_special || !std::isfinite(value)) return "is not a finite number: " + std::string(text);
  if (value < range.min)
    return "must be at least " + number_text(range.min) + ", is " + std::string(text);
  if (value > range.max)
    return "must be at most " + number_text(range.max) + ", is " + std::string(text);
  return std::nullopt;
}

// A key of the block that nobody has asked for and that looks like a misspelt `key`.
const std::pair<const std::string, Entry>* find_misspelt(const Block& block, std::string_view key) {
  for (const auto& item : block.entries)
    if (!item.second.used && is_near(item.first, key)) return &item;
  return nullptr;
}

// The entry to read; null when absent, or once the document has an error.
Entry* find_entry(YamlDocument& document, std::size_t index, std::string_view key, bool required) {
  if (document.error) return nullptr;
  Block& block = document.blocks[index];
  block.asked.emplace_back(key);
  const auto it = block.entries.find(key);
  if (it != block.entries.end()) {
    it->second.used = true;
    return &it->second;
  }
  if (!required) return nullptr;
  if (const auto* misspelt = find_misspelt(block, key)) {
    document.fail(misspelt->second.line, join(block.path, misspelt->first),
                  "unknown key; did you mean '" + std::string(key) + "', which is missing?");
  } else {
    document.fail(block.line, join(block.path, key), "is missing");
  }
  return nullptr;
}

void fail_entry(YamlDocument& document, std::size_t index, std::string_view key, const Entry& entry,
                std::string_view message) {
  document.fail(entry.line, join(document.blocks[index].path, key), message);
}

}  // namespace

bool Section::has(std::string_view key) const {
  const Block& block = document_->blocks[index_];
  return block.entries.find(key) != block.entries.end();
}

double Section::number(std::string_view key, Range range) {
  Entry* entry = find_entry(*document_, index_, key, true);
  return entry ? number_or(key, 0, range) : 0;
}

double Section::number_or(std::string_view key, double fallback, Range range) {
  Entry* entry = find_entry(*document_, index_, key, false);
  if (!entry) return fallback;
  double value = 0;
  const auto wrong = check_number(entry->value, range, value);
  if (wrong) fail_entry(*document_, index_, key, *entry, *wrong);
  return wrong ? fallback : value;
}

std::int64_t Section::integer(std::string_view key, IntRange range) {
  Entry* entry = find_entry(*document_, index_, key, true);
  return entry ? integer_or(key, 0, range) : 0;
}

std::int64_t Section::integer_or(std::string_view key, std::int64_t fallback, IntRange range) {
  Entry* entry = find_entry(*document_, index_, key, false);
  if (!entry) return fallback;
  std::int64_t value = 0;
  if (!entry->value.IsScalar() || !parse_whole(entry->value.Scalar(), value)) {
    fail_entry(*document_, index_, key, *entry,
               "needs a whole number, has " + describe(entry->value));
    return fallback;
  }
  if (value < range.min || value > range.max) {
    fail_entry(*document_, index_, key, *entry,
               "must be from " + std::to_string(range.min) + " to " + std::to_string(range.max) +
                   ", is " + std::to_string(value));
    return fallback;
  }
  return value;
}

bool Section::flag(std::string_view key) {
  Entry* entry = find_entry(*document_, index_, key, true);
  return entry ? flag_or(key, false) : false;
}

bool Section::flag_or(std::string_view key, bool fallback) {
  Entry* entry = find_entry(*document_, index_, key, false);
  if (!entry) return fallback;
  bool value = fallback;
  if (!entry->value.IsScalar() || !YAML::convert<bool>::decode(entry->value, value))
    fail_entry(*document_, index_, key, *entry,
               "needs true or false, has " + describe(entry->value));
  return value;
}

std::string Section::text(std::string_view key) {
  Entry* entry = find_entry(*document_, index_, key, true);
  return entry ? text_or(key, "") : "";
}

std::string Section::text_or(std::string_view key, std::string fallback) {
  Entry* entry = find_entry(*document_, index_, key, false);
  if (!entry) return fallback;
  if (entry->value.IsScalar()) return entry->value.Scalar();
  fail_entry(*document_, index_, key, *entry, "needs a text, has " + describe(entry->value));
  return fallback;
}

std::vector<double> Section::numbers(std::string_view key, std::size_t least, std::size_t most,
                                     std::string_view what, Range range) {
  Entry* entry = find_entry(*document_, index_, key, true);
  if (!entry) return {};
  std::string needs = "needs " + std::to_string(least);
  if (least != most) needs += " to " + std::to_string(most);
  needs += " numbers (" + std::string(what) + "), has ";
  if (!entry->value.IsSequence()) {
    fail_entry(*document_, index_, key, *entry, needs + describe(entry->value));
    return {};
  }
  const std::size_t count = entry->value.size();
  if (count < least || count > most) {
    fail_entry(*document_, index_, key, *entry, needs + std::to_string(count));
    return {};
  }
  std::vector<double> out(count);
  for (std::size_t i = 0; i < count; ++i) {
    if (const auto wrong = check_number(entry->value[i], range, out[i])) {
      fail_entry(*document_, index_, key, *entry,
                 "number " + std::to_string(i + 1) + " of (" + std::string(what) + ") " + *wrong);
      return {};
    }
  }
  return out;
}

std::optional<std::size_t> Section::pick_index(std::string_view key,
                                               std::span<const std::string_view> names,
                                               bool required) {
  Entry* entry = find_entry(*document_, index_, key, required);
  if (!entry) return std::nullopt;
  std::string list;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (entry->value.IsScalar() && entry->value.Scalar() == names[i]) return i;
    list += (i == 0 ? "" : ", ") + std::string(names[i]);
  }
  fail_entry(*document_, index_, key, *entry,
             "must be one of " + list + "; has " + describe(entry->value));
  return std::nullopt;
}

Section Section::section(std::string_view key) {
  find_entry(*document_, index_, key, true);
  if (auto found = optional_section(key)) return *found;
  // After an error every section is as good as another: nothing is read from it any more.
  return *this;
}

std::optional<Section> Section::optional_section(std::string_view key) {
  Entry* entry = find_entry(*document_, index_, key, false);
  if (!entry) return std::nullopt;
  if (!entry->value.IsMap()) {
    fail_entry(*document_, index_, key, *entry,
               "needs a block of keys, has " + describe(entry->value));
    return std::nullopt;
  }
  if (!entry->section) {
    entry->section = document_->blocks.size();
    Block& block = document_->blocks.emplace_back();
    block.path = join(document_->blocks[index_].path, key);
    block.line = entry->line;
    fill_block(*document_, block, entry->value);
  }
  return Section(document_, *entry->section);
}

void Section::fail(std::string_view key, std::string_view message) {
  const Block& block = document_->blocks[index_];
  const auto it = block.entries.find(key);
  const int line = it == block.entries.end() ? block.line : it->second.line;
  document_->fail(line, join(block.path, key), message);
}

bool Section::ok() const {
  return !document_->error;
}

Status Section::status() const {
  return document_->error ? Status(*document_->error) : Status();
}

Status Section::finish() const {
  for (const Block& block : document_->blocks) {
    for (const auto& [key, entry] : block.entries) {
      if (document_->error) return *document_->error;
      if (entry.used) continue;
      std::string message = "unknown key";
      for (const std::string& known : block.asked) {
        if (!is_near(key, known)) continue;
        message += "; did you mean '" + known + "'?";
        break;
      }
      document_->fail(entry.line, join(block.path, key), message);
    }
  }
  return status();
}

Result<Section> parse_yaml(const std::string& text, const std::string& file) {
  auto document = std::make_shared<YamlDocument>();
  document->file = file;
  document->blocks.emplace_back();
  try {
    const YAML::Node root = YAML::Load(text);
    if (!root.IsMap() && !root.IsNull())
      document->fail(1, "", "needs 'key: value' lines, has " + describe(root));
    else
      fill_block(*document, document->blocks.front(), root);
  } catch (const YAML::Exception& error) {
    document->fail(error.mark.line + 1, "", "is not valid YAML: " + error.msg);
  }
  if (document->error) return *document->error;
  return Section(document, 0);
}

Result<Section> load_yaml(const std::string& path) {
  std::ifstream in(path);
  std::error_code ignored;
  if (!in || std::filesystem::is_directory(path, ignored))
    return Error{ErrorCode::kNotFound, path + ": can't be read; is the path right?"};
  std::ostringstream text;
  text << in.rdbuf();
  return parse_yaml(text.str(), path);
}

}  // namespace cairn
