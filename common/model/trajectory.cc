#include "common/model/trajectory.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string_view>

#include "common/util/clock.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

// Words of a line, separated by blanks or commas. Valid as long as the line is.
std::vector<std::string_view> words_of(std::string_view line) {
  constexpr std::string_view kSeparators = " \t\r\n,";
  std::vector<std::string_view> words;
  for (std::size_t at = line.find_first_not_of(kSeparators); at != line.npos;
       at = line.find_first_not_of(kSeparators, at)) {
    const std::size_t end = std::min(line.find_first_of(kSeparators, at), line.size());
    words.push_back(line.substr(at, end - at));
    at = end;
  }
  return words;
}

std::optional<double> to_number(std::string_view word) {
  if (word.starts_with('+')) word.remove_prefix(1);
  double value = 0;
  const auto [end, code] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (code != std::errc() || end != word.data() + word.size() || !std::isfinite(value))
    return std::nullopt;
  return value;
}

// Seconds as text to nanoseconds. Digit by digit: a double has no room for today's date and
// nanoseconds both.
std::optional<std::int64_t> stamp_from_seconds(std::string_view word) {
  const std::size_t dot = word.find('.');
  const std::string_view whole = word.substr(0, dot);
  std::int64_t seconds = 0;
  const auto [end, code] = std::from_chars(whole.data(), whole.data() + whole.size(), seconds);
  constexpr std::int64_t kMaxSeconds = 9'000'000'000;
  const bool plain = code == std::errc() && end == whole.data() + whole.size();
  if (plain && (seconds < 0 || seconds > kMaxSeconds)) return std::nullopt;
  if (plain) {
    std::string digits(dot == word.npos ? "" : word.substr(dot + 1));
    if (std::all_of(digits.begin(), digits.end(), [](char c) { return c >= '0' && c <= '9'; })) {
      digits.resize(9, '0');
      return seconds * kNanosPerSecond + std::stoll(digits);
    }
  }
  const auto value = to_number(word);  // 1.305e+09 and the like, as numpy writes them
  if (!value || *value < 0 || *value > static_cast<double>(kMaxSeconds)) return std::nullopt;
  return static_cast<std::int64_t>(std::llround(*value * 1e9));
}

std::optional<Rigid3> pose_from(const Eigen::Vector3d& t, double qw, double qx, double qy,
                                double qz) {
  const Eigen::Quaterniond q(qw, qx, qy, qz);
  // Files print four digits or more; far from unit length the columns mean something else.
  if (std::abs(q.norm() - 1) > 0.05) return std::nullopt;
  return Rigid3(q.normalized(), t);
}

// N numbers from the given word on; there are as many.
template <int N>
std::optional<Eigen::Vector<double, N>> numbers_from(const std::vector<std::string_view>& words,
                                                     std::size_t first) {
  Eigen::Vector<double, N> numbers;
  for (int i = 0; i < N; ++i) {
    const auto number = to_number(words[first + i]);
    if (!number) return std::nullopt;
    numbers[i] = *number;
  }
  return numbers;
}

std::optional<StampedPose> parse_tum(const std::vector<std::string_view>& words) {
  if (words.size() != 8) return std::nullopt;
  const auto stamp = stamp_from_seconds(words[0]);
  const auto v = numbers_from<7>(words, 1);
  if (!v) return std::nullopt;
  const auto pose = pose_from(v->head<3>(), (*v)[6], (*v)[3], (*v)[4], (*v)[5]);
  if (!stamp || !pose) return std::nullopt;
  return StampedPose{*stamp, *pose};
}

std::optional<StampedPose> parse_euroc(const std::vector<std::string_view>& words) {
  if (words.size() < 8) return std::nullopt;
  std::int64_t stamp = 0;
  const auto [end, code] =
      std::from_chars(words[0].data(), words[0].data() + words[0].size(), stamp);
  if (code != std::errc() || end != words[0].data() + words[0].size() || stamp < 0)
    return std::nullopt;
  const auto v = numbers_from<7>(words, 1);
  if (!v) return std::nullopt;
  const auto pose = pose_from(v->head<3>(), (*v)[3], (*v)[4], (*v)[5], (*v)[6]);
  if (!pose) return std::nullopt;
  return StampedPose{stamp, *pose};
}

// KITTI: the stamp comes from elsewhere.
std::optional<StampedPose> parse_kitti(const std::vector<std::string_view>& words) {
  if (words.size() != 12) return std::nullopt;
  const auto v = numbers_from<12>(words, 0);
  if (!v) return std::nullopt;
  Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
  m.topRows<3>() = v->reshaped<Eigen::RowMajor>(3, 4);
  if (std::abs(m.topLeftCorner<3, 3>().determinant() - 1) > 0.05) return std::nullopt;
  return StampedPose{0, Rigid3::from_matrix(m)};
}

