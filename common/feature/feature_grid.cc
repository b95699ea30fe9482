#include "common/feature/feature_grid.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace cairn {
namespace {

constexpr float kCellSize = 16.0f;  // pixels; a search radius is mostly 5 to 40

}  // namespace

FeatureGrid::FeatureGrid(const Features& features, const PinholeCamera& camera)
    : left_(-0.25f * static_cast<float>(camera.width)),
      top_(-0.25f * static_cast<float>(camera.height)) {
  columns_ =
      std::max(1, static_cast<int>(std::ceil(1.5f * static_cast<float>(camera.width) / kCellSize)));
  rows_ = std::max(
      1, static_cast<int>(std::ceil(1.5f * static_cast<float>(camera.height) / kCellSize)));

  const auto cell_of = [&](const Feature& f) { return row(f.y) * columns_ + column(f.x); };
  starts_.assign(static_cast<std::size_t>(columns_ * rows_) + 1, 0);
  for (const Feature& f : features.points) ++starts_[static_cast<std::size_t>(cell_of(f)) + 1];
  std::partial_sum(starts_.begin(), starts_.end(), starts_.begin());

  entries_.resize(features.size());
  std::vector<std::uint32_t> next(starts_.begin(), starts_.end() - 1);
  for (std::size_t i = 0; i < features.size(); ++i) {
    const Feature& f = features.points[i];
    entries_[next[static_cast<std::size_t>(cell_of(f))]++] = {
        f.x, f.y, static_cast<std::uint16_t>(i), f.octave};
  }
}

int FeatureGrid::column(float x) const {
  return std::clamp(static_cast<int>((x - left_) / kCellSize), 0, columns_ - 1);
}

int FeatureGrid::row(float y) const {
  return std::clamp(static_cast<int>((y - top_) / kCellSize), 0, rows_ - 1);
}

void FeatureGrid::search(float x, float y, float radius, int min_octave, int max_octave,
                         std::vector<std::uint16_t>& found) const {
  const int first_column = column(x - radius), last_column = column(x + radius);
  const int first_row = row(y - radius), last_row = row(y + radius);
  for (int r = first_row; r <= last_row; ++r) {
    const std::size_t begin = starts_[static_cast<std::size_t>(r * columns_ + first_column)];
    const std::size_t end = starts_[static_cast<std::size_t>(r * columns_ + last_column) + 1];
    for (std::size_t i = begin; i < end; ++i) {
      const Entry& e = entries_[i];
      if (std::abs(e.x - x) <= radius && std::abs(e.y - y) <= radius && e.octave >= min_octave &&
          e.octave <= max_octave)
        found.push_back(e.index);
    }
  }
}

}  // namespace cairn
