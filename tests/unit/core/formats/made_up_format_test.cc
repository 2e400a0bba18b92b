// A new format is one function that opens it and one row of the table: all else follows.

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/status_macros.h"
#include "core/formats/open_request.h"
#include "core/formats/open_volume.h"
#include "core/formats/refused_formats.h"
#include "core/source/bytes/file_source.h"
#include "core/source/bytes/file_start.h"
#include "core/source/single_series.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::WriteFile;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

// ---- The format: "MADEUP 4 3 2\n", then bytes, x fastest. ---------------------------------------

bool IsMadeUp(absl::string_view head) { return absl::StartsWith(head, "MADEUP "); }

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenMadeUpVolume(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const FileStart start, ReadFileStart(path, 64));
  const std::string line = start.bytes.substr(0, start.bytes.find('\n'));
  const std::vector<std::string> words = absl::StrSplit(line, ' ');
  math::Index3 dims;
  if (!IsMadeUp(line) || words.size() != 4 || !absl::SimpleAtoi(words[1], &dims.x) ||
      !absl::SimpleAtoi(words[2], &dims.y) || !absl::SimpleAtoi(words[3], &dims.z)) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": not a made-up file"));
  }
  return MakeFileSource({.sample_dims = dims, .spacing = {1, 1, 1}, .origin = {}, .direction = {}},
                        {.files = {path}, .offset = static_cast<std::int64_t>(line.size()) + 1},
                        path);
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenMadeUp(const FileRequest& request) {
  const auto open = [path = request.file] { return OpenMadeUpVolume(path); };
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> volume, open());
  return MakeSingleSeries(
      {.path = request.path, .field = request.field, .volume = std::move(volume), .open = open});
}

std::vector<Format> WithMadeUp() {
  std::vector<Format> formats = Formats();
  formats.push_back(
      {.name = "made up", .endings = {".mup"}, .is_content = IsMadeUp, .open = OpenMadeUp});
  return formats;
}

// ---- What follows from the row. -----------------------------------------------------------------

class MadeUpFormatTest : public ::testing::Test {
 protected:
  MadeUpFormatTest() {
    for (int i = 0; i < 24; ++i) {
      samples_ += static_cast<char>(i);
    }
  }
  std::string Write(const std::string& name) {
    WriteFile(dir_.Sub(name), "MADEUP 4 3 2\n" + samples_);
    return dir_.Sub(name);
  }
  absl::StatusOr<std::string> SamplesOf(const OpenRequest& request) {
    ISOSCOPE_ASSIGN_OR_RETURN(const auto series, Open(request, formats_));
    ISOSCOPE_ASSIGN_OR_RETURN(const auto volume, series->Open(0, 0, 0));
    return ReadAll(*volume, 1);
  }
  const testing::TempDir dir_;
  const std::vector<Format> formats_ = WithMadeUp();
  std::string samples_;
};

TEST_F(MadeUpFormatTest, OpensByItsEndingItsFieldItsContentAndItsName) {
  const std::string named = Write("scan.MUP");
  EXPECT_EQ(SamplesOf({.path = named}).value(), samples_);
  EXPECT_EQ(SamplesOf({.path = named + ":scan"}).value(), samples_);
  EXPECT_EQ(SamplesOf({.path = Write("scan")}).value(), samples_);
  const std::string other = Write("scan.mgz");
  EXPECT_FALSE(SamplesOf({.path = other}).ok()) << "the name is MGH's";
  EXPECT_EQ(SamplesOf({.path = other, .format = "made-up"}).value(), samples_);
  EXPECT_TRUE(NamesFormat("scan.mup", formats_));
  EXPECT_EQ(FilesOf({.path = named}, formats_).value(), std::vector<std::string>{named});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto identified, OpenIdentified({.path = named}, formats_));
  EXPECT_THAT(identified->IdentityOfStep(0).value(), HasSubstr("scan.MUP"));
}

TEST_F(MadeUpFormatTest, IsListedForPeople) {
  const std::vector<FormatName> names = FormatNames(formats_);
  EXPECT_EQ(names.back().name, "made-up");
  EXPECT_EQ(names.back().files, ".mup");
  EXPECT_THAT(ListedFormats(formats_), HasSubstr("made up (.mup)"));
  Write("scan.mup");
  EXPECT_EQ(ListVolumesIn(dir_.path(), formats_), "scan.mup");
  EXPECT_THAT(FindVolume(dir_.Sub("scan.mup"), "none", formats_),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(", made-up")));
}

TEST_F(MadeUpFormatTest, PartsOfItAreTakenAsOfAnyOther) {
  const std::string path = Write("scan.mup");
  EXPECT_EQ(SamplesOf({.path = path, .crop = SampleBox{{2, 1, 0}, {4, 3, 2}}}).value(),
            std::string({6, 7, 10, 11, 18, 19, 22, 23}));
  EXPECT_THAT(SamplesOf({.path = path, .stride = 3}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--stride")));
  EXPECT_THAT(SamplesOf({.path = path, .axes = "ZYX"}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--axes ZYX")));
}

TEST_F(MadeUpFormatTest, AWrongFileIsAnErrorThatNamesIt) {
  for (const char* bytes : {"", "noise", "MADEUP 4 3\n", "MADEUP 4 3 2\nabc"}) {
    WriteFile(dir_.Sub("bad.mup"), bytes);
    EXPECT_THAT(SamplesOf({.path = dir_.Sub("bad.mup")}),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("bad.mup")))
        << bytes;
  }
  EXPECT_THAT(SamplesOf({.path = dir_.Sub("none.mup")}),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("none.mup")));
  EXPECT_THAT(SamplesOf({.path = Write("scan.mup") + ":other"}),
              StatusIs(absl::StatusCode::kNotFound, AllOf(HasSubstr("other"), HasSubstr("scan"))));
}

}  // namespace
}  // namespace isoscope::source
