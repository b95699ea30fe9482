#include "server/place/vocabulary_training.h"

#include <algorithm>
#include <cmath>
#include <queue>

#include "server/place/k_majority.h"

namespace cairn {
namespace {

// A node while the tree grows. Leaves hold a stretch [begin, end) of the descriptors.
struct Node {
  Descriptor centre{};
  std::size_t begin = 0, end = 0;
  std::vector<std::size_t> children = {};

  std::size_t size() const { return end - begin; }
};

class Grower {
 public:
  Grower(std::vector<Descriptor> descriptors, const TrainingOptions& options)
      : options_(options), descriptors_(std::move(descriptors)), random_(options.seed) {
    nodes_.push_back({.begin = 0, .end = descriptors_.size()});
    offer(0);
  }

  // Splits the fullest leaf again and again.
  void grow() {
    std::size_t words = 1;
    while (!leaves_.empty() && words + options_.branching - 1 <= options_.words) {
      const std::size_t node = leaves_.top().node;
      leaves_.pop();
      const std::size_t made = split(node);
      if (made > 0) words += made - 1;
      if (options_.progress && made > 0) options_.progress(words);
    }
  }

  // Centres and children in the order that VocabularyTree wants.
  VocabularyTree breadth_first() const {
    VocabularyTree tree;
    tree.branch_level = options_.branch_level;
    std::vector<std::size_t> order{0};
    for (std::size_t i = 0; i < order.size(); ++i) {
      const Node& node = nodes_[order[i]];
      tree.centres.push_back(node.centre);
      tree.child_counts.push_back(static_cast<std::uint8_t>(node.children.size()));
      order.insert(order.end(), node.children.begin(), node.children.end());
    }
    const auto words = std::count(tree.child_counts.begin(), tree.child_counts.end(), 0);
    tree.weights.assign(static_cast<std::size_t>(words), 1.0f);
    return tree;
  }

 private:
  struct Leaf {
    std::size_t size, node;
    bool operator<(const Leaf& other) const {  // the fullest on top; of equals the oldest
      return size != other.size ? size < other.size : node > other.node;
    }
  };

  void offer(std::size_t node) {
    if (nodes_[node].size() > options_.split_above) leaves_.push({nodes_[node].size(), node});
  }

  // Number of children; 0 where all descriptors are the same.
  std::size_t split(std::size_t node) {
    const std::size_t begin = nodes_[node].begin, size = nodes_[node].size();
    const std::span<Descriptor> held(descriptors_.data() + begin, size);
    const Clusters clusters = k_majority(held, options_.branching, options_.iterations, random_);
    const std::size_t k = clusters.centres.size();
    if (k < 2) return 0;
    std::vector<std::vector<Descriptor>> members(k);
    for (std::size_t i = 0; i < size; ++i) members[clusters.cluster_of[i]].push_back(held[i]);
    std::size_t at = begin;
    for (std::size_t c = 0; c < k; ++c) {
      std::copy(members[c].begin(), members[c].end(), descriptors_.data() + at);
      const std::size_t child = nodes_.size();
      nodes_.push_back({.centre = clusters.centres[c], .begin = at, .end = at + members[c].size()});
      nodes_[node].children.push_back(child);
      at += members[c].size();
      offer(child);
    }
    return k;
  }

  const TrainingOptions& options_;
  std::vector<Descriptor> descriptors_;
  std::mt19937_64 random_;
  std::vector<Node> nodes_;
  std::priority_queue<Leaf> leaves_;
};

// Inverse document frequency (Sivic and Zisserman 2003). A word that no image has, as the descent
// may find another one near it, weighs as if one image had it.
std::vector<float> inverse_frequencies(const Vocabulary& vocabulary,
                                       std::span<const std::vector<Descriptor>> images) {
  std::vector<std::size_t> with(vocabulary.size(), 0);
  for (const auto& image : images)
    for (const WordWeight& w : vocabulary.words(image).bag) ++with[w.word];
  std::vector<float> weights;
  for (const std::size_t n : with) {
    const double share =
        static_cast<double>(std::max<std::size_t>(n, 1)) / static_cast<double>(images.size());
    weights.push_back(static_cast<float>(-std::log(share)));
  }
  return weights;
}

Status check(const TrainingOptions& options) {
  const auto bad = [](const char* what) { return Status(ErrorCode::kInvalidArgument, what); };
  if (options.branching < 2 || options.branching > 255) return bad("branching: must be 2 to 255");
  if (options.words < options.branching) return bad("words: must be no less than branching");
  if (options.iterations < 0) return bad("iterations: must be 0 or more");
  return {};
}

}  // namespace

Result<Vocabulary> train_vocabulary(std::span<const std::vector<Descriptor>> images,
                                    const TrainingOptions& options) {
  if (const Status status = check(options); !status) return status.error();
  std::vector<Descriptor> all;
  for (const auto& image : images) all.insert(all.end(), image.begin(), image.end());
  Grower grower(std::move(all), options);
  grower.grow();
  VocabularyTree tree = grower.breadth_first();
  if (tree.centres.size() < 3)
    return {ErrorCode::kInvalidArgument,
            "too few different descriptors to make words of; give more images"};
  auto unweighted = Vocabulary::make(tree);
  if (!unweighted) return unweighted.error();
  tree.weights = inverse_frequencies(*unweighted, images);
  return Vocabulary::make(std::move(tree));
}

}  // namespace cairn
