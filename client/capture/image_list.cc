#include "client/capture/image_list.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <set>
#include <tuple>

#include "common/util/clock.h"
#include "common/util/log.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

std::string_view trim(std::string_view text) {
  constexpr std::string_view kBlanks = " \t\r\n";
  const auto first = text.find_first_not_of(kBlanks);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlanks) - first + 1);
}

// The text up to the next separator; `rest` moves behind it.
std::string_view next_field(std::string_view& rest, std::string_view separators) {
  rest = trim(rest);
  const auto end = std::min(rest.find_first_of(separators), rest.size());
  const std::string_view field = rest.substr(0, end);
  rest.remove_prefix(std::min(end + 1, rest.size()));
  return trim(field);
}

std::optional<ListedImage> parse_line(std::string_view line, const fs::path& base,
                                      ListFormat format) {
  const std::string_view separators = format == ListFormat::kTum ? " \t" : ",";
  const std::string_view stamp = next_field(line, separators);
  const std::string_view name = next_field(line, separators);
  const auto stamp_ns =
      format == ListFormat::kTum ? parse_seconds(stamp) : parse_nanoseconds(stamp);
  if (!stamp_ns || name.empty()) return std::nullopt;
  return ListedImage{*stamp_ns, base / name};
}

bool has_image_extension(const fs::path& file) {
  static const std::set<std::string> kExtensions = {".png", ".jpg", ".jpeg", ".bmp",
                                                    ".pgm", ".ppm", ".tif",  ".tiff"};
  std::string extension = file.extension().string();
  for (char& c : extension) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return kExtensions.contains(extension);
}

}  // namespace

std::optional<std::int64_t> parse_nanoseconds(std::string_view text) {
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || value < 0) return std::nullopt;
  return value;
}

std::optional<std::int64_t> parse_seconds(std::string_view text) {
  constexpr std::int64_t kMaxSeconds = 9'000'000'000;  // int64 nanoseconds end in the year 2262
  const auto dot = text.find('.');
  const std::string_view whole = text.substr(0, dot);
  const std::string_view fraction =
      dot == std::string_view::npos ? std::string_view() : text.substr(dot + 1);
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  if (!whole.empty() && std::all_of(whole.begin(), whole.end(), is_digit) &&
      std::all_of(fraction.begin(), fraction.end(), is_digit)) {
    const auto seconds = parse_nanoseconds(whole);
    if (!seconds || *seconds > kMaxSeconds) return std::nullopt;
    std::int64_t nanoseconds = 0;
    for (std::size_t i = 0; i < 9; ++i) {
      nanoseconds = 10 * nanoseconds + (i < fraction.size() ? fraction[i] - '0' : 0);
    }
    return *seconds * kNanosPerSecond + nanoseconds;
  }
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  if (!(value >= 0 && value <= static_cast<double>(kMaxSeconds))) return std::nullopt;
  return std::llround(value * 1e9);
}

Result<std::vector<ListedImage>> read_image_list(const fs::path& file, const fs::path& base,
                                                 ListFormat format) {
  std::ifstream stream(file);
  if (!stream) return {ErrorCode::kNotFound, file.string() + ": can't be read"};
  std::vector<ListedImage> images;
  std::string line;
  for (int number = 1; std::getline(stream, line); ++number) {
    const std::string_view content = trim(line);
    if (content.empty() || content.front() == '#') continue;
    if (auto image = parse_line(content, base, format)) {
      images.push_back(std::move(*image));
    } else {
      log::warn("{}:{}: no time stamp and file name, line left out", file.string(), number);
    }
  }
  if (images.empty()) return {ErrorCode::kCorrupt, file.string() + ": lists no images"};
  std::stable_sort(images.begin(), images.end(), [](const ListedImage& a, const ListedImage& b) {
    return a.stamp_ns < b.stamp_ns;
  });
  return images;
}

Result<std::vector<fs::path>> list_images(const fs::path& folder) {
  std::error_code error;
  std::vector<fs::path> files;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error)) {
    if (has_image_extension(it->path())) files.push_back(it->path());
  }
  if (error) return {ErrorCode::kNotFound, folder.string() + ": " + error.message()};
  if (files.empty()) return {ErrorCode::kNotFound, folder.string() + ": holds no images"};
  std::sort(files.begin(), files.end());
  return files;
}

std::vector<std::pair<std::size_t, std::size_t>> associate(const std::vector<ListedImage>& a,
                                                           const std::vector<ListedImage>& b,
                                                           std::int64_t max_gap_ns) {
  std::vector<std::tuple<std::int64_t, std::size_t, std::size_t>> candidates;  // gap, a, b
  std::size_t first = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    while (first < b.size() && b[first].stamp_ns < a[i].stamp_ns - max_gap_ns) ++first;
    for (std::size_t j = first; j < b.size() && b[j].stamp_ns <= a[i].stamp_ns + max_gap_ns; ++j) {
      candidates.emplace_back(std::abs(a[i].stamp_ns - b[j].stamp_ns), i, j);
    }
  }
  std::sort(candidates.begin(), candidates.end());
  std::vector<bool> used_a(a.size()), used_b(b.size());
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  for (const auto& [gap, i, j] : candidates) {
    if (used_a[i] || used_b[j]) continue;
    used_a[i] = used_b[j] = true;
    pairs.emplace_back(i, j);
  }
  std::sort(pairs.begin(), pairs.end());
  return pairs;
}

}  // namespace cairn
