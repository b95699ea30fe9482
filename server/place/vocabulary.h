// The vocabulary of place recognition: a tree of ORB descriptors whose leaves are the words.
//
// Words are found by descending from the root, following the kBeam nearest nodes of each step and
// not the nearest alone: near the border between two branches the nearest word may lie in the other
// one. Trained by train_vocabulary() (vocabulary_training.h).
//
// Nister and Stewenius 2006, "Scalable recognition with a vocabulary tree"; Galvez-Lopez and Tardos
// 2012, "Bags of binary words for fast place recognition in image sequences" (binary words, the
// direct index).
//
// The file, little-endian:
//   8 bytes "CAIRNVOC", then u32 version, u32 nodes, u32 words, u32 branch level, u64 checksum
//   (FNV-1a over 64-bit words of what follows), then for each node breadth first: descriptors, 32
//   bytes each (the root's says nothing), numbers of children, u8 each, and for each word f32
//   weight
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/model/features.h"
#include "common/util/status.h"
#include "server/place/bag_of_words.h"

namespace cairn {

// Breadth first: node 0 is the root, children of a node follow each other, and come after those of
// every node before it.
struct VocabularyTree {
  std::vector<Descriptor> centres;         // one a node
  std::vector<std::uint8_t> child_counts;  // one a node; 0 for a word
  std::vector<float> weights;              // one a word, in the order of their nodes; >= 0
  // Nodes this many steps below the root, and words that end above, are the branches.
  std::uint32_t branch_level = 1;
};

// Immutable; used from any number of threads.
class Vocabulary {
 public:
  static constexpr std::uint32_t kVersion = 1;
  // Nodes followed at each step of the descent; tests/bench/RESULTS.md has the figures of others.
  static constexpr std::size_t kBeam = 4;
  static constexpr std::size_t kMaxBeam = 16;

  // Errors: kCorrupt when the tree contradicts itself (see VocabularyTree), or has no words.
  static Result<Vocabulary> make(VocabularyTree tree);
  // Errors: kNotFound, kVersion, kCorrupt; messages name the file.
  static Result<Vocabulary> load(const std::string& path);
  // The same from memory; `name` stands for the path in messages.
  static Result<Vocabulary> read(std::span<const char> file, const std::string& name);
  // The file is there whole or not at all.
  Status save(const std::string& path) const;

  Words words(std::span<const Descriptor> descriptors, std::size_t beam = kBeam) const;
  // With `beam` = 1 the plain descent, beyond kMaxBeam as with kMaxBeam.
  std::uint32_t word_of(const Descriptor& descriptor, std::size_t beam = kBeam) const;

  std::size_t size() const { return node_of_word_.size(); }
  std::size_t branches() const { return branches_; }
  std::size_t depth() const { return depth_; }  // most steps from the root to a word
  const VocabularyTree& tree() const { return tree_; }
  const Descriptor& centre(std::uint32_t word) const { return tree_.centres[node_of_word_[word]]; }
  float weight(std::uint32_t word) const { return tree_.weights[word]; }
  std::uint16_t branch_of(std::uint32_t word) const { return branch_of_word_[word]; }
  // What tells this vocabulary from others: bags of words of different ones don't compare.
  std::uint64_t checksum() const { return checksum_; }

 private:
  Vocabulary() = default;
  Status index();
  void name_branches();

  VocabularyTree tree_;
  std::vector<std::uint32_t> first_child_;     // one a node
  std::vector<std::uint32_t> word_of_node_;    // kNoWord for inner nodes
  std::vector<std::uint32_t> node_of_word_;    // ascending
  std::vector<std::uint16_t> branch_of_word_;  // below branches_
  std::size_t branches_ = 0, depth_ = 0;
  std::uint64_t checksum_ = 0;
};

}  // namespace cairn
