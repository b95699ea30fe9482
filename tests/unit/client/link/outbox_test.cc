#include "client/link/outbox.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>

namespace cairn {
namespace {

class OutboxTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() /
              ("cairn-outbox-" + std::to_string(getpid()) + "-" +
               ::testing::UnitTest::GetInstance()->current_test_info()->name());
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::unique_ptr<Outbox> open(const std::string& client = "alice") {
    auto outbox = Outbox::open(path(), client);
    EXPECT_TRUE(outbox) << (outbox ? "" : outbox.message());
    return outbox ? std::move(*outbox) : nullptr;
  }
  ErrorCode refusal(const std::string& client = "alice") {
    const auto outbox = Outbox::open(path(), client);
    EXPECT_FALSE(outbox);
    if (outbox) return ErrorCode::kInternal;
    EXPECT_NE(outbox.message().find(path().string()), std::string::npos) << outbox.message();
    return outbox.error().code;
  }
  std::filesystem::path path() const { return folder_ / "outbox.db"; }

  std::filesystem::path folder_;
};

wire::Blob blob(std::uint8_t value) {
  return wire::Blob(1000, value);
}

constexpr std::uint64_t kEpoch = 0xffffffffffffff00;  // does not fit SQLite's signed integers

TEST_F(OutboxTest, KeepsKeyframesFromOneRunToTheNextInOrder) {
  {
    auto outbox = open();
    for (std::uint32_t i = 0; i < 3; ++i)
      ASSERT_TRUE(outbox->put({kEpoch, i}, blob(static_cast<std::uint8_t>(i))));
  }
  auto outbox = open();
  ASSERT_TRUE(outbox->put({5, 0}, blob(9)));  // a later run with a smaller epoch
  const std::deque<KeyframeId> expected = {{kEpoch, 0}, {kEpoch, 1}, {kEpoch, 2}, {5, 0}};
  EXPECT_EQ(outbox->waiting(), expected);
  EXPECT_EQ(*outbox->get({kEpoch, 2}), blob(2));
  EXPECT_EQ(*outbox->get({5, 0}), blob(9));
}

TEST_F(OutboxTest, ForgetsWhatIsDelivered) {
  {
    auto outbox = open();
    for (std::uint32_t i = 0; i < 4; ++i) ASSERT_TRUE(outbox->put({kEpoch, i}, blob(1)));
    ASSERT_TRUE(outbox->put({7, 0}, blob(1)));
    ASSERT_TRUE(outbox->remove_before(kEpoch, 3));
    EXPECT_EQ(outbox->waiting(), (std::deque<KeyframeId>{{kEpoch, 3}, {7, 0}}));
    EXPECT_FALSE(outbox->get({kEpoch, 2}));
  }
  EXPECT_EQ(open()->waiting(), (std::deque<KeyframeId>{{kEpoch, 3}, {7, 0}}));
}

TEST_F(OutboxTest, SurvivesTheProcessBeingKilled) {
  const pid_t child = fork();
  if (child == 0) {
    auto outbox = Outbox::open(path(), "alice");
    if (!outbox || !(*outbox)->put({1, 0}, blob(3))) _exit(1);
    _exit(0);  // no destructor runs, as with kill -9
  }
  int status = 0;
  waitpid(child, &status, 0);
  ASSERT_EQ(status, 0);
  auto outbox = open();
  ASSERT_EQ(outbox->waiting().size(), 1u);
  EXPECT_EQ(*outbox->get({1, 0}), blob(3));
}

TEST_F(OutboxTest, RefusesGapsInTheSequence) {
  auto outbox = open();
  ASSERT_TRUE(outbox->put({1, 0}, blob(1)));
  EXPECT_FALSE(outbox->put({1, 2}, blob(1)));
  EXPECT_FALSE(outbox->put({1, 0}, blob(1)));
  EXPECT_EQ(outbox->waiting().size(), 1u);
}

TEST_F(OutboxTest, BelongsToOneClientAndOneProcess) {
  {
    auto outbox = open();
    EXPECT_EQ(refusal(), ErrorCode::kUnavailable);
  }
  EXPECT_EQ(refusal("bob"), ErrorCode::kInvalidArgument);
}

TEST_F(OutboxTest, ForeignAndDamagedFilesAreLeftAlone) {
  const std::string text = "This is a letter and no database, whatever its name may say.\n";
  std::ofstream(path()) << text;
  EXPECT_EQ(refusal(), ErrorCode::kCorrupt);
  std::ifstream in(path());
  EXPECT_EQ(std::string(std::istreambuf_iterator<char>(in), {}), text);
}

TEST_F(OutboxTest, TruncatedFileIsAnErrorAndNoCrash) {
  {
    auto outbox = open();
    for (std::uint32_t i = 0; i < 50; ++i) ASSERT_TRUE(outbox->put({1, i}, blob(1)));
  }
  std::filesystem::resize_file(path(), std::filesystem::file_size(path()) / 2);
  const auto outbox = Outbox::open(path(), "alice");
  if (outbox) {
    EXPECT_FALSE((*outbox)->get({1, 49}));
  } else {
    EXPECT_EQ(outbox.error().code, ErrorCode::kCorrupt);
  }
}

TEST_F(OutboxTest, FolderThatIsNotThereIsTold) {
  const auto outbox = Outbox::open(folder_ / "missing" / "outbox.db", "alice");
  ASSERT_FALSE(outbox);
  EXPECT_EQ(outbox.error().code, ErrorCode::kUnavailable);
}

TEST_F(OutboxTest, RemovingLeavesNoFileBehind) {
  auto outbox = open();
  ASSERT_TRUE(outbox->put({1, 0}, blob(1)));
  outbox->remove_file();
  EXPECT_TRUE(std::filesystem::is_empty(folder_));
}

}  // namespace
}  // namespace cairn
