// Each flag of a source decides what is read. Symptom: a flag that the cache, or `partition
// --resume`, did not know gave volumes of another command.
//
// The flags are those that the commands register: one without a sample value here fails.

#include "client-cli/session/source_flags.h"

#include <map>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "client-cli/session/series_flags.h"
#include "core/cli/flag_set.h"
#include "tests/support/status_matchers.h"

namespace isoscope::cli {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

constexpr char kPath[] = "/data/run";

struct Flags {
  SourceFlags source;
  SeriesFlags series;

  [[nodiscard]] std::string Describe() const {
    return source::Describe(RequestOf(source, series, kPath)).value();
  }
};

absl::Status Parse(const std::vector<std::string>& arguments, Flags* flags) {
  FlagSet set;
  AddSourceFlags(&set, &flags->source);
  AddSeriesFlags(&set, &flags->series);
  return set.Parse(arguments);
}

// Values by flag; the flags of raw files need others beside them.
const std::map<std::string, std::vector<std::string>>& Samples() {
  static const auto* const samples = new std::map<std::string, std::vector<std::string>>{
      {"--dims", {"4,3,2", "5,3,2"}},
      {"--type", {"uint16", "float64"}},
      {"--endian", {"big"}},
      {"--header-bytes", {"1", "352"}},
      {"--spacing", {"1,1,4", "1,1,4.0000000000000009"}},
      {"--origin", {"0,0,1", "0,0,-1"}},
      {"--direction", {"0,-1,0,1,0,0,0,0,1", "-1,0,0,0,1,0,0,0,1"}},
      {"--crop", {"0:4,0:,0:", "0:,1:,0:"}},
      {"--stride", {"2", "3"}},
      {"--fill", {"0", "293.15"}},
      {"--ignore-shear", {""}},
      {"--resample", {""}},
      {"--series", {"3", "1.2.3"}},
      {"--axes", {"TZYX", "TC3Z20"}},
      {"--format", {"nifti", "mrc"}},
      {"--label-names", {"a.txt", "b.txt"}},
      {"--field", {"p", "velocity"}},
      {"--step", {"1", "0:4:2"}},
      {"--time", {"0", "4.5"}},
  };
  return *samples;
}

std::vector<std::string> RegisteredFlags() {
  Flags flags;
  FlagSet set(FlagSetOptions{.has_help = false});
  AddSourceFlags(&set, &flags.source);
  AddSeriesFlags(&set, &flags.series);
  std::vector<std::string> names;
  for (const FlagDescription& flag : set.Describe()) {
    names.push_back(flag.names.front());
  }
  return names;
}

std::vector<std::string> Arguments(const std::string& flag, const std::string& value) {
  std::vector<std::string> arguments{flag};
  if (!value.empty()) {
    arguments.push_back(value);
  }
  return arguments;
}

bool IsOfRaw(const std::string& flag) {
  return flag == "--dims" || flag == "--type" || flag == "--endian" || flag == "--header-bytes";
}

TEST(SourceFlagsTest, EachValueOfEachFlagChangesTheDescriptionOfTheSource) {
  EXPECT_THAT(RegisteredFlags(), ::testing::UnorderedElementsAreArray([] {
                std::vector<std::string> names;
                for (const auto& [name, values] : Samples()) {
                  names.push_back(name);
                }
                return names;
              }()))
      << "a flag needs values in Samples";
  std::set<std::string> known;
  for (const auto& [flag, values] : Samples()) {
    for (const std::string& value : values) {
      std::vector<std::string> arguments = Arguments(flag, value);
      if (IsOfRaw(flag) && flag != "--dims") {
        arguments.insert(arguments.end(), {"--dims", "7,7,7"});
      }
      Flags flags;
      ISOSCOPE_ASSERT_OK(Parse(arguments, &flags));
      EXPECT_TRUE(known.insert(flags.Describe()).second) << flag << " " << value;
    }
  }
  EXPECT_TRUE(known.insert(Flags().Describe()).second) << "without a flag";
  Flags plain;
  ISOSCOPE_ASSERT_OK(Parse({"--dims", "7,7,7"}, &plain));
  EXPECT_TRUE(known.insert(plain.Describe()).second) << "raw, without another flag";
}

TEST(SourceFlagsTest, AFlagWithItsDefaultIsAsWithoutIt) {
  Flags flags;
  ISOSCOPE_ASSERT_OK(Parse({"--stride", "1"}, &flags));
  EXPECT_EQ(flags.Describe(), Flags().Describe());
}

TEST(SourceFlagsTest, EachFlagOfASourceIsTypedAgainAsItWasGiven) {
  for (const auto& [flag, values] : Samples()) {
    if (flag == "--field" || flag == "--step" || flag == "--time") {
      continue;  // of `partition` alone
    }
    for (const std::string& value : values) {
      Flags flags;
      ISOSCOPE_ASSERT_OK(Parse(Arguments(flag, value), &flags));
      EXPECT_EQ(AsTyped(flags.source), absl::StrCat(" ", flag, value.empty() ? "" : " ", value));
      EXPECT_EQ(flags.source.FirstGiven(), flag);
      EXPECT_EQ(flags.source.FirstOfRaw() != nullptr, IsOfRaw(flag)) << flag;
    }
  }
  EXPECT_EQ(AsTyped(SourceFlags()), "");
  Flags several;
  ISOSCOPE_ASSERT_OK(Parse({"--fill", "0.1", "--label-names", "my names.txt"}, &several));
  EXPECT_EQ(AsTyped(several.source), " --fill 0.1 --label-names 'my names.txt'");
}

TEST(SourceFlagsTest, ADirectionIsNineNumbersOfRightAngles) {
  Flags flags;
  ISOSCOPE_ASSERT_OK(Parse({"--direction", "0,-1,0,1,0,0,0,0,1"}, &flags));
  EXPECT_EQ(flags.source.direction->columns[0], (math::Vec3d{0, 1, 0})) << "rows are given";
  for (const auto& [text, says] : std::map<std::string, std::string>{
           {"1,0,0", "is not nine numbers"},
           {"1,0,0,0,1,0,0,0,x", "is not nine numbers"},
           {"1,0,0,0,1,0,0,0,2", "axis z has a direction of length 2"},
           {"1,0.5,0,0,0.8660254,0,0,0,1", "axes x and y meet at 60.00 degrees"}}) {
    Flags bad;
    EXPECT_THAT(Parse({"--direction", text}, &bad),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(says)));
  }
}

TEST(SourceFlagsTest, WorldPositionsAreForEveryFormatAndDimensionsForRawFilesAlone) {
  Flags placed;
  ISOSCOPE_ASSERT_OK(Parse({"--spacing", "1,1,4"}, &placed));
  for (const char* path : {"scan.tif", "head.nii", "run.h5:/d", "folder"}) {
    ISOSCOPE_EXPECT_OK(CheckUsage(placed.source, path));
  }
  Flags raw;
  ISOSCOPE_ASSERT_OK(Parse({"--dims", "4,3,2", "--type", "uint8"}, &raw));
  EXPECT_THAT(CheckUsage(raw.source, "head.nii"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("raw files only")));
  raw.source.axes = "ZYX";
  EXPECT_THAT(CheckUsage(raw.source, "v.raw"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--axes")));
  EXPECT_THAT(CheckUsageWithDataset(placed.source, "flow"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--spacing is for a volume")));
}

}  // namespace
}  // namespace isoscope::cli
