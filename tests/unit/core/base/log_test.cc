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
            R"(e a="\u001b[2J" b="c\u009b d\xff\n")");
  EXPECT_EQ(FormatLogLine("e", {{"a", "x\u2028forged\u202e"}}), R"(e a="x\u2028forged\u202e")");
}

// Symptom: a stranger's dataset name of 900 kB was a line of the log.
TEST(LogTest, LongValuesAreCut) {
  const std::string name(900'000, 'x');
  const std::string cut = std::string(256, 'x') + "... (cut, 900000 bytes)";
  EXPECT_EQ(FormatLogLine("e", {{"dataset", name}}), "e dataset=\"" + cut + "\"");
  EXPECT_EQ(FormatLogJson("e", {{"dataset", name}}), R"("event":"e","dataset":")" + cut + "\"");
  EXPECT_EQ(FormatLogLine("e", {{"dataset", ForeignText(name)}}), "e dataset=\"" + cut + "\"")
      << "cut once";
}

TEST(LogTest, OwnTextsAndErrorsMayBeLonger) {
  const std::string path(4096, 'p');
  EXPECT_EQ(FormatLogLine("e", {{"file", OwnText{path}}}), "e file=" + path);
  EXPECT_EQ(FormatLogLine("e", {{"file", OwnText{path + "p"}}}),
            "e file=\"" + path + "... (cut, 4097 bytes)\"");
  const std::string line = FormatLogLine("e", {{"status", absl::InternalError(path)}});
  EXPECT_NE(line.find("p... (cut, 4106 bytes)\""), std::string::npos) << line;
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

}  // namespace
}  // namespace isoscope::base
