#include "core/formats/medical/slc_series.h"

#include <memory>
#include <string>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/open_volume.h"
#include "core/source/volume_source.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

std::string Head(const std::string& sizes, int compression) {
  return absl::StrCat("11111\n", sizes, " 8\n0.5 2.0 4.0\n1 0 0 ", compression, "\n2 1 X",
                      "iconic");
}

// Two slices of "aaaabcdeaaaa" and "xxxxxxxxxxxx".
const char kPlain[] = "aaaabcdeaaaaxxxxxxxxxxxx";
std::string Runs() {
  return absl::StrCat("11 X",
                      std::string("\x04"
                                  "a"
                                  "\x84"
                                  "bcde"
                                  "\x04"
                                  "a"
                                  "\0",
                                  10),
                      "!", "3 X", std::string("\x0cx\0", 3));
}

class SlcSeriesTest : public ::testing::Test {
 protected:
  absl::StatusOr<std::string> Read(const std::string& bytes) {
    testing::WriteFile(dir_.Sub("a.slc"), bytes);
    auto volume = OpenVolumeFile(dir_.Sub("a.slc"));
    return volume.ok() ? ReadAll(**volume, 1) : volume.status();
  }
  testing::TempDir dir_;
};

TEST_F(SlcSeriesTest, PlainAndInRuns) {
  for (const bool has_runs : {false, true}) {
    const std::string path = dir_.Sub("skull");
    testing::WriteFile(path, Head("4 3 2", has_runs ? 1 : 0) + (has_runs ? Runs() : kPlain));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
    EXPECT_EQ(series->fields()[0].name, "skull");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, 0));
    EXPECT_EQ(volume->scalar_type(), volume::ScalarType::kUint8);
    const auto world = volume->geometry().world_from_index();
    EXPECT_EQ(math::TransformPoint(world, {0, 0, 0}), (math::Vec3d{0, 0, 0}));
    EXPECT_EQ(math::TransformPoint(world, {3, 2, 1}), (math::Vec3d{1.5, 4, 4}));
    for (const std::int64_t planes : {1, 2}) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*volume, planes));
      EXPECT_EQ(read, kPlain);
    }
  }
}

TEST_F(SlcSeriesTest, RefusesInASentence) {
  struct Case {
    std::string bytes;
    std::string sentence;
  };
  for (const Case& c :
       {Case{"11112\n", "does not begin with 11111"}, Case{"11111\n4 3", "expected a number"},
        Case{"11111\n4 3 2 16\n", "\"16\""}, Case{"11111\n4 3 99999 8\n", "\"99999\""},
        Case{"11111 4 3 2 8 1 1 1 0 0 0 2\n", "\"2\""},
        Case{"11111 4 3 2 8 1 1 1 0 0 0 0 2 1 Y", "no X"}, Case{Head("4 3 2", 0) + "abc", "a.slc"},
        Case{Head("4 3 2", 1) + "999 Xabc", "slice 0 has 999 bytes"},
        Case{Head("9999 9999 2", 1) + "3 Xabc", "slice 0 has 3 bytes"},
        Case{Head("1 3 2", 0) + kPlain, "a.slc"}}) {
    SCOPED_TRACE(c.sentence);
    EXPECT_THAT(Read(c.bytes), StatusIs(absl::StatusCode::kInvalidArgument,
                                        AllOf(HasSubstr("a.slc"), HasSubstr(c.sentence))));
  }
  for (const std::string& runs : {std::string("\x0bx\0", 3), std::string("\x0dx\0", 3),
                                  std::string("\x8cxx", 3), std::string("\x0cx\0", 1) + "?"}) {
    const std::string slice = absl::StrCat(runs.size(), " X", runs);
    EXPECT_THAT(Read(Head("4 3 2", 1) + slice + slice),
                StatusIs(runs.size() == 2 ? absl::StatusCode::kOk : absl::StatusCode::kDataLoss))
        << runs.size();
  }
}

}  // namespace
}  // namespace isoscope::source
