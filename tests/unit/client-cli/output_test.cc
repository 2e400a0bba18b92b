#include "client-cli/output.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/stat.h>

#include "core/cli/usage.h"
#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::cli {
namespace {

using ::isoscope::testing::IsOk;
using ::isoscope::testing::TempDir;
using ::testing::HasSubstr;
using ::testing::Not;

std::size_t EntryCount(const std::string& directory) {
  std::size_t count = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(directory)) {
    ++count;
  }
  return count;
}

TEST(OutputTest, CountsHaveSeparatorsEveryThreeDigits) {
  EXPECT_EQ(FormatCount(0), "0");
  EXPECT_EQ(FormatCount(999), "999");
  EXPECT_EQ(FormatCount(1000), "1,000");
  EXPECT_EQ(FormatCount(-100), "-100");
  EXPECT_EQ(FormatCount(-1234567), "-1,234,567");
  EXPECT_EQ(FormatCount(std::numeric_limits<std::int64_t>::min()), "-9,223,372,036,854,775,808");
}

TEST(OutputTest, SizesAndTimesHaveOneDecimal) {
  EXPECT_EQ(FormatMebibytes(0), "0.0 MiB");
  EXPECT_EQ(FormatMebibytes(1536 * 1024), "1.5 MiB");
  EXPECT_EQ(FormatMebibytes(std::int64_t{5} << 32), "20,480.0 MiB");
  EXPECT_EQ(FormatMilliseconds(12345.678), "12,345.7");
  EXPECT_EQ(FormatElapsed(absl::Milliseconds(400)), "0 s");
  EXPECT_EQ(FormatElapsed(absl::Seconds(59)), "59 s");
  EXPECT_EQ(FormatElapsed(absl::Seconds(185)), "3 min 05 s");
  EXPECT_EQ(FormatElapsed(absl::Minutes(127)), "2 h 07 min");
}

TEST(OutputTest, TableColumnsAreAligned) {
  Table table({"agent", "blocks", "ms"});
  table.AddRow({"a", "1,234", "5.0"});
  table.AddRow({"localhost:1", "7", ""});
  EXPECT_EQ(table.ToString(),
            "agent        blocks   ms\n"
            "a             1,234  5.0\n"
            "localhost:1       7\n");
}

TEST(OutputTest, CellsAndProgressDoNotSteerTheTerminal) {
  Table table({"agent", "message"});
  table.AddRow({"a\x1b[2J", "two\nlines\u009b"});
  EXPECT_EQ(table.ToString(),
            "agent     message\n"
            "a?[2J  two lines?\n");
  std::ostringstream err;
  {
    ProgressLine line(&err, /*is_terminal=*/true);
    line.UpdateNow("waiting for \x1b]0;a\x07");
  }
  EXPECT_EQ(err.str(), "\rwaiting for ?]0;a?\x1b[K\r\x1b[K");
}

TEST(OutputTest, ProgressTellsRateAndTimeLeft) {
  constexpr std::int64_t kMiB = 1 << 20;
  EXPECT_EQ(FormatProgress("writing blocks", 25 * kMiB, 100 * kMiB, absl::Seconds(5)),
            "writing blocks    25 %  25.0 of 100.0 MiB  5.0 MiB/s  15 s left");
  EXPECT_EQ(FormatProgress("writing blocks", 0, 100 * kMiB, absl::ZeroDuration()),
            "writing blocks     0 %  0.0 of 100.0 MiB");
  EXPECT_THAT(FormatProgress("writing blocks", 101 * kMiB, 100 * kMiB, absl::Seconds(5)),
              HasSubstr("100 %"));
}

TEST(OutputTest, ProgressOfShortWorkPrintsNothing) {
  for (const bool is_terminal : {false, true}) {
    std::ostringstream err;
    {
      ProgressLine line(&err, is_terminal);
      line.Update("writing blocks", 1, 2);
    }
    EXPECT_EQ(err.str(), "");
  }
}

TEST(OutputTest, AtomicWriteReplacesAndLeavesNothingElse) {
  const TempDir folder;
  const std::string path = folder.Sub("a.png");
  ISOSCOPE_ASSERT_OK(WriteFileAtomically(path, "old"));
  ISOSCOPE_ASSERT_OK(WriteFileAtomically(path, "new"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string content, io::ReadWholeFile(path, 100));
  EXPECT_EQ(content, "new");
  EXPECT_EQ(EntryCount(folder.path()), 1U);
}

TEST(OutputTest, FailedAtomicWriteKeepsTheOldState) {
  const TempDir folder;
  std::filesystem::create_directory(folder.Sub("taken"));
  EXPECT_THAT(WriteFileAtomically(folder.Sub("taken"), "x"), Not(IsOk()));
  EXPECT_THAT(WriteFileAtomically(folder.Sub("absent/a.png"), "x"), Not(IsOk()));
  EXPECT_EQ(EntryCount(folder.path()), 1U);
}

TEST(OutputTest, AnAtomicFileAppearsWhenItIsCommittedAndElseLeavesNothing) {
  const TempDir folder;
  const std::string path = folder.Sub("a.png");
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto given_up, AtomicFile::Create(path));
    ISOSCOPE_ASSERT_OK(given_up->Append("half"));
  }
  EXPECT_EQ(EntryCount(folder.path()), 0U);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, AtomicFile::Create(path));
  ISOSCOPE_ASSERT_OK(file->Append("first, "));
  EXPECT_FALSE(std::filesystem::exists(path));
  ISOSCOPE_ASSERT_OK(file->Append("second"));
  ISOSCOPE_ASSERT_OK(file->Commit());
  EXPECT_EQ(file->size_bytes(), 13);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string content, io::ReadWholeFile(path, 100));
  EXPECT_EQ(content, "first, second");
  EXPECT_EQ(EntryCount(folder.path()), 1U);
}

