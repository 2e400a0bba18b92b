#include "core/formats/format_table.h"

#include <algorithm>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/string_view.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/find_volume.h"
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

TEST(FormatTest, EachIsListedByItsNameAndItsFiles) {
  const std::vector<FormatName> names = FormatNames();
  ASSERT_EQ(names.size(), Formats().size());
  const auto files_of = [&](absl::string_view name) {
    return std::find_if(names.begin(), names.end(),
                        [&](const FormatName& format) { return format.name == name; })
        ->files;
  };
  EXPECT_EQ(files_of("nrrd"), ".nrrd .nhdr");
  EXPECT_EQ(files_of("nifti-1"), "by content");
  EXPECT_EQ(files_of("legacy-vtk"), ".vtk");
  EXPECT_EQ(files_of("tiff"), ".tif .tiff .lsm, a folder of them, or a pattern");
}

TEST(FormatTest, AxesAreForTheFormatsThatTakeThem) {
  const auto check = [](const char* format, const char* axes) {
    return CheckAxes(*FindFormat(format), "a", axes);
  };
  ISOSCOPE_EXPECT_OK(check("nrrd", ""));
  ISOSCOPE_EXPECT_OK(check("hdf5", "TZYX"));
  ISOSCOPE_EXPECT_OK(check("slices", "Z"));
  for (const absl::Status& status : {check("nrrd", "TZ"), check("slices", "TZ")}) {
    EXPECT_THAT(
        status,
        StatusIs(absl::StatusCode::kInvalidArgument,
                 HasSubstr("a: --axes TZ: the axes of this kind of file have their meaning; "
                           "--axes is for datasets of HDF5 files, for arrays of Zarr, for TIFF, "
                           "for arrays of NumPy (.npy), for netCDF, as "
                           "--axes Z for slices in any order of numbers")));
  }
}

TEST(FormatTest, APathNamesAFileAndAPart) {
  const testing::TempDir dir;
  testing::WriteFile(dir.Sub("run.MRC"), testing::MrcBytes({}, ""));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto found, FindByName(dir.Sub("run.MRC:p:1")));
  ASSERT_TRUE(found.has_value());
  EXPECT_EQ(found->format->name, "MRC");
  EXPECT_EQ(found->request.file, dir.Sub("run.MRC"));
  EXPECT_EQ(found->request.part, "p:1");
}

TEST(FormatTest, ContentDecidesWhereTheNameDoesNot) {
  const testing::TempDir dir;
  testing::WriteFile(dir.Sub("map"), testing::MrcBytes({}, ""));
  testing::WriteFile(dir.Sub("text"), "text");
  EXPECT_EQ(FindByContent(dir.Sub("map"))->format->name, "MRC");
  EXPECT_FALSE(FindByContent(dir.Sub("text")).has_value());
  EXPECT_FALSE(FindByContent(dir.Sub("none")).has_value());
  EXPECT_FALSE(FindByContent(dir.path()).has_value());
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
