#include "core/base/log.h"

#include <string>

#include "gtest/gtest.h"

namespace isoscope::base {
namespace {

TEST(LogTest, LinesAreEventAndFields) {
  EXPECT_EQ(FormatLogLine("started", {}), "started");
  EXPECT_EQ(FormatLogLine("frame_done", {{"dataset", "head"}, {"count", 7}, {"ms", 41.5}}),
            "frame_done dataset=head count=7 ms=41.5");
}

TEST(LogTest, ValuesThatWouldBreakTheLineAreQuoted) {
  EXPECT_EQ(FormatLogLine("e", {{"a", "two words"}, {"b", ""}, {"c", "x=y"}}),
            "e a=\"two words\" b=\"\" c=\"x=y\"");
  EXPECT_EQ(FormatLogLine("e", {{"a", "say \"hi\""}, {"b", "back\\slash"}}),
            "e a=\"say \\\"hi\\\"\" b=\"back\\\\slash\"");
  // A value cannot forge a second line.
  EXPECT_EQ(FormatLogLine("e", {{"a", "1\nforged\r\t2"}}), "e a=\"1\\nforged\\r\\t2\"");
}

TEST(LogTest, ValuesDoNotSteerTheTerminalThatShowsTheLog) {
  EXPECT_EQ(FormatLogLine("e", {{"a", "\x1b[2J"}, {"b", "c\u009b d\xff\n"}}),
            "e a=?[2J b=\"c? d?\\n\"");
}

TEST(LogTest, StatusIsAField) {
  EXPECT_EQ(FormatLogLine("failed", {{"status", absl::DataLossError("bad block")}}),
            "failed status=\"DATA_LOSS: bad block\"");
}

TEST(LogTest, LevelsBelowTheChosenOneAreDropped) {
  ::testing::internal::CaptureStderr();
  SetLogLevel(LogLevel::kWarning);
  LogInfo("dropped");
  LogWarning("kept", {{"path", "{}"}});  // braces are no format
  SetLogLevel(LogLevel::kInfo);
  LogDebug("dropped_too");
  const std::string text = ::testing::internal::GetCapturedStderr();
  EXPECT_EQ(text.find("dropped"), std::string::npos) << text;
  EXPECT_NE(text.find(" warning kept path={}\n"), std::string::npos) << text;
}

TEST(LogTest, JsonLinesHaveTheirFieldsAsStringsWhateverTheyHold) {
  EXPECT_EQ(FormatLogJson("started", {}), R"("event":"started")");
  EXPECT_EQ(FormatLogJson("e", {{"count", 7}, {"a", "say \"hi\"\\ \n\r\t"}}),
            R"("event":"e","count":"7","a":"say \"hi\"\\ \n\r\t")");
}

TEST(LogTest, JsonStringsAreUtf8WithoutControlCharacters) {
  EXPECT_EQ(JsonString("\x1b[2J"), "\"?[2J\"");
  EXPECT_EQ(JsonString(absl::string_view("a\0b", 3)), "\"a?b\"");
  EXPECT_EQ(JsonString("gr\xc3\xbc\xc3\x9f \xff\xc3"), "\"gr\xc3\xbc\xc3\x9f ??\"");
}

}  // namespace
}  // namespace isoscope::base