TEST(OutputTest, DevicesAreWrittenAsTheyAre) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto device, AtomicFile::Create("/dev/null"));
  ISOSCOPE_EXPECT_OK(device->Append("x"));
  ISOSCOPE_EXPECT_OK(device->Commit());
  ISOSCOPE_EXPECT_OK(CheckWritable("/dev/null"));
  ISOSCOPE_EXPECT_OK(WriteFileAtomically("/dev/null", "x"));
  struct stat info {};
  ASSERT_EQ(stat("/dev/null", &info), 0);
  EXPECT_TRUE(S_ISCHR(info.st_mode));
}

TEST(OutputTest, OnlyTheSuffixOfTheFormatIsTaken) {
  for (const char* path : {"a.png", "A.PNG", "f.old/a", "a", ".png", "f/.a", "/dev/null"}) {
    ISOSCOPE_EXPECT_OK(CheckSuffix(path, ".png", "PNG"));
  }
  for (const char* path : {"a.jpg", "a.png.jpeg", "f.png/a.gif", "v1.5", "a."}) {
    EXPECT_TRUE(IsUsageError(CheckSuffix(path, ".png", "PNG"))) << path;
  }
  EXPECT_EQ(CheckSuffix("f/head.obj", ".ply", "PLY").message(),
            "--output 'f/head.obj': the suffix '.obj' is not that of the format written, PLY; "
            "expected 'head.ply'");
}

TEST(OutputTest, CheckWritableTellsWithoutATrace) {
  const TempDir folder;
  ISOSCOPE_EXPECT_OK(CheckWritable(folder.Sub("a.png")));
  EXPECT_EQ(EntryCount(folder.path()), 0U);
  std::ofstream(folder.Sub("b.png")) << "old";
  ISOSCOPE_EXPECT_OK(CheckWritable(folder.Sub("b.png")));
  EXPECT_EQ(EntryCount(folder.path()), 1U);
  EXPECT_THAT(CheckWritable(folder.Sub("absent/a.png")), Not(IsOk()));
  EXPECT_THAT(CheckWritable(folder.path()), Not(IsOk()));
}

TEST(WrapTextTest, BreaksAtSpacesAndBehindCommasAndSlashes) {
  using Lines = std::vector<std::string>;
  EXPECT_EQ(WrapText("", 5), Lines({""}));
  EXPECT_EQ(WrapText("short", 5), Lines({"short"}));
  EXPECT_EQ(WrapText("one two three", 7), Lines({"one two", "three"}));
  EXPECT_EQ(WrapText("head/0,head/1", 8), Lines({"head/0,", "head/1"}));
  EXPECT_EQ(WrapText("abcdefgh", 3), Lines({"abc", "def", "gh"}));
  EXPECT_EQ(WrapText("a  b", 1), Lines({"a", "b"}));
}

TEST(WrapTextTest, CharactersOfSeveralBytesStayWhole) {
  EXPECT_EQ(WrapText("\u00e4\u00e4\u00e4", 3),
            (std::vector<std::string>{"\u00e4", "\u00e4", "\u00e4"}));
  EXPECT_EQ(WrapText("\u00e4", 1).size(), 2U) << "no room for one: lines end all the same";
}

TEST(WrapTextTest, NoLineIsLongerAndNoLetterIsLost) {
  const std::string text = "a word, /some/long/path/of/it and, well, more of thisandthat";
  for (std::size_t width = 1; width < text.size() + 2; ++width) {
    std::string joined;
    for (const std::string& line : WrapText(text, width)) {
      EXPECT_LE(line.size(), width);
      joined += line;
    }
    std::string letters = text;
    for (std::string* const each : {&joined, &letters}) {
      each->erase(std::remove(each->begin(), each->end(), ' '), each->end());
    }
    EXPECT_EQ(joined, letters) << width;
  }
}

TEST(TableTest, TextColumnsGetNarrowerUntilTheLineFits) {
  Table table({"name", "n", "message"});
  table.AddRow({"a", "12", "this is quite a long message"});
  EXPECT_EQ(table.ToString(30),
            "name   n  message\n"
            "a     12  this is quite a long\n"
            "          message\n");
  // Without a limit, and where it fits, it is as ever.
  EXPECT_EQ(table.ToString(), table.ToString(200));
}

TEST(TableTest, ColumnsThatDoNotFitFollowBelowTheFirst) {
  Table table({"id", "alpha", "beta", "gamma"});
  table.AddRow({"1", "10", "20", "30"});
  EXPECT_EQ(table.ToString(15),
            "id  alpha  beta\n"
            "1      10    20\n"
            "\n"
            "id  gamma\n"
            "1      30\n");
}

TEST(TableTest, NoLineIsWiderThanTheWindow) {
  Table table({"agent", "shards", "active blocks", "drawn", "triangles", "message"});
  table.AddRow({"10.0.0.1:50052", "head/0,head/1,head/2,head/3", "1,234,567", "12", "123,456,789",
                "a sentence that goes on and on, as those of libraries do"});
  for (int width = 34; width < 140; ++width) {
    for (const absl::string_view line : absl::StrSplit(table.ToString(width), '\n')) {
      EXPECT_LE(line.size(), static_cast<std::size_t>(width));
    }
  }
}

}  // namespace
}  // namespace isoscope::cli