enum class Format { kTum, kEuroc, kKitti };

Format format_of(std::string_view line, const std::vector<std::string_view>& words) {
  if (line.find(',') != line.npos) return Format::kEuroc;
  return words.size() == 12 ? Format::kKitti : Format::kTum;
}

std::optional<StampedPose> parse(Format format, const std::vector<std::string_view>& words) {
  switch (format) {
    case Format::kEuroc:
      return parse_euroc(words);
    case Format::kKitti:
      return parse_kitti(words);
    case Format::kTum:
      break;
  }
  return parse_tum(words);
}

constexpr const char* kExpected[] = {
    "'seconds tx ty tz qx qy qz qw' (unit quaternion)",
    "'nanoseconds,px,py,pz,qw,qx,qy,qz,...' (unit quaternion)",
    "12 numbers of a 3x4 matrix that starts with a rotation",
};

Status add_kitti_stamps(const std::string& path, Trajectory& trajectory) {
  const fs::path times = fs::path(path).parent_path() / "times.txt";
  std::ifstream in(times);
  if (!in)
    return {ErrorCode::kNotFound,
            path + ": poses in KITTI format need " + times.string() + " for their time stamps"};
  std::size_t count = 0;
  for (std::string line; count < trajectory.size() && std::getline(in, line);) {
    const auto words = words_of(line);
    if (words.empty()) continue;
    const auto stamp = stamp_from_seconds(words[0]);
    if (!stamp) return {ErrorCode::kCorrupt, times.string() + ": '" + line + "' is no time"};
    trajectory[count++].stamp_ns = *stamp;
  }
  if (count < trajectory.size())
    return {ErrorCode::kCorrupt, times.string() + ": has fewer lines than " + path};
  return {};
}

void sort_by_time(Trajectory& trajectory) {
  std::stable_sort(trajectory.begin(), trajectory.end(),
                   [](const auto& a, const auto& b) { return a.stamp_ns < b.stamp_ns; });
  const auto end =
      std::unique(trajectory.begin(), trajectory.end(),
                  [](const auto& a, const auto& b) { return a.stamp_ns == b.stamp_ns; });
  trajectory.erase(end, trajectory.end());
}

}  // namespace

Result<Trajectory> read_trajectory(const std::string& path) {
  std::ifstream in(path);
  std::error_code ignored;
  if (!in || fs::is_directory(path, ignored))
    return Error{ErrorCode::kNotFound, path + ": can't be read; is the path right?"};
  Trajectory trajectory;
  std::optional<Format> format;
  int line_number = 0;
  for (std::string line; std::getline(in, line);) {
    ++line_number;
    const auto words = words_of(line);
    if (words.empty() || words[0].starts_with('#')) continue;
    if (!format) format = format_of(line, words);
    const auto pose = parse(*format, words);
    if (!pose)
      return Error{ErrorCode::kCorrupt, path + ":" + std::to_string(line_number) + ": expected " +
                                            kExpected[static_cast<int>(*format)]};
    trajectory.push_back(*pose);
  }
  if (trajectory.empty()) return Error{ErrorCode::kCorrupt, path + ": holds no pose"};
  if (*format == Format::kKitti)
    if (const Status status = add_kitti_stamps(path, trajectory); !status) return status.error();
  sort_by_time(trajectory);
  return trajectory;
}

std::string tum_line(const StampedPose& pose) {
  const auto& t = pose.world_from_camera.translation;
  const auto& q = pose.world_from_camera.rotation;
  // Integer arithmetic keeps all nine digits of the stamp: a double of today's seconds has seven.
  std::array<char, 512> line{};
  std::snprintf(line.data(), line.size(), "%lld.%09lld %.7f %.7f %.7f %.9f %.9f %.9f %.9f",
                static_cast<long long>(pose.stamp_ns / kNanosPerSecond),
                static_cast<long long>(pose.stamp_ns % kNanosPerSecond), t.x(), t.y(), t.z(), q.x(),
                q.y(), q.z(), q.w());
  return line.data();
}

Status write_trajectory(const std::string& path, const Trajectory& trajectory) {
  std::ofstream out(path);
  for (const StampedPose& pose : trajectory) out << tum_line(pose) << '\n';
  out.close();
  if (!out)
    return {ErrorCode::kUnavailable,
            path + ": can't write the trajectory; is the folder there and writable?"};
  return {};
}

}  // namespace cairn
