#include "core/cli/table.h"

#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

#include "absl/strings/str_split.h"
#include "gtest/gtest.h"

namespace isoscope::cli {
namespace {

TEST(TableTest, ColumnsAreAligned) {
  Table table({"agent", "blocks", "ms"});
  table.AddRow({"a", "1,234", "5.0"});
  table.AddRow({"localhost:1", "7", ""});
  EXPECT_EQ(table.ToString(),
            "agent        blocks   ms\n"
            "a             1,234  5.0\n"
            "localhost:1       7\n");
}

TEST(TableTest, CellsDoNotSteerTheTerminal) {
  Table table({"agent", "message"});
  table.AddRow({"a\x1b[2J", "two\nlines\u009b"});
  EXPECT_EQ(table.ToString(),
            "agent     message\n"
            "a?[2J  two lines?\n");
}

TEST(TableTest, TextColumnsGetNarrowerUntilTheLineFits) {
  Table table({"name", "n", "message"});
  table.AddRow({"a", "12", "this is quite a long message"});
  EXPECT_EQ(table.ToString(30),
            "name   n  message\n"
            "a     12  this is quite a long\n"
            "          message\n");
  // Without a limit, and within a wide one, the table does not change.
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

TEST(TableTest, CutLinesMakeFlexibleColumnsNarrowerAndNoOthers) {
  Table table = Table::OfColumns({{"AGENT", true, true}, {"STATE", true}, {"FRAMES"}});
  table.AddRow({"a-long-name-of-a-host", "ok", "12"});
  using Lines = std::vector<std::string>;
  EXPECT_EQ(table.CutLines(0), Lines({"AGENT                  STATE  FRAMES",
                                      "a-long-name-of-a-host  ok         12"}));
  EXPECT_EQ(table.CutLines(25), Lines({"AGENT       STATE  FRAMES", "a-long-na~  ok         12"}));
  EXPECT_EQ(table.CutLines(1), Lines({"AGENT     STATE  FRAMES", "a-long-~  ok         12"}));
}

TEST(CutTextTest, TheLastCharacterSaysThatMoreFollowed) {
  EXPECT_EQ(CutText("abc", 3), "abc");
  EXPECT_EQ(CutText("abcd", 3), "ab~");
  EXPECT_EQ(CutText("abcd", 0), "");
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

}  // namespace
}  // namespace isoscope::cli
