#include "client/frontend/resize.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace cairn {
namespace {

constexpr int kGroup = 8;         // target pixels
constexpr int kGroupSource = 16;  // bytes that they are made of

}  // namespace

ResizeMap::Taps ResizeMap::taps(int target, int from_size, int to_size) {
  const double scale = static_cast<double>(from_size) / to_size;
  const double at = std::clamp((target + 0.5) * scale - 0.5, 0.0, from_size - 1.0);
  const int from = static_cast<int>(at);
  return {from, at - from};
}

ResizeMap::ResizeMap(cv::Size from, cv::Size to) {
  make_columns(from.width, to.width);
  for (int y = 0; y < to.height; ++y) {
    const Taps t = taps(y, from.height, to.height);
    row_.push_back(t.from);
    row_step_.push_back(t.from + 1 < from.height ? 1 : 0);
    row_weight_.push_back(std::min(32767, static_cast<int>(std::lround(t.part * 32768))));
  }
}

void ResizeMap::make_columns(int from, int to) {
  width_ = to;
  const int padded = (to + kGroup - 1) / kGroup * kGroup;
  for (int x = 0; x < padded; ++x) {
    const Taps t = taps(std::min(x, to - 1), from, to);
    const auto right = static_cast<int>(std::lround(t.part * 128));
    from_.push_back(t.from);
    step_.push_back(t.from + 1 < from ? 1 : 0);
    weight_.push_back(static_cast<std::uint8_t>(128 - right));
    weight_.push_back(static_cast<std::uint8_t>(right));
  }
  in_groups_ = from >= kGroupSource;
  for (int x = 0; x < padded; ++x) {
    const auto i = static_cast<std::size_t>(x), first = i / kGroup * kGroup;
    if (i == first) group_.push_back(std::clamp(from_[i], 0, std::max(0, from - kGroupSource)));
    const int left = from_[i] - group_.back(), right = left + step_[i];
    in_groups_ = in_groups_ && right < kGroupSource;
    shuffle_.push_back(static_cast<std::uint8_t>(left));
    shuffle_.push_back(static_cast<std::uint8_t>(right));
  }
  for (auto& line : lines_) line.resize(static_cast<std::size_t>(padded));
}

void ResizeMap::apply(const cv::Mat& in, cv::Mat& out, const Kernels& kernels) {
  const ResizeColumns columns{.width = width_,
                              .in_groups = in_groups_,
                              .from = from_.data(),
                              .step = step_.data(),
                              .weight = weight_.data(),
                              .group = group_.data(),
                              .shuffle = shuffle_.data()};
  std::array<int, 2> held = {-1, -1};  // the source rows in lines_
  const auto line = [&](int row, int other) {
    for (std::size_t i = 0; i < 2; ++i)
      if (held[i] == row) return lines_[i].data();
    const std::size_t i = held[0] == other ? 1 : 0;
    kernels.resize_across(in.ptr<std::uint8_t>(row), columns, lines_[i].data());
    held[i] = row;
    return lines_[i].data();
  };
  for (int y = 0; y < out.rows; ++y) {
    const auto i = static_cast<std::size_t>(y);
    const int upper = row_[i], lower = upper + row_step_[i];
    const std::int16_t* const above = line(upper, lower);
    const std::int16_t* const below = line(lower, upper);
    kernels.resize_down(above, below, row_weight_[i], width_, out.ptr<std::uint8_t>(y));
  }
}

}  // namespace cairn
