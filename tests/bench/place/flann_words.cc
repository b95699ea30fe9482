#include "tests/bench/place/flann_words.h"

#include <flann/flann.hpp>

namespace cairn::bench {
namespace {

using Matrix = flann::Matrix<unsigned char>;

// FLANN takes queries by a pointer to what it does not change.
Matrix matrix_of(std::span<const Descriptor> descriptors) {
  auto* bytes = reinterpret_cast<unsigned char*>(const_cast<Descriptor*>(descriptors.data()));
  return {bytes, descriptors.size(), sizeof(Descriptor)};
}

}  // namespace

struct FlannWords::Index {
  Index(std::span<const Descriptor> words, const FlannOptions& options)
      : kept(words.begin(), words.end()),
        index(matrix_of(kept), flann::HierarchicalClusteringIndexParams(
                                   options.branching, flann::FLANN_CENTERS_RANDOM, options.trees,
                                   options.leaf_size)),
        search(options.checks) {
    flann::seed_random(1);
    index.buildIndex();
    search.cores = 1;
  }

  std::vector<Descriptor> kept;
  mutable flann::HierarchicalClusteringIndex<flann::HammingPopcnt<unsigned char>> index;
  flann::SearchParams search;
};

FlannWords::FlannWords(std::span<const Descriptor> words, const FlannOptions& options)
    : index_(std::make_unique<Index>(words, options)) {}
FlannWords::~FlannWords() = default;
FlannWords::FlannWords(FlannWords&&) noexcept = default;

std::vector<std::uint32_t> FlannWords::nearest(std::span<const Descriptor> descriptors) const {
  std::vector<std::size_t> indices(descriptors.size());
  std::vector<int> distances(descriptors.size());
  flann::Matrix<std::size_t> found(indices.data(), descriptors.size(), 1);
  flann::Matrix<int> far(distances.data(), descriptors.size(), 1);
  index_->index.knnSearch(matrix_of(descriptors), found, far, 1, index_->search);
  return {indices.begin(), indices.end()};
}

}  // namespace cairn::bench
