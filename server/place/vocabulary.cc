#include "server/place/vocabulary.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "common/feature/hamming.h"
#include "server/place/vocabulary_file.h"

namespace cairn {
namespace {

constexpr std::uint32_t kNoWord = std::numeric_limits<std::uint32_t>::max();

// The `width` nearest nodes so far, nearest first; of equals the one that came first.
class Beam {
 public:
  explicit Beam(std::size_t width) : width_(std::clamp<std::size_t>(width, 1, kMaxWidth)) {}
  void offer(int distance, std::uint32_t node) {
    if (size_ == width_ && distance >= entries_[size_ - 1].distance) return;
    std::size_t at = size_ < width_ ? size_++ : width_ - 1;
    for (; at > 0 && entries_[at - 1].distance > distance; --at) entries_[at] = entries_[at - 1];
    entries_[at] = {distance, node};
  }
  std::size_t size() const { return size_; }
  int distance(std::size_t i) const { return entries_[i].distance; }
  std::uint32_t node(std::size_t i) const { return entries_[i].node; }

 private:
  struct Entry {
    int distance;
    std::uint32_t node;
  };
  static constexpr std::size_t kMaxWidth = Vocabulary::kMaxBeam;
  std::size_t width_, size_ = 0;
  std::array<Entry, kMaxWidth> entries_;  // the first size_ are set
};

BagOfWords weigh(std::vector<std::uint32_t> words, std::span<const float> weights) {
  std::sort(words.begin(), words.end());
  BagOfWords bag;
  double sum = 0;
  for (std::size_t i = 0; i < words.size();) {
    std::size_t end = i;
    while (end < words.size() && words[end] == words[i]) ++end;
    const float weight = static_cast<float>(end - i) * weights[words[i]];
    if (weight > 0) bag.push_back({words[i], weight});
    sum += weight;
    i = end;
  }
  for (WordWeight& w : bag) w.weight = static_cast<float>(w.weight / sum);
  return bag;
}

}  // namespace

Result<Vocabulary> Vocabulary::make(VocabularyTree tree) {
  Vocabulary vocabulary;
  vocabulary.tree_ = std::move(tree);
  if (const Status status = vocabulary.index(); !status) return status.error();
  return vocabulary;
}

// Checks the tree and derives what look-up needs.
Status Vocabulary::index() {
  const auto corrupt = [](const char* what) { return Status(ErrorCode::kCorrupt, what); };
  const std::size_t nodes = tree_.centres.size();
  if (nodes < 2 || nodes >= kNoWord) return corrupt("it has no words");
  if (tree_.child_counts.size() != nodes) return corrupt("nodes and children differ in number");
  first_child_.resize(nodes);
  word_of_node_.assign(nodes, kNoWord);
  std::vector<std::uint32_t> level(nodes, 0);
  std::size_t next = 1;  // node that no one has claimed as a child
  for (std::size_t node = 0; node < nodes; ++node) {
    if (next <= node) return corrupt("a node hangs on nothing");
    const std::size_t end = next + tree_.child_counts[node];
    if (end > nodes) return corrupt("it has fewer nodes than it says");
    first_child_[node] = static_cast<std::uint32_t>(next);
    for (; next < end; ++next) level[next] = level[node] + 1;
    if (tree_.child_counts[node] > 0) continue;
    word_of_node_[node] = static_cast<std::uint32_t>(node_of_word_.size());
    node_of_word_.push_back(static_cast<std::uint32_t>(node));
  }
  depth_ = *std::max_element(level.begin(), level.end());
  if (tree_.weights.size() != size()) return corrupt("words and weights differ in number");
  for (const float weight : tree_.weights)
    if (!std::isfinite(weight) || weight < 0) return corrupt("a weight is no weight");
  name_branches();
  if (branches_ > std::numeric_limits<std::uint16_t>::max()) return corrupt("too many branches");
  checksum_ = checksum_of(tree_);
  return {};
}

void Vocabulary::name_branches() {
  std::vector<std::uint32_t> branch(tree_.centres.size(), 0), level(tree_.centres.size(), 0);
  for (std::size_t node = 0; node < branch.size(); ++node) {
    const bool starts_here = level[node] == tree_.branch_level ||
                             (level[node] < tree_.branch_level && tree_.child_counts[node] == 0);
    if (starts_here) branch[node] = static_cast<std::uint32_t>(branches_++);
    for (std::uint32_t i = 0; i < tree_.child_counts[node]; ++i) {
      branch[first_child_[node] + i] = branch[node];
      level[first_child_[node] + i] = level[node] + 1;
    }
  }
  for (const std::uint32_t node : node_of_word_)
    branch_of_word_.push_back(static_cast<std::uint16_t>(branch[node]));
}

std::uint32_t Vocabulary::word_of(const Descriptor& descriptor, std::size_t width) const {
  Beam beam(width);
  beam.offer(0, 0);
  for (bool descends = true; descends;) {
    descends = false;
    Beam below(width);
    for (std::size_t i = 0; i < beam.size(); ++i) {
      const std::uint32_t node = beam.node(i);
      if (word_of_node_[node] != kNoWord) {  // stays in the running
        below.offer(beam.distance(i), node);
        continue;
      }
      descends = true;
      const std::uint32_t end = first_child_[node] + tree_.child_counts[node];
      for (std::uint32_t child = first_child_[node]; child < end; ++child)
        below.offer(hamming_distance(descriptor, tree_.centres[child]), child);
    }
    beam = below;
  }
  return word_of_node_[beam.node(0)];
}

Words Vocabulary::words(std::span<const Descriptor> descriptors, std::size_t beam) const {
  Words words;
  words.word_of_feature.reserve(descriptors.size());
  words.branch_of_feature.reserve(descriptors.size());
  for (const Descriptor& descriptor : descriptors) {
    const std::uint32_t word = word_of(descriptor, beam);
    words.word_of_feature.push_back(word);
    words.branch_of_feature.push_back(branch_of_word_[word]);
  }
  words.bag = weigh(words.word_of_feature, tree_.weights);
  return words;
}

}  // namespace cairn
