// Nearest of many binary descriptors by FLANN (Muja and Lowe 2012, "Fast matching of binary
// features"): a forest of random hierarchical clusterings. To compare the vocabulary's own look-up
// with.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "common/model/features.h"

namespace cairn::bench {

struct FlannOptions {
  int trees = 4;
  int branching = 32;
  int leaf_size = 100;
  int checks = 64;  // descriptors compared before the search gives up: more are slower and surer
};

class FlannWords {
 public:
  // Keeps a copy of the descriptors. Seeds FLANN's generator, which is the program's rand(), and
  // yet finds slightly different words in each run.
  FlannWords(std::span<const Descriptor> words, const FlannOptions& options);
  ~FlannWords();
  FlannWords(FlannWords&&) noexcept;

  // Index of the nearest, or of one nearly as near, for each descriptor.
  std::vector<std::uint32_t> nearest(std::span<const Descriptor> descriptors) const;

 private:
  struct Index;
  std::unique_ptr<Index> index_;
};

}  // namespace cairn::bench
