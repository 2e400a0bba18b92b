#include "core/formats/format_table.h"

#include <set>
#include <string>

#include "absl/strings/ascii.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/open_volume.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/maps/mrc_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(FormatTest, EndingsAreInLowerCaseAndBelongToOneFormat) {
  std::set<std::string> endings;
  for (const Format& format : Formats()) {
    EXPECT_NE(format.open, nullptr) << format.name;
    if (!format.endings.empty()) {
      EXPECT_THAT(ListedFormats(), HasSubstr(std::string(format.name)));
    }
    EXPECT_EQ(FindFormat(FormatNameOf(format)), &format);
    EXPECT_THAT(FormatNameOf(format), Not(HasSubstr(" ")));
    for (const std::string& ending : format.endings) {
      EXPECT_TRUE(endings.insert(ending).second) << ending;
      EXPECT_EQ(ending, absl::AsciiStrToLower(ending));
      EXPECT_EQ(ending.front() == '.', format.name != "ParaVision") << ending;
    }
  }
}

TEST(FormatTest, APathNamesAFileAndAPart) {
  const auto found = FindFormatFileByName("/d/run.MRC:p:1");
  ASSERT_TRUE(found.has_value());
  EXPECT_EQ(found->format->name, "MRC");
  EXPECT_EQ(found->file, "/d/run.MRC");
  EXPECT_EQ(found->part, "p:1");
  EXPECT_FALSE(FindFormatFileByName("/d/run.nrrd").has_value());
}

TEST(FormatTest, ContentDecidesWhereTheNameDoesNot) {
  const testing::TempDir dir;
  testing::WriteFile(dir.Sub("map"), testing::MrcBytes({}, ""));
  testing::WriteFile(dir.Sub("text"), "text");
  EXPECT_EQ(FindFormatFileByContent(dir.Sub("map"))->format->name, "MRC");
  EXPECT_FALSE(FindFormatFileByContent(dir.Sub("text")).has_value());
  EXPECT_FALSE(FindFormatFileByContent(dir.Sub("none")).has_value());
  EXPECT_FALSE(FindFormatFileByContent(dir.path()).has_value());
}

TEST(FormatTest, SaysWhatThereIsNot) {
  const testing::TempDir dir;
  EXPECT_THAT(OpenVolumeSeries(dir.Sub("none.mrc")),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("no such file")));
  EXPECT_THAT(OpenVolumeFile(dir.Sub("none.mrc")),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("no such file")));
  testing::WriteFile(dir.Sub("a.mrc"), testing::MrcBytes({}, std::string(96, 'a')));
  EXPECT_THAT(OpenVolumeSeries(dir.Sub("a.mrc:b")),
              StatusIs(absl::StatusCode::kNotFound,
                       AllOf(HasSubstr("no field \"b\""), HasSubstr("it holds a"))));
  EXPECT_TRUE(OpenVolumeSeries(dir.Sub("a.mrc:a")).ok());
}

}  // namespace
}  // namespace isoscope::source
