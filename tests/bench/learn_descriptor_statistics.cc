// Learns what is known of a descriptor's bits, from the descriptors of photographs, and prints
// common/wire/descriptor_statistics.cc.
//
//   cairn_learn_descriptor_statistics DIR_WITH_PHOTOS > common/wire/descriptor_statistics.cc
//
// Each bit is packed knowing the two earlier ones that leave least to say about it. Next comes
// always the bit about which one of those before leaves least to say: that is its first (Prim's
// algorithm, as for the dependence trees of Chow and Liu 1968, "Approximating discrete probability
// distributions with dependence trees"). The second is the one that adds most.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <numeric>
#include <vector>

#include <opencv2/imgcodecs.hpp>

#include "client/frontend/extractor.h"

namespace cairn {
namespace {

constexpr std::size_t kBits = 256;

// Bits as columns: for each of a descriptor's the values over all descriptors, 64 to a word.
struct Columns {
  std::array<std::vector<std::uint64_t>, kBits> words;
  std::size_t count = 0;

  void add(const Descriptor& d) {
    for (std::size_t i = 0; i < kBits; ++i) {
      if (count % 64 == 0) words[i].push_back(0);
      words[i].back() |= (d[i / 64] >> (i % 64) & 1) << (count % 64);
    }
    ++count;
  }
};

double information(double part, double whole) {
  return part > 0 ? -part * std::log2(part / whole) : 0;
}

// How often the two bits `a` and `b` are 00, 01, 10, 11, and how often `c` is set then.
struct Counts {
  std::array<double, 4> known{}, set{};
};

Counts count(const Columns& columns, std::size_t a, std::size_t b, std::size_t c) {
  Counts counts;
  const auto &x = columns.words[a], &y = columns.words[b], &z = columns.words[c];
  for (std::size_t i = 0; i < x.size(); ++i) {
    const std::size_t in_word = std::min<std::size_t>(64, columns.count - 64 * i);
    const std::uint64_t all = in_word == 64 ? ~0ull : (1ull << in_word) - 1;
    const std::array<std::uint64_t, 4> cases{~x[i] & ~y[i] & all, ~x[i] & y[i], x[i] & ~y[i],
                                             x[i] & y[i]};
    for (std::size_t k = 0; k < 4; ++k) {
      counts.known[k] += std::popcount(cases[k]);
      counts.set[k] += std::popcount(cases[k] & z[i]);
    }
  }
  return counts;
}

// Bits (in all) that are left to say about `c` when `a` and `b` are known.
double left_to_say(const Columns& columns, std::size_t a, std::size_t b, std::size_t c) {
  const Counts counts = count(columns, a, b, c);
  double bits = 0;
  for (std::size_t k = 0; k < 4; ++k)
    bits += information(counts.set[k], counts.known[k]) +
            information(counts.known[k] - counts.set[k], counts.known[k]);
  return bits;
}

Columns describe_photos(const char* folder) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  Extractor extractor({.features = 1000, .entropy = {.mode = EntropyMode::kOff}});
  Columns columns;
  for (const auto& file : files) {
    const cv::Mat image = cv::imread(file.string(), cv::IMREAD_GRAYSCALE);
    if (image.empty()) continue;
    Features features;
    extractor.extract(image, features);
    // Every fourth: those of one photograph are alike.
    for (std::size_t i = 0; i < features.size(); i += 4) columns.add(features.descriptors[i]);
  }
  return columns;
}

struct Entry {
  std::size_t bit = 0, first = 0, second = 0;
};

std::vector<Entry> learn(const Columns& columns) {
  std::vector<Entry> order{{0, 0, 0}};
  std::vector<std::size_t> rest(kBits - 1);
  std::iota(rest.begin(), rest.end(), 1);
  std::array<double, kBits> left_over{};
  std::array<std::size_t, kBits> first{};
  const auto consider = [&](std::size_t known) {
    for (const std::size_t c : rest) {
      const double left = left_to_say(columns, known, known, c);
      if (left_over[c] == 0 || left < left_over[c]) {
        left_over[c] = left;
        first[c] = known;
      }
    }
  };
  consider(0);
  while (!rest.empty()) {
    const auto best = std::min_element(rest.begin(), rest.end(),
                                       [&](auto a, auto b) { return left_over[a] < left_over[b]; });
    Entry entry{*best, first[*best], first[*best]};
    rest.erase(best);
    double least = left_over[entry.bit];
    for (const Entry& earlier : order) {
      const double left = left_to_say(columns, entry.first, earlier.bit, entry.bit);
      if (left < least) {
        least = left;
        entry.second = earlier.bit;
      }
    }
    order.push_back(entry);
    consider(entry.bit);
  }
  return order;
}

// In 4096ths, and never so sure that the other is impossible.
int chance(double set, double known) {
  return std::clamp(static_cast<int>(std::lround(4096 * (set + 0.5) / (known + 1))), 16, 4096 - 16);
}

void print(const Columns& columns, const std::vector<Entry>& order) {
  std::puts(
      "// Made by tests/bench/learn_descriptor_statistics.cc; see there.\n"
      "#include \"common/wire/descriptor_statistics.h\"\n\n"
      "namespace cairn::wire {\n\n"
      "// clang-format off\n"
      "const std::array<DescriptorBit, 256> kDescriptorBits{{");
  double bits = 0;
  for (std::size_t i = 0; i < order.size(); ++i) {
    const Entry& e = order[i];
    Counts c = count(columns, e.first, e.second, e.bit);
    if (i == 0) {  // nothing is known yet
      c.known.fill(static_cast<double>(columns.count));
      c.set.fill(c.set[0] + c.set[1] + c.set[2] + c.set[3]);
    }
    bits += left_to_say(columns, e.first, e.second, e.bit);
    std::printf("%s{%zu, %zu, %zu, {%d, %d, %d, %d}},%s", i % 3 == 0 ? "    " : " ", e.bit, e.first,
                e.second, chance(c.set[0], c.known[0]), chance(c.set[1], c.known[1]),
                chance(c.set[2], c.known[2]), chance(c.set[3], c.known[3]),
                i % 3 == 2 || i + 1 == order.size() ? "\n" : "");
  }
  std::puts("}};\n// clang-format on\n\n}  // namespace cairn::wire");
  std::fprintf(stderr, "%zu descriptors, %.1f bits each\n", columns.count,
               bits / static_cast<double>(columns.count));
}

}  // namespace
}  // namespace cairn

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: %s DIR_WITH_PHOTOS\n", argv[0]);
    return 2;
  }
  const cairn::Columns columns = cairn::describe_photos(argv[1]);
  if (columns.count == 0) {
    std::fprintf(stderr, "%s: no photographs in it\n", argv[1]);
    return 1;
  }
  cairn::print(columns, cairn::learn(columns));
}
