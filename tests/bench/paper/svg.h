// Charts as SVG text: lines, bars, and paths on a plane. Enough for a results page, no more.
#pragma once

#include <string>
#include <vector>

namespace cairn::bench {

struct ChartPoint {
  double x = 0, y = 0;  // points that are not finite interrupt a line
};

struct Line {
  std::string name;  // in the legend
  std::vector<ChartPoint> points;
};

struct LineChart {
  std::string title, x_label, y_label;
  std::vector<Line> lines;
  bool equal_axes = false;  // a metre is as long to the right as upward; the axes needn't hold 0
};
std::string draw(const LineChart& chart);

struct BarChart {
  std::string title, y_label;
  std::vector<std::string> groups;  // along x
  struct Bars {
    std::string name;            // in the legend
    std::vector<double> values;  // one a group; not finite: none, marked so
  };
  std::vector<Bars> bars;
};
std::string draw(const BarChart& chart);

}  // namespace cairn::bench
