#include "server/tool/vocab_command.h"

#include <gmock/gmock.h>
#include <opencv2/imgcodecs.hpp>

#include <fstream>

#include "server/place/vocabulary.h"
#include "tests/support/temp_folder.h"
#include "tests/unit/server/tool/run_tool.h"

namespace cairn {
namespace {

using synthetic::TempFolder;
using testing::HasSubstr;

class VocabCommand : public testing::Test {
 protected:
  Outcome vocab(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "vocab");
    return run_tool({add_vocab_command}, arguments);
  }
  // Blocks of random grey, each image its own.
  void draw_images(int count) {
    std::filesystem::create_directories(folder_ / "images");
    cv::RNG random(5);
    for (int i = 0; i < count; ++i) {
      cv::Mat image(240, 320, CV_8UC1, cv::Scalar(128));
      for (int block = 0; block < 200; ++block) {
        const cv::Rect area(random.uniform(0, 300), random.uniform(0, 220), 20, 20);
        image(area).setTo(cv::Scalar(random.uniform(0, 255)));
      }
      cv::imwrite(folder_ / "images" / (std::to_string(i) + ".png"), image);
    }
  }

  TempFolder folder_;
  std::string file_ = folder_ / "words.bin";
};

TEST_F(VocabCommand, TrainsOnAFolderOfImagesAndTellsWhatItMade) {
  draw_images(6);
  const Outcome trained =
      vocab({"train", "--images", folder_ / "images", "--words", "60", "--out", file_});
  ASSERT_EQ(trained.code, kExitOk) << trained.err;
  EXPECT_THAT(trained.out, HasSubstr("from 6 images"));
  const auto vocabulary = Vocabulary::load(file_);
  ASSERT_TRUE(vocabulary.ok()) << vocabulary.message();
  EXPECT_GT(vocabulary->size(), 40u);
  const Outcome info = vocab({"info", file_});
  EXPECT_EQ(info.code, kExitOk);
  EXPECT_THAT(info.out, HasSubstr("words     " + std::to_string(vocabulary->size())));
}

TEST_F(VocabCommand, TheSameImagesGiveTheSameFile) {
  draw_images(3);
  for (const char* name : {"a.bin", "b.bin"})
    ASSERT_EQ(
        vocab({"train", "--images", folder_ / "images", "--words", "30", "--out", folder_ / name})
            .code,
        kExitOk);
  EXPECT_EQ(Vocabulary::load(folder_ / "a.bin")->checksum(),
            Vocabulary::load(folder_ / "b.bin")->checksum());
}

TEST_F(VocabCommand, SaysWhatIsMissing) {
  EXPECT_EQ(vocab({"train", "--out", file_}).code, kExitUsage);
  const Outcome nowhere = vocab({"train", "--images", folder_ / "none", "--out", file_});
  EXPECT_EQ(nowhere.code, kExitFailure);
  EXPECT_THAT(nowhere.err, HasSubstr("none"));
  std::filesystem::create_directories(folder_ / "empty");
  EXPECT_THAT(vocab({"train", "--images", folder_ / "empty", "--out", file_}).err,
              HasSubstr("no images"));
  EXPECT_THAT(vocab({"train", "--scenes", "nowhere", "--out", file_}).err,
              HasSubstr("unknown scene"));
  EXPECT_THAT(vocab({"info", folder_ / "none.bin"}).err, HasSubstr("cannot read"));
}

TEST_F(VocabCommand, RefusesAnImageThatIsNone) {
  draw_images(1);
  std::ofstream(folder_ / "images" / "broken.jpg") << "no image";
  const Outcome outcome = vocab({"train", "--images", folder_ / "images", "--out", file_});
  EXPECT_EQ(outcome.code, kExitFailure);
  EXPECT_THAT(outcome.err, HasSubstr("broken.jpg"));
}

}  // namespace
}  // namespace cairn
