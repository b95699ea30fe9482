#include "common/config/yaml_reader.h"

#include <filesystem>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace cairn {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

Section parsed(const std::string& text) {
  auto root = parse_yaml(text, "c.yaml");
  EXPECT_TRUE(root.ok()) << (root.ok() ? "" : root.message());
  return *root;
}

std::string parse_error(const std::string& text) {
  const auto root = parse_yaml(text, "c.yaml");
  return root.ok() ? "no error" : root.message();
}

TEST(YamlReader, ReadsEveryKindOfValue) {
  Section root = parsed(
      "rate: 2.5\ncount: 7\nname: desk\non: true\nlist: [1, 2e1, -3]\nmode: fast\n"
      "inner:\n  depth: 5\n");
  EXPECT_EQ(root.number("rate"), 2.5);
  EXPECT_EQ(root.integer("count"), 7);
  EXPECT_EQ(root.text("name"), "desk");
  EXPECT_TRUE(root.flag("on"));
  EXPECT_THAT(root.numbers<3>("list", "a b c"), ElementsAre(1, 20, -3));
  EXPECT_EQ(root.choice<int>("mode", {{"slow", 1}, {"fast", 2}}), 2);
  EXPECT_EQ(root.section("inner").number("depth"), 5);
  EXPECT_TRUE(root.finish().ok());
}

TEST(YamlReader, AbsentOptionalKeysGiveTheFallback) {
  Section root = parsed("");
  EXPECT_EQ(root.number_or("rate", 30), 30);
  EXPECT_EQ(root.integer_or("count", 4), 4);
  EXPECT_EQ(root.text_or("name", "x"), "x");
  EXPECT_TRUE(root.flag_or("on", true));
  EXPECT_EQ(root.choice_or("mode", 1, {{"slow", 1}, {"fast", 2}}), 1);
  EXPECT_FALSE(root.optional_section("inner").has_value());
  EXPECT_TRUE(root.finish().ok());
}

TEST(YamlReader, WrongLengthNamesFileLineAndKey) {
  Section root = parsed("sensor: rgbd\ncamera:\n  # pixels\n  intrinsics: [1, 2, 3]\n");
  root.section("camera").numbers<4>("intrinsics", "fx fy cx cy");
  EXPECT_EQ(root.status().message(),
            "c.yaml:4: camera.intrinsics: needs 4 numbers (fx fy cx cy), has 3");
}

TEST(YamlReader, NumbersMustBeWholeFiniteAndInRange) {
  const auto error = [](const std::string& value) {
    Section root = parsed("k: " + value);
    root.number("k", {0, 10});
    return root.ok() ? std::string("no error") : root.status().message();
  };
  EXPECT_EQ(error("10"), "no error");
  EXPECT_EQ(error("+1e-1"), "no error");
  EXPECT_EQ(error("11"), "c.yaml:1: k: must be at most 10, is 11");
  EXPECT_EQ(error("-0.5"), "c.yaml:1: k: must be at least 0, is -0.5");
  EXPECT_EQ(error("5m"), "c.yaml:1: k: needs a number, has '5m'");
  EXPECT_EQ(error("[5]"), "c.yaml:1: k: needs a number, has a list");
  EXPECT_EQ(error(""), "c.yaml:1: k: needs a number, has nothing");
  for (const char* value : {"nan", ".nan", "inf", "-.inf", "1e999"})
    EXPECT_THAT(error(value), StartsWith("c.yaml:1: k: ")) << value;
  EXPECT_EQ(error(".nan"), "c.yaml:1: k: is not a finite number: .nan");
}

TEST(YamlReader, IntegersRefuseFractionsAndOverflow) {
  for (const char* value : {"1.5", "1e3", "99999999999999999999", "x", "11", "-1"}) {
    Section root = parsed(std::string("k: ") + value);
    EXPECT_EQ(root.integer_or("k", 5, {0, 10}), 5) << value;
    EXPECT_FALSE(root.ok()) << value;
  }
}

TEST(YamlReader, ListedNumbersAreCheckedOneByOne) {
  Section root = parsed("k: [1, .nan]");
  EXPECT_THAT(root.numbers("k", 0, 3, "a b c"), ElementsAre());
  EXPECT_EQ(root.status().message(),
            "c.yaml:1: k: number 2 of (a b c) is not a finite number: .nan");
}

