#include "core/source/child/walled_series.h"

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

// Says the lines of its path; "none" says nothing.
absl::StatusOr<std::vector<std::string>> Describe(const std::string& path,
                                                  const std::string& part) {
  if (path == "none") {
    return std::vector<std::string>();
  }
  std::vector<std::string> texts = absl::StrSplit(path, '|');
  if (!part.empty()) {
    texts.push_back(absl::StrCat("unit=", part));
  }
  return texts;
}

absl::StatusOr<std::unique_ptr<VolumeSource>> Open(const std::string& /*path*/,
                                                   const std::string& part) {
  const auto [number, step, component] = ParseWalledPart(part);
  return absl::NotFoundError(absl::StrCat(number, ".", step, ".", component));
}

constexpr WalledLibrary kLibrary = {
    .name = "Lib", .open = Open, .find_files = nullptr, .describe = Describe};

TEST(WalledSeriesTest, TextsGoThereAndBack) {
  WalledFile file{.info = {.name = "",
                           .fields_elsewhere = {"w"},
                           .times = {0.1, 2},
                           .time_unit = "s",
                           .length_unit = "m"}};
  file.Add({.name = "p", .long_name = "pressure", .unit = "Pa"}, 0);
  file.Add({.name = "v", .components = {"x", "y"}}, 7);
  std::string path;
  for (const std::string& text : WalledTexts(file)) {
    absl::StrAppend(&path, path.empty() ? "" : "|", text);
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenWalledSeries(kLibrary, path, ""));
  file.info.name = path;
  EXPECT_TRUE(series->info() == file.info);
  EXPECT_THAT(series->Open(1, 1, 1), StatusIs(absl::StatusCode::kNotFound, HasSubstr("7.1.1")));
}

TEST(WalledSeriesTest, NothingIsTakenForGranted) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto none, OpenWalledSeries(kLibrary, "none", ""));
  EXPECT_EQ(none, nullptr);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto part, OpenWalledSeries(kLibrary, "field=p", "Pa"));
  EXPECT_EQ(part->info().fields[0].unit, "Pa");
  for (const char* texts :
       {"times=", "times=1 0|field=p", "times=nan|field=p", "times=x|field=p", "unit=m",
        "field=", "field=p|field=p", "field=p|number=-1", "field=p|number=x", "field=p|component=x",
        "field=p|component=x|component=x", "field=p|nonsense=1"}) {
    EXPECT_THAT(OpenWalledSeries(kLibrary, texts, ""),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr("Lib")))
        << texts;
  }
}

}  // namespace
}  // namespace isoscope::source
