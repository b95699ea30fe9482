// The vocabulary that comes with the program.
#include <chrono>
#include <filesystem>

#include <gtest/gtest.h>

#include "server/place/vocabulary.h"

namespace cairn {
namespace {

const std::string kPath = CAIRN_SOURCE_DIR "/config/vocabulary.bin";

TEST(DefaultVocabulary, IsThereSmallAndLarge) {
  const auto vocabulary = Vocabulary::load(kPath);
  ASSERT_TRUE(vocabulary.ok()) << vocabulary.message();
  EXPECT_GE(vocabulary->size(), 10'000u);
  EXPECT_LE(std::filesystem::file_size(kPath), 2'200'000u);
  EXPECT_GE(vocabulary->branches(), 16u);
}

TEST(DefaultVocabulary, LoadsFast) {
#if defined(__SANITIZE_THREAD__) || defined(__SANITIZE_ADDRESS__)
  GTEST_SKIP() << "times say nothing under sanitizers";
#endif
  double best_ms = 1e9;
  for (int i = 0; i < 5; ++i) {
    const auto start = std::chrono::steady_clock::now();
    ASSERT_TRUE(Vocabulary::load(kPath).ok());
    const std::chrono::duration<double, std::milli> took = std::chrono::steady_clock::now() - start;
    best_ms = std::min(best_ms, took.count());
  }
  EXPECT_LT(best_ms, 100);
}

}  // namespace
}  // namespace cairn