TEST(YamlReader, WrongChoiceListsTheRightOnes) {
  Section root = parsed("mode: fats");
  EXPECT_EQ(root.choice_or("mode", 1, {{"slow", 1}, {"fast", 2}}), 1);
  EXPECT_EQ(root.status().message(), "c.yaml:1: mode: must be one of slow, fast; has 'fats'");
}

TEST(YamlReader, MissingKeyPointsAtItsBlock) {
  Section root = parsed("a: 1\ncamera:\n  zoom: 2\n");
  root.section("camera").number("focal_length");
  EXPECT_EQ(root.status().message(), "c.yaml:2: camera.focal_length: is missing");
}

TEST(YamlReader, MissingKeyWithANearMissPointsAtThat) {
  Section root = parsed("camera:\n  resolution: [1, 2]\n  intrinsic: 1\n");
  root.section("camera").number("intrinsics");
  EXPECT_EQ(
      root.status().message(),
      "c.yaml:3: camera.intrinsic: unknown key; did you mean 'intrinsics', which is missing?");
}

TEST(YamlReader, UnusedKeyIsAnErrorAndNamesTheNearestKnownOne) {
  Section root = parsed("camera:\n  rate_hz: 30\n  depht_scale: 5000\n");
  Section camera = root.section("camera");
  camera.number("rate_hz");
  camera.number_or("depth_scale", 1000);
  EXPECT_TRUE(root.status().ok());
  EXPECT_EQ(root.finish().message(),
            "c.yaml:3: camera.depht_scale: unknown key; did you mean 'depth_scale'?");
}

TEST(YamlReader, UnusedKeyUnlikeAnyOtherIsJustUnknown) {
  Section root = parsed("rate_hz: 30\nbanana: 1\n");
  root.number("rate_hz");
  EXPECT_EQ(root.finish().message(), "c.yaml:2: banana: unknown key");
}

TEST(YamlReader, BlocksThatNobodyReadAreUnknownToo) {
  const Section root = parsed("camera:\n  rate_hz: 30\n");
  EXPECT_EQ(root.finish().message(), "c.yaml:1: camera: unknown key");
}

TEST(YamlReader, FirstErrorStaysAndLaterReadsDoNothing) {
  Section root = parsed("a: x\nb: 2\nc: {d: 1}\n");
  EXPECT_EQ(root.number("a"), 0);
  EXPECT_EQ(root.number_or("b", 9), 9);
  EXPECT_EQ(root.section("c").number("missing"), 0);
  EXPECT_THAT(root.numbers<2>("b", "x y"), ElementsAre(0, 0));
  root.fail("b", "never seen");
  EXPECT_THAT(root.finish().message(), StartsWith("c.yaml:1: a: "));
}

TEST(YamlReader, CopiesOfASectionShareTheirState) {
  Section root = parsed("camera: {rate: x}\n");
  Section once = root.section("camera"), again = root.section("camera");
  once.number("rate");
  EXPECT_FALSE(again.ok());
  EXPECT_FALSE(root.ok());
}

TEST(YamlReader, OwnChecksNameTheKeysLine) {
  Section root = parsed("a: 1\n\nb: 2\n");
  root.fail("b", "must be odd");
  EXPECT_EQ(root.status().message(), "c.yaml:3: b: must be odd");
}

TEST(YamlReader, RefusesWhatIsNoBlockOfKeys) {
  EXPECT_THAT(parse_error("a: [1, 2\nb: 3\n"), HasSubstr("c.yaml:"));
  EXPECT_THAT(parse_error("a: [1, 2\nb: 3\n"), HasSubstr("not valid YAML"));
  EXPECT_THAT(parse_error("\ta: 1"), HasSubstr("not valid YAML"));
  EXPECT_EQ(parse_error("- 1\n- 2\n"), "c.yaml:1: needs 'key: value' lines, has a list");
  EXPECT_EQ(parse_error("hello"), "c.yaml:1: needs 'key: value' lines, has 'hello'");
  EXPECT_EQ(parse_error("a: 1\nb: 2\na: 3\n"), "c.yaml:3: a: is given twice, first on line 1");
}

TEST(YamlReader, MissingFilesAndFoldersAreErrors) {
  const auto absent = load_yaml("/nonexistent/c.yaml");
  ASSERT_FALSE(absent.ok());
  EXPECT_EQ(absent.error().code, ErrorCode::kNotFound);
  EXPECT_EQ(absent.message(), "/nonexistent/c.yaml: can't be read; is the path right?");
  EXPECT_FALSE(load_yaml(std::filesystem::temp_directory_path().string()).ok());
}

}  // namespace
}  // namespace cairn
