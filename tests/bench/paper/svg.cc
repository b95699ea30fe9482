#include "tests/bench/paper/svg.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace cairn::bench {
namespace {

constexpr double kWidth = 760, kHeight = 400;
constexpr double kLeft = 70, kRight = 20, kTop = 60, kBottom = 55;
// Told apart by people who don't see colours as most do (Okabe and Ito 2008).
constexpr std::array<const char*, 6> kColours = {"#000000", "#d55e00", "#0072b2",
                                                 "#009e73", "#cc79a7", "#e69f00"};
const char* colour(std::size_t i) {
  return kColours[i % kColours.size()];
}

struct Range {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();
  void add(double value) {
    if (!std::isfinite(value)) return;
    low = std::min(low, value);
    high = std::max(high, value);
  }
  void settle() {  // never empty
    if (!(low <= high)) low = 0, high = 1;
    if (high - low < 1e-12) high = low + 1;
  }
  double size() const { return high - low; }
};

// 1, 2 or 5 times a power of ten, so that about five of it fill the range.
double tick_step(double size) {
  const double raw = size / 5, power = std::pow(10, std::floor(std::log10(raw)));
  const double lead = raw / power;
  return power * (lead < 1.5 ? 1 : lead < 3.5 ? 2 : lead < 7.5 ? 5 : 10);
}

std::string text(double x, double y, const std::string& what, const char* anchor,
                 const char* more = "") {
  return fmt::format(
      "<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\" font-size=\"12\" {}>{}</text>\n", x, y,
      anchor, more, what);
}

// Maps values to the drawing.
struct Frame {
  Range x, y;
  double px(double v) const { return kLeft + (v - x.low) / x.size() * (kWidth - kLeft - kRight); }
  double py(double v) const {
    return kHeight - kBottom - (v - y.low) / y.size() * (kHeight - kTop - kBottom);
  }
};

std::string head(const std::string& title, const std::string& x_label, const std::string& y_label) {
  return fmt::format(
             "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0} {1}\" width=\"{0}\" "
             "height=\"{1}\" font-family=\"sans-serif\">\n<rect width=\"{0}\" height=\"{1}\" "
             "fill=\"white\"/>\n",
             kWidth, kHeight) +
         text(kWidth / 2, 20, title, "middle", "font-weight=\"bold\"") +
         text((kLeft + kWidth - kRight) / 2, kHeight - 12, x_label, "middle") +
         text(16, kHeight / 2, y_label, "middle",
              fmt::format("transform=\"rotate(-90 16 {})\"", kHeight / 2).c_str());
}

std::string y_axis(const Frame& frame) {
  std::string out;
  const double step = tick_step(frame.y.size());
  for (double v = std::ceil(frame.y.low / step) * step; v <= frame.y.high + 1e-9 * step; v += step)
    out +=
        fmt::format("<path d=\"M{} {:.1f}H{}\" stroke=\"#ddd\"/>\n", kLeft, frame.py(v),
                    kWidth - kRight) +
        text(kLeft - 6, frame.py(v) + 4, fmt::format("{:.4g}", std::abs(v) < 1e-9 ? 0 : v), "end");
  return out;
}

std::string x_axis(const Frame& frame) {
  std::string out;
  const double step = tick_step(frame.x.size());
  for (double v = std::ceil(frame.x.low / step) * step; v <= frame.x.high + 1e-9 * step; v += step)
    out += text(frame.px(v), kHeight - kBottom + 16,
                fmt::format("{:.4g}", std::abs(v) < 1e-9 ? 0 : v), "middle");
  return out;
}

std::string legend(const std::vector<std::string>& names) {
  std::string out;
  double x = kLeft;
  for (std::size_t i = 0; i < names.size(); ++i) {
    out += fmt::format("<rect x=\"{:.1f}\" y=\"32\" width=\"14\" height=\"10\" fill=\"{}\"/>\n", x,
                       colour(i)) +
           text(x + 19, 42, names[i], "start");
    x += 40 + 7.2 * static_cast<double>(names[i].size());
  }
  return out;
}

std::string polyline(const Frame& frame, const Line& line, const char* stroke) {
  std::string path;
  bool open = false;
  for (const ChartPoint& p : line.points) {
    const bool drawn = std::isfinite(p.x) && std::isfinite(p.y);
    if (drawn)
      path += fmt::format("{}{:.1f} {:.1f}", open ? 'L' : 'M', frame.px(p.x), frame.py(p.y));
    open = drawn;
  }
  return fmt::format("<path d=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"1.6\"/>\n", path,
                     stroke);
}

// Widens one of the ranges so that both have the same scale.
void make_equal(Frame& frame) {
  const double across = (kWidth - kLeft - kRight) / frame.x.size();
  const double up = (kHeight - kTop - kBottom) / frame.y.size();
  Range& wide = across > up ? frame.x : frame.y;
  const double more = wide.size() * (std::max(across, up) / std::min(across, up) - 1) / 2;
  wide.low -= more;
  wide.high += more;
}

}  // namespace

std::string draw(const LineChart& chart) {
  Frame frame;
  if (!chart.equal_axes) frame.y.add(0);
  std::vector<std::string> names;
  for (const Line& line : chart.lines) {
    names.push_back(line.name);
    for (const ChartPoint& p : line.points) {
      frame.x.add(p.x);
      frame.y.add(p.y);
    }
  }
  frame.x.settle();
  frame.y.settle();
  if (chart.equal_axes) make_equal(frame);
  std::string out = head(chart.title, chart.x_label, chart.y_label) + y_axis(frame) +
                    x_axis(frame) + legend(names);
  for (std::size_t i = 0; i < chart.lines.size(); ++i)
    out += polyline(frame, chart.lines[i], colour(i));
  return out + "</svg>\n";
}

std::string draw(const BarChart& chart) {
  Frame frame;
  frame.x = {0, static_cast<double>(std::max<std::size_t>(1, chart.groups.size()))};
  frame.y.add(0);
  std::vector<std::string> names;
  for (const auto& bars : chart.bars) {
    names.push_back(bars.name);
    for (const double value : bars.values) frame.y.add(value);
  }
  frame.y.settle();
  std::string out = head(chart.title, "", chart.y_label) + y_axis(frame) + legend(names);
  const double width = 0.8 / static_cast<double>(std::max<std::size_t>(1, chart.bars.size()));
  for (std::size_t g = 0; g < chart.groups.size(); ++g) {
    const double left = static_cast<double>(g) + 0.1;
    out += text(frame.px(left + 0.4), kHeight - kBottom + 16, chart.groups[g], "middle");
    for (std::size_t i = 0; i < chart.bars.size(); ++i) {
      const double value = chart.bars[i].values.at(g), x = left + width * static_cast<double>(i);
      if (!std::isfinite(value)) {
        out += text(frame.px(x + width / 2), frame.py(0) - 4, "fails", "middle");
        continue;
      }
      out += fmt::format(
          "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" fill=\"{}\"/>\n",
          frame.px(x), frame.py(value), frame.px(x + 0.94 * width) - frame.px(x),
          frame.py(0) - frame.py(value), colour(i));
    }
  }
  return out + "</svg>\n";
}

}  // namespace cairn::bench
