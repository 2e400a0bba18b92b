#include "client-cli/output/note_lines.h"

#include <sstream>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::cli {
namespace {

using ::testing::ElementsAre;

FrameRecord FrameWith(const std::vector<std::string>& messages) {
  FrameRecord frame;
  for (const std::string& message : messages) {
    frame.notes.emplace_back().set_message(message);
  }
  return frame;
}

TEST(NoteLinesTest, ANoteOfAllFramesIsSaidOnceWithoutTheirNumbers) {
  EXPECT_THAT(NoteLines({FrameWith({"a", "b"})}), ElementsAre("a", "b"));
  EXPECT_THAT(NoteLines({FrameWith({"a"}), FrameWith({"a"}), FrameWith({"a"})}), ElementsAre("a"));
  EXPECT_THAT(NoteLines({FrameWith({}), FrameWith({})}), ElementsAre());
  EXPECT_THAT(NoteLines({}), ElementsAre());
}

TEST(NoteLinesTest, ANoteOfSomeFramesNamesThem) {
  EXPECT_THAT(NoteLines({FrameWith({}), FrameWith({"a"})}), ElementsAre("frame 1: a"));
  EXPECT_THAT(NoteLines({FrameWith({"a"}), FrameWith({}), FrameWith({"b", "a"}), FrameWith({"a"}),
                         FrameWith({"a"})}),
              ElementsAre("frames 0, 2 to 4: a", "frame 2: b"));
}

TEST(NoteLinesTest, TheLastOfTwelveLinesTellsHowManyThereAreBeyond) {
  std::vector<std::string> messages;
  for (int i = 0; i < 12; ++i) {
    messages.push_back("note " + std::to_string(i));
  }
  EXPECT_EQ(NoteLines({FrameWith(messages)}).size(), 12U);
  EXPECT_EQ(NoteLines({FrameWith(messages)}).back(), "note 11");
  messages.push_back("note 12");
  const std::vector<std::string> lines = NoteLines({FrameWith(messages)});
  ASSERT_EQ(lines.size(), 12U);
  EXPECT_EQ(lines.back(), "2 more notes on surfaces that do not show; --stats has all");
}

TEST(NoteLinesTest, LinesGoToStandardErrorWithoutControlCharacters) {
  std::ostringstream out;
  std::ostringstream err;
  const Context context{.out = &out, .err = &err};
  WriteNotes({FrameWith({"label 3 (\x1B[2J)"})}, context);
  EXPECT_EQ(out.str(), "");
  EXPECT_EQ(err.str().substr(0, 18), "isoscope: label 3 ");
  EXPECT_EQ(err.str().find('\x1B'), std::string::npos);
}

}  // namespace
}  // namespace isoscope::cli
