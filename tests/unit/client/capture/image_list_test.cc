#include "client/capture/image_list.h"

#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/temp_folder.h"

namespace cairn {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::Pair;

void write(const std::filesystem::path& file, const std::string& text) {
  std::ofstream(file) << text;
}

std::vector<ListedImage> at(std::initializer_list<std::int64_t> milliseconds) {
  std::vector<ListedImage> images;
  for (const auto ms : milliseconds) images.push_back({ms * 1'000'000, "x"});
  return images;
}

TEST(ParseSeconds, IsExactToTheNanosecond) {
  EXPECT_EQ(parse_seconds("1305031229.528748"), 1305031229528748000);
  EXPECT_EQ(parse_seconds("1403715273.262142976"), 1403715273262142976);
  EXPECT_EQ(parse_seconds("7"), 7'000'000'000);
  EXPECT_EQ(parse_seconds("0.5"), 500'000'000);
  EXPECT_EQ(parse_seconds("1.037359e-01"), 103735900);
}

TEST(ParseSeconds, RefusesWhatIsNoTime) {
  for (const char* text : {"", "x", "1.2.3", "-1", "nan", "inf", "1e300", "99999999999", "1,5"}) {
    EXPECT_FALSE(parse_seconds(text)) << text;
  }
  for (const char* text : {"", "12x", "1.5", "-3", "99999999999999999999"}) {
    EXPECT_FALSE(parse_nanoseconds(text)) << text;
  }
}

TEST(ReadImageList, PassesOverCommentsColumnsAndBadLines) {
  const synthetic::TempFolder folder;
  write(folder / "rgb.txt",
        "# color images\n\n2.5 rgb/b.png extra columns\r\nnonsense\n\t1.5\trgb/a.png\n3.0\n");
  const auto images = read_image_list(folder / "rgb.txt", folder.path(), ListFormat::kTum);
  ASSERT_TRUE(images.ok());
  ASSERT_EQ(images->size(), 2u);
  EXPECT_EQ((*images)[0].stamp_ns, 1'500'000'000);
  EXPECT_EQ((*images)[0].file, folder / "rgb/a.png");
  EXPECT_EQ((*images)[1].file, folder / "rgb/b.png");
}

TEST(ReadImageList, ReadsEurocLines) {
  const synthetic::TempFolder folder;
  write(folder / "data.csv", "#timestamp [ns],filename\r\n1403715273262142976, a.png\r\nx,b.png\n");
  const auto images = read_image_list(folder / "data.csv", "data", ListFormat::kEuroc);
  ASSERT_TRUE(images.ok());
  ASSERT_EQ(images->size(), 1u);
  EXPECT_EQ((*images)[0].stamp_ns, 1403715273262142976);
  EXPECT_EQ((*images)[0].file, "data/a.png");
}

TEST(ReadImageList, SaysWhichFileIsMissingOrEmpty) {
  const synthetic::TempFolder folder;
  const auto missing = read_image_list(folder / "rgb.txt", folder.path(), ListFormat::kTum);
  ASSERT_FALSE(missing.ok());
  EXPECT_THAT(missing.message(), HasSubstr("rgb.txt"));
  write(folder / "rgb.txt", "# nothing\n");
  const auto empty = read_image_list(folder / "rgb.txt", folder.path(), ListFormat::kTum);
  ASSERT_FALSE(empty.ok());
  EXPECT_THAT(empty.message(), HasSubstr("lists no images"));
}

TEST(ListImages, TakesImagesByNameOnly) {
  const synthetic::TempFolder folder;
  for (const char* name : {"b.PNG", "a.jpg", "notes.txt", "c"}) write(folder / name, "x");
  const auto files = list_images(folder.path());
  ASSERT_TRUE(files.ok());
  EXPECT_THAT(*files, ElementsAre(folder / "a.jpg", folder / "b.PNG"));
  EXPECT_FALSE(list_images(folder / "none").ok());
}

TEST(Associate, TakesTheClosestPairsFirstAndEachOnce) {
  // 100 would like 108, which is closer to 110; it gets nothing, 95 being 20 away from none.
  const auto pairs = associate(at({0, 100, 110}), at({3, 108, 140}), 20'000'000);
  EXPECT_THAT(pairs, ElementsAre(Pair(0, 0), Pair(2, 1)));
}

TEST(Associate, LeavesOutWhatIsTooFar) {
  EXPECT_THAT(associate(at({0, 100}), at({20, 121}), 20'000'000), ElementsAre(Pair(0, 0)));
  EXPECT_TRUE(associate(at({}), at({1}), 20'000'000).empty());
}

}  // namespace
}  // namespace cairn
