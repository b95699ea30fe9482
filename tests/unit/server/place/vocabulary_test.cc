#include "server/place/vocabulary.h"

#include <cmath>
#include <filesystem>
#include <fstream>
#include <numeric>
#include <set>

#include <gtest/gtest.h>

#include "common/feature/hamming.h"
#include "server/place/vocabulary_training.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/server/place/descriptors.h"

namespace cairn {
namespace {

constexpr std::uint64_t kAll = ~std::uint64_t{0};
const Descriptor kZeros{};
const Descriptor kOnes{kAll, kAll, kAll, kAll};
const Descriptor kLow{kAll, kAll, 0, 0};

// Root with a word (all zeros) and an inner node (all ones) that has two words (all ones, and the
// lower half).
VocabularyTree small_tree() {
  return {.centres = {kZeros, kZeros, kOnes, kOnes, kLow},
          .child_counts = {2, 0, 2, 0, 0},
          .weights = {1.0f, 3.0f, 0.0f},
          .branch_level = 1};
}

// Trained once for all tests.
struct Trained {
  std::vector<Descriptor> things;
  std::vector<std::vector<Descriptor>> images;
  Result<Vocabulary> vocabulary{ErrorCode::kInternal, "not trained"};
};
const Trained& trained() {
  static const Trained t = [] {
    Trained made;
    std::mt19937_64 random(1);
    for (int i = 0; i < 200; ++i) made.things.push_back(random_descriptor(random));
    made.images = images_of(made.things, 60, 100, 12, random);
    made.vocabulary = train_vocabulary(made.images, {.words = 240, .branching = 6});
    return made;
  }();
  return t;
}

TEST(Vocabulary, WordsAreTheLeavesInOrder) {
  const auto vocabulary = Vocabulary::make(small_tree());
  ASSERT_TRUE(vocabulary.ok()) << vocabulary.message();
  EXPECT_EQ(vocabulary->size(), 3u);
  EXPECT_EQ(vocabulary->depth(), 2u);
  EXPECT_EQ(vocabulary->word_of({1, 0, 0, 0}), 0u);
  EXPECT_EQ(vocabulary->word_of({kAll, kAll, kAll, 7}), 1u);
  EXPECT_EQ(vocabulary->word_of({kAll, kAll, 7, 0}), 2u);
}

TEST(Vocabulary, BranchesHoldTheWordsBelowThem) {
  const auto vocabulary = Vocabulary::make(small_tree());
  ASSERT_TRUE(vocabulary.ok());
  EXPECT_EQ(vocabulary->branches(), 2u);
  EXPECT_EQ(vocabulary->branch_of(0), 0);
  EXPECT_EQ(vocabulary->branch_of(1), 1);
  EXPECT_EQ(vocabulary->branch_of(2), 1);
}

TEST(Vocabulary, WeighsWordsByFrequencyHereAndRarityElsewhere) {
  const auto vocabulary = Vocabulary::make(small_tree());
  ASSERT_TRUE(vocabulary.ok());
  const std::vector<Descriptor> image{kOnes, kZeros, kLow, kZeros, kZeros};
  const Words words = vocabulary->words(image);
  EXPECT_EQ(words.word_of_feature, (std::vector<std::uint32_t>{1, 0, 2, 0, 0}));
  EXPECT_EQ(words.branch_of_feature, (std::vector<std::uint16_t>{1, 0, 1, 0, 0}));
  // 3 times 1, once 3, once 0: the last says nothing and is left out.
  EXPECT_EQ(words.bag, (BagOfWords{{0, 0.5f}, {1, 0.5f}}));
}

TEST(Vocabulary, OfNoFeaturesGivesNoWords) {
  const auto vocabulary = Vocabulary::make(small_tree());
  ASSERT_TRUE(vocabulary.ok());
  EXPECT_TRUE(vocabulary->words({}).bag.empty());
}

TEST(Vocabulary, ADescentWithABeamFindsWhatThePlainOneMisses) {
  // Nearer to the first branch, but the nearest word hangs below the second.
  const Descriptor wanted{kAll, kAll >> 10, 0, 0};
  VocabularyTree tree = small_tree();
  tree.centres[1] = kZeros;
  const auto vocabulary = Vocabulary::make(tree);
  ASSERT_TRUE(vocabulary.ok());
  ASSERT_LT(hamming_distance(wanted, kZeros), hamming_distance(wanted, kOnes));
  EXPECT_EQ(vocabulary->word_of(wanted, 1), 0u);
  EXPECT_EQ(vocabulary->word_of(wanted, 2), 2u);
}

TEST(Vocabulary, RefusesTreesThatContradictThemselves) {
  const auto refused = [](auto&& change) {
    VocabularyTree tree = small_tree();
    change(tree);
    return Vocabulary::make(tree).ok() == false;
  };
  EXPECT_TRUE(refused([](VocabularyTree& t) { t = {}; }));
  EXPECT_TRUE(refused([](VocabularyTree& t) { t.child_counts[0] = 1; }));  // an orphan
  EXPECT_TRUE(refused([](VocabularyTree& t) { t.child_counts[4] = 1; }));  // a child that is not
  EXPECT_TRUE(refused([](VocabularyTree& t) { t.child_counts = {0, 0, 0, 0, 4}; }));
  EXPECT_TRUE(refused([](VocabularyTree& t) { t.child_counts.pop_back(); }));
  EXPECT_TRUE(refused([](VocabularyTree& t) { t.weights.pop_back(); }));
  EXPECT_TRUE(refused([](VocabularyTree& t) { t.weights[0] = -1; }));
  EXPECT_TRUE(refused([](VocabularyTree& t) { t.weights[0] = std::nanf(""); }));
}

TEST(Training, GivesEachThingAWordOfItsOwn) {
  const Trained& t = trained();
  ASSERT_TRUE(t.vocabulary.ok()) << t.vocabulary.message();
  EXPECT_LE(t.vocabulary->size(), 240u);
  std::set<std::uint32_t> words;
  for (const Descriptor& thing : t.things) words.insert(t.vocabulary->word_of(thing));
  EXPECT_GE(words.size(), 190u);  // of 200
}

TEST(Training, FindsMostlyTheSameWordForOtherViews) {
  const Trained& t = trained();
  std::mt19937_64 random(2);
  int same = 0;
  for (const Descriptor& thing : t.things)
    same += t.vocabulary->word_of(with_flips(thing, 12, random)) == t.vocabulary->word_of(thing);
  EXPECT_GE(same, 170);  // of 200
}

TEST(Training, WeighsByTheShareOfImagesWithTheWord) {
  std::vector<std::vector<Descriptor>> images(4, {kZeros});
  images[0].push_back(kOnes);
  images[1].push_back(kLow);
  images[2].push_back(kLow);
  const auto vocabulary = train_vocabulary(images, {.words = 3, .branching = 3, .split_above = 1});
  ASSERT_TRUE(vocabulary.ok()) << vocabulary.message();
  ASSERT_EQ(vocabulary->size(), 3u);
  EXPECT_FLOAT_EQ(vocabulary->weight(vocabulary->word_of(kZeros)), 0.0f);
  EXPECT_FLOAT_EQ(vocabulary->weight(vocabulary->word_of(kOnes)), std::log(4.0f));
  EXPECT_FLOAT_EQ(vocabulary->weight(vocabulary->word_of(kLow)), std::log(2.0f));
}

TEST(Training, RepeatsExactly) {
  const Trained& t = trained();
  const auto again = train_vocabulary(t.images, {.words = 240, .branching = 6});
  ASSERT_TRUE(again.ok());
  EXPECT_EQ(again->checksum(), t.vocabulary->checksum());
  EXPECT_EQ(again->tree().centres, t.vocabulary->tree().centres);
}

TEST(Training, RefusesWhatCannotBeTrained) {
  const auto& images = trained().images;
  EXPECT_FALSE(train_vocabulary(images, {.branching = 1}).ok());
  EXPECT_FALSE(train_vocabulary(images, {.branching = 256}).ok());
  EXPECT_FALSE(train_vocabulary(images, {.words = 3, .branching = 16}).ok());
  EXPECT_FALSE(train_vocabulary({}, {}).ok());
  const std::vector<std::vector<Descriptor>> same(3, std::vector<Descriptor>(40, kOnes));
  EXPECT_FALSE(train_vocabulary(same, {}).ok());
}

class VocabularyFile : public testing::Test {
 protected:
  std::string save() {
    EXPECT_TRUE(trained().vocabulary->save(path_).ok());
    std::ifstream in(path_, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }
  Result<Vocabulary> load(const std::string& bytes) {
    std::ofstream(path_, std::ios::binary) << bytes;
    return Vocabulary::load(path_);
  }
  synthetic::TempFolder folder_;
  std::string path_ = (folder_ / "words.bin").string();
};

TEST_F(VocabularyFile, ComesBackAsItWas) {
  save();
  const auto loaded = Vocabulary::load(path_);
  ASSERT_TRUE(loaded.ok()) << loaded.message();
  const Vocabulary& saved = *trained().vocabulary;
  EXPECT_EQ(loaded->checksum(), saved.checksum());
  EXPECT_EQ(loaded->tree().weights, saved.tree().weights);
  const auto& image = trained().images[5];
  EXPECT_EQ(loaded->words(image).bag, saved.words(image).bag);
  EXPECT_EQ(loaded->words(image).branch_of_feature, saved.words(image).branch_of_feature);
}

TEST_F(VocabularyFile, IsRefusedWhereverAByteIsWrong) {
  const std::string good = save();
  for (std::size_t at = 0; at < good.size(); at += at < 64 ? 1 : 97) {
    std::string bad = good;
    bad[at] = static_cast<char>(bad[at] ^ 0x10);
    EXPECT_FALSE(load(bad).ok()) << "byte " << at;
  }
}

TEST_F(VocabularyFile, IsRefusedWhenTooShortOrTooLong) {
  const std::string good = save();
  for (const std::size_t size : {std::size_t{0}, std::size_t{5}, std::size_t{32}, good.size() - 1})
    EXPECT_EQ(load(good.substr(0, size)).error().code, ErrorCode::kCorrupt) << size;
  EXPECT_EQ(load(good + "x").error().code, ErrorCode::kCorrupt);
}

TEST_F(VocabularyFile, ErrorsNameTheFileAndTheRemedy) {
  std::string other = save();
  other[8] = 9;  // version
  const auto newer = load(other);
  ASSERT_FALSE(newer.ok());
  EXPECT_EQ(newer.error().code, ErrorCode::kVersion);
  EXPECT_NE(newer.message().find(path_), std::string::npos);
  const auto missing = Vocabulary::load(path_ + ".not");
  ASSERT_FALSE(missing.ok());
  EXPECT_EQ(missing.error().code, ErrorCode::kNotFound);
  EXPECT_FALSE(trained().vocabulary->save("/no/such/folder/words.bin").ok());
}

}  // namespace
}  // namespace cairn
