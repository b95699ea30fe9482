#include "tests/support/paint.h"

#include <cmath>
#include <numbers>
#include <vector>

#include <opencv2/imgproc.hpp>

namespace cairn::synthetic::paint {
namespace {

constexpr int kShift = 4;  // drawing with 1/16 pixel
constexpr double kSub = 1 << kShift;

cv::Point fixed_point(double x, double y) {
  return {static_cast<int>(std::lround(x * kSub)), static_cast<int>(std::lround(y * kSub))};
}

cv::Mat blank(const Area& area, double level) {
  return cv::Mat(area.rows(), area.columns(), CV_8UC1, cv::Scalar(level));
}

void fill(cv::Mat& canvas, const std::vector<cv::Point>& outline, double level) {
  cv::fillConvexPoly(canvas, outline, cv::Scalar(level), cv::LINE_AA, kShift);
}

void fill_rectangle(cv::Mat& canvas, double x, double y, double w, double h, double level) {
  fill(canvas,
       {fixed_point(x, y), fixed_point(x + w, y), fixed_point(x + w, y + h), fixed_point(x, y + h)},
       level);
}

void stroke(cv::Mat& canvas, double x0, double y0, double x1, double y1, double thickness,
            double level) {
  const int width = std::max(1, static_cast<int>(std::lround(thickness)));
  cv::line(canvas, fixed_point(x0, y0), fixed_point(x1, y1), cv::Scalar(level), width, cv::LINE_AA,
           kShift);
}

// A disc, a turned rectangle or a triangle of about the given radius (pixels).
void random_shape(Random& random, cv::Mat& canvas, double x, double y, double radius,
                  double level) {
  const int kind = random.integer(4);
  if (kind == 0) {
    cv::ellipse(canvas, fixed_point(x, y),
                cv::Size(static_cast<int>(radius * kSub),
                         static_cast<int>(radius * random.uniform(0.5, 1.0) * kSub)),
                random.uniform(0, 180), 0, 360, cv::Scalar(level), cv::FILLED, cv::LINE_AA, kShift);
    return;
  }
  std::vector<cv::Point> outline;
  const double turn = random.uniform(0, 2 * std::numbers::pi);
  const double half = kind == 1 ? std::numbers::pi / 3 : random.uniform(0.5, 1.07);
  const std::vector<double> angles =
      kind == 1
          ? std::vector<double>{0, 2 * half, 4 * half}
          : std::vector<double>{-half, half, std::numbers::pi - half, std::numbers::pi + half};
  for (const double a : angles) {
    outline.push_back(
        fixed_point(x + radius * std::cos(turn + a), y + radius * std::sin(turn + a)));
  }
  fill(canvas, outline, level);
}

// Radii with density r^-3 between the limits: as many covered pixels in each octave of size.
double power_law_radius(Random& random, double low, double high) {
  const double share = random.uniform();
  return 1.0 / std::sqrt(share / (low * low) + (1 - share) / (high * high));
}

// One line of glyphs, each of two to four strokes in its box, with gaps between words.
void text_line(Random& random, cv::Mat& canvas, double x, double y, double length, double height,
               double level) {
  const double end = x + length;
  while (x + height * 0.6 < end) {
    const int glyphs = 2 + random.integer(7);
    for (int g = 0; g < glyphs && x + height * 0.6 < end; ++g, x += height * 0.75) {
      const int strokes = 2 + random.integer(3);
      for (int s = 0; s < strokes; ++s) {
        stroke(canvas, x + random.integer(3) * height * 0.3, y + random.integer(3) * height * 0.5,
               x + random.integer(3) * height * 0.3, y + random.integer(3) * height * 0.5,
               height * 0.14, level);
      }
    }
    x += height * 0.7;
  }
}

cv::Mat to_levels(const cv::Mat& canvas) {
  cv::Mat levels;
  canvas.convertTo(levels, CV_32F);
  return levels;
}

// levels += factor * noise. Plain calls instead of OpenCV's matrix expressions, whose tables are
// made on first use in a way that thread sanitizers can't see.
void add_scaled(cv::Mat& levels, const cv::Mat& noise, double factor) {
  cv::scaleAdd(noise, factor, levels, levels);
}

// Adds grain whose strength varies over the surface: rough here, smooth there.
void add_grain(Random& random, const Area& area, cv::Mat& levels, double amplitude) {
  const cv::Mat fine = fractal(random, area, 0.15, 0.85);
  cv::Mat strength = fractal(random, area, 0.8, 0.4);
  strength.convertTo(strength, CV_32F, 0.5, 0.6);
  cv::max(strength, cv::Scalar(0.15), strength);
  cv::multiply(fine, strength, strength);
  add_scaled(levels, strength, amplitude);
}

void cover_with_shapes(Random& random, const Area& area, cv::Mat& canvas, double smallest,
                       double largest, double level, double contrast, double coverage) {
  const double low = smallest * area.pixels_per_metre, high = largest * area.pixels_per_metre;
  double covered = 0;
  const double wanted = coverage * static_cast<double>(canvas.total());
  while (covered < wanted) {
    const double radius = power_law_radius(random, low, high);
    random_shape(random, canvas, random.uniform(0, canvas.cols), random.uniform(0, canvas.rows),
                 radius, std::clamp(level + contrast * random.uniform(-1, 1), 4.0, 250.0));
    covered += 2.0 * radius * radius;
  }
}

}  // namespace

cv::Mat fractal(Random& random, const Area& area, double coarsest, double persistence) {
  const int columns = area.columns(), rows = area.rows();
  int octaves = 1;
  while ((1 << octaves) < coarsest * area.pixels_per_metre && octaves < 10) ++octaves;
  cv::Mat sum;
  double amplitude = 1, variance = 0;
  for (int octave = octaves - 1; octave >= 0; --octave, amplitude *= persistence) {
    const cv::Size size((columns >> octave) + 2, (rows >> octave) + 2);
    if (sum.empty()) {
      sum = cv::Mat(size, CV_32F, cv::Scalar(0));
    } else {
      cv::Mat doubled;
      cv::resize(sum, doubled, cv::Size(), 2, 2, cv::INTER_CUBIC);
      sum = doubled(cv::Rect(cv::Point(1, 1), cv::Size(std::min(size.width, doubled.cols - 1),
                                                       std::min(size.height, doubled.rows - 1))))
                .clone();
    }
    const float scale = static_cast<float>(amplitude * 0x1.0p-31);
    for (int y = 0; y < sum.rows; ++y) {
      float* row = sum.ptr<float>(y);
      for (int x = 0; x < sum.cols; ++x) {
        row[x] += scale * static_cast<float>(static_cast<std::int32_t>(random.bits() >> 32));
      }
    }
    variance += amplitude * amplitude / 3.0;
  }
  cv::Mat result = sum(cv::Rect(0, 0, columns, rows)).clone();
  result *= 1.0 / std::sqrt(variance);
  return result;
}

cv::Mat plaster(Random& random, const Area& area, double level, double contrast) {
  cv::Mat canvas = blank(area, level);
  const double ppm = area.pixels_per_metre;
  const int marks = static_cast<int>(area.width * area.height * 5);
  for (int i = 0; i < marks; ++i) {
    const double x = random.uniform(0, canvas.cols), y = random.uniform(0, canvas.rows);
    const double tone = level + contrast * random.uniform(-4, 3);
    if (random.chance(0.4)) {
      const double length = ppm * random.uniform(0.05, 0.5), turn = random.uniform(0, 6.28);
      stroke(canvas, x, y, x + length * std::cos(turn), y + length * std::sin(turn), 0.004 * ppm,
             std::clamp(tone, 5.0, 250.0));
    } else {
      random_shape(random, canvas, x, y, power_law_radius(random, 0.008 * ppm, 0.1 * ppm),
                   std::clamp(tone, 5.0, 250.0));
    }
  }
  cv::Mat levels = to_levels(canvas);
  add_scaled(levels, fractal(random, area, 3.0, 0.5), contrast);
  add_grain(random, area, levels, 0.35 * contrast);
  return levels;
}

cv::Mat leaves(Random& random, const Area& area, double level, double contrast) {
  cv::Mat canvas = blank(area, level);
  const double largest = std::max(0.5 * std::min(area.width, area.height), 0.04);
  cover_with_shapes(random, area, canvas, 0.02, largest, level, contrast, 3.0);
  cv::Mat levels = to_levels(canvas);
  add_grain(random, area, levels, 0.12 * contrast);
  return levels;
}

cv::Mat poster(Random& random, const Area& area) {
  const double ppm = area.pixels_per_metre;
  const bool dark = random.chance(0.4);
  cv::Mat canvas = blank(area, dark ? random.uniform(20, 60) : random.uniform(190, 235));
  const double border = 0.05 * area.width * ppm;
  const double ink = dark ? 220 : 25;
  const int picture_rows = static_cast<int>(canvas.rows * random.uniform(0.55, 0.75));
  const cv::Rect inner(static_cast<int>(border), static_cast<int>(border),
                       std::max(2, canvas.cols - 2 * static_cast<int>(border)),
                       std::max(2, picture_rows - static_cast<int>(border)));
  cv::Mat picture = canvas(inner);
  Area part = area;
  part.width = inner.width / ppm;
  part.height = inner.height / ppm;
  picture.setTo(random.uniform(60, 190));
  cover_with_shapes(random, part, picture, 0.006, 0.35 * part.width, 125, 100, 1.5);
  double y = picture_rows + border;
  double height = 0.05 * ppm * std::min(1.5, area.width / 0.6);
  while (y + height < canvas.rows - border) {
    text_line(random, canvas, border, y, canvas.cols - (2 + random.uniform(0, 3)) * border, height,
              ink);
    y += 1.7 * height;
    height = std::max(0.014 * ppm, 0.55 * height);
  }
  cv::Mat levels = to_levels(canvas);
  add_grain(random, area, levels, 4);
  return levels;
}

cv::Mat page(Random& random, const Area& area) {
  const double ppm = area.pixels_per_metre;
  cv::Mat canvas = blank(area, random.uniform(200, 240));
  const double margin = 0.02 * ppm, height = random.uniform(0.006, 0.012) * ppm;
  for (double y = margin; y + height < canvas.rows - margin; y += 1.9 * height) {
    if (random.chance(0.12)) continue;
    text_line(random, canvas, margin, y,
              (canvas.cols - 2 * margin) * (random.chance(0.2) ? random.uniform(0.2, 0.8) : 1.0),
              height, 30);
  }
  if (random.chance(0.5)) {
    const int side = std::min(canvas.cols, canvas.rows) / 3;
    cv::Mat figure = canvas(cv::Rect(canvas.cols / 2 - side / 2, canvas.rows / 2, side, side));
    figure.setTo(150);
    cover_with_shapes(random, area, figure, 0.003, 0.03, 120, 100, 1.5);
  }
  cv::Mat levels = to_levels(canvas);
  add_scaled(levels, fractal(random, area, 0.3, 0.6), 2.0);
  return levels;
}

cv::Mat books(Random& random, const Area& area) {
  const double ppm = area.pixels_per_metre;
  cv::Mat canvas = blank(area, 25);
  const int shelves = std::max(1, static_cast<int>(area.height / 0.34));
  const double pitch = static_cast<double>(canvas.rows) / shelves, board = 0.025 * ppm;
  for (int shelf = 0; shelf < shelves; ++shelf) {
    const double floor = (shelf + 1) * pitch - board;
    fill_rectangle(canvas, 0, floor, canvas.cols, board, 150);
    for (double x = 0.01 * ppm; x < canvas.cols;) {
      const double width = random.uniform(0.015, 0.055) * ppm;
      const double height = std::min(random.uniform(0.18, 0.30) * ppm, pitch - 1.5 * board);
      const double tone = random.uniform(30, 225), ink = tone > 120 ? 25 : 225;
      if (random.chance(0.08)) {  // a gap
        x += width;
        continue;
      }
      fill_rectangle(canvas, x, floor - height, width - 1, height, tone);
      fill_rectangle(canvas, x, floor - height * random.uniform(0.8, 0.95), width - 1, 0.006 * ppm,
                     ink);
      const double glyph = 0.45 * width;  // the title runs down the back
      for (double y = floor - height * 0.75; y + glyph < floor - 0.2 * height; y += 1.3 * glyph) {
        if (random.chance(0.75)) {
          text_line(random, canvas, x + 0.25 * width, y, 0.61 * glyph, glyph, ink);
        }
      }
      x += width;
    }
  }
  cv::Mat levels = to_levels(canvas);
  add_grain(random, area, levels, 3);
  return levels;
}

cv::Mat boards(Random& random, const Area& area, double level) {
  const double ppm = area.pixels_per_metre;
  cv::Mat canvas = blank(area, level);
  const double width = 0.14 * ppm;
  for (double y = 0; y < canvas.rows; y += width) {
    for (double x = -random.uniform(0, 1.0) * ppm; x < canvas.cols;) {
      const double length = random.uniform(0.5, 1.4) * ppm;
      fill_rectangle(canvas, x, y, length, width, level + random.uniform(-18, 18));
      stroke(canvas, x, y, x, y + width, 0.004 * ppm, 0.45 * level);
      const int knots = random.integer(3);
      for (int k = 0; k < knots; ++k) {
        random_shape(random, canvas, x + random.uniform(0, length),
                     y + random.uniform(0.2, 0.8) * width, random.uniform(0.006, 0.02) * ppm,
                     0.6 * level);
      }
      x += length;
    }
    stroke(canvas, 0, y, canvas.cols, y, 0.004 * ppm, 0.45 * level);
  }
  cv::Mat levels = to_levels(canvas);
  // The grain runs along the boards: noise that is stretched eight times in x.
  Area narrow = area;
  narrow.width = area.width / 8;
  cv::Mat grain;
  cv::resize(fractal(random, narrow, 0.1, 0.9), grain, levels.size(), 0, 0, cv::INTER_CUBIC);
  add_scaled(levels, grain, 7.0);
  return levels;
}

cv::Mat carpet(Random& random, const Area& area, double level, double contrast) {
  cv::Mat levels(area.rows(), area.columns(), CV_32F, cv::Scalar(level));
  add_scaled(levels, fractal(random, area, 0.4, 0.85), contrast);
  return levels;
}

cv::Mat keyboard(Random& random, const Area& area) {
  cv::Mat canvas = blank(area, 60);
  const double pitch = 0.019 * area.pixels_per_metre;
  for (double y = 0.5 * pitch; y + pitch < canvas.rows; y += pitch) {
    for (double x = 0.5 * pitch; x + pitch < canvas.cols; x += pitch) {
      fill_rectangle(canvas, x, y, 0.85 * pitch, 0.85 * pitch, random.uniform(170, 200));
      text_line(random, canvas, x + 0.25 * pitch, y + 0.2 * pitch, 0.3 * pitch, 0.4 * pitch, 40);
    }
  }
  return to_levels(canvas);
}

cv::Mat screen(Random& random, const Area& area) {
  const double ppm = area.pixels_per_metre;
  cv::Mat canvas = blank(area, 18);
  const double frame = 0.015 * ppm;
  fill_rectangle(canvas, frame, frame, canvas.cols - 2 * frame, canvas.rows - 2 * frame, 42);
  for (int window = 0; window < 2; ++window) {
    const double w = random.uniform(0.3, 0.5) * canvas.cols,
                 h = random.uniform(0.4, 0.7) * canvas.rows;
    const double x = random.uniform(frame, canvas.cols - w - frame);
    const double y = random.uniform(frame, canvas.rows - h - frame);
    const double tone = random.chance(0.5) ? 215 : 65;
    fill_rectangle(canvas, x, y, w, h, tone);
    const double height = 0.008 * ppm;
    for (double line = y + height; line + 2 * height < y + h; line += 2 * height) {
      text_line(random, canvas, x + height, line, (w - 2 * height) * random.uniform(0.2, 1.0),
                height, tone > 100 ? 30 : 190);
    }
  }
  return to_levels(canvas);
}

cv::Mat bricks(Random& random, const Area& area) {
  const double ppm = area.pixels_per_metre;
  const double width = 0.25 * ppm, height = 0.0833 * ppm, mortar = 0.012 * ppm;
  cv::Mat canvas = blank(area, 175);
  int course = 0;
  for (double y = 0; y < canvas.rows; y += height, ++course) {
    for (double x = course % 2 == 0 ? 0 : -width / 2; x < canvas.cols; x += width) {
      fill_rectangle(canvas, x, y, width - mortar, height - mortar, 105 + random.uniform(-6, 6));
    }
  }
  cv::Mat levels = to_levels(canvas);
  add_scaled(levels, fractal(random, area, 0.1, 0.8), 3.0);
  return levels;
}

cv::Mat faint(Random& random, const Area& area, double level, double contrast) {
  const double ppm = area.pixels_per_metre;
  cv::Mat canvas = blank(area, level);
  const int marks = static_cast<int>(area.width * area.height * 60);
  for (int i = 0; i < marks; ++i) {
    const double x = random.uniform(0, canvas.cols), y = random.uniform(0, canvas.rows);
    const double tone = level + (random.chance(0.5) ? 1 : -1) * random.uniform(0.6, 1.0) * contrast;
    if (random.chance(0.25)) {
      const double length = ppm * random.uniform(0.03, 0.2), turn = random.uniform(0, 6.28);
      stroke(canvas, x, y, x + length * std::cos(turn), y + length * std::sin(turn), 0.006 * ppm,
             tone);
    } else {
      random_shape(random, canvas, x, y, power_law_radius(random, 0.008 * ppm, 0.06 * ppm), tone);
    }
  }
  cv::Mat levels = to_levels(canvas);
  add_scaled(levels, fractal(random, area, 4.0, 0.4), 0.5 * contrast);
  return levels;
}

}  // namespace cairn::synthetic::paint
