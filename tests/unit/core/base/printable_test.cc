#include "core/base/printable.h"

#include <string>

#include "gtest/gtest.h"

namespace isoscope::base {
namespace {

TEST(PrintableTest, TextOfPeopleStaysAsItIs) {
  for (const char* text : {"", "head 60 %", "Sch\u00e4del \u2013 \u5934 \U0001f480",
                           "\u00a0\u07ff\u0800\ufffd", "\U00010000\U0010ffff"}) {
    EXPECT_EQ(Printable(text), text);
  }
}

TEST(PrintableTest, NoControlCharacterIsLeft) {
  EXPECT_EQ(Printable("\x1b]0;title\x07\x1b[2J"), "?]0;title??[2J");
  EXPECT_EQ(Printable(absl::string_view("a\0b\x7f", 4)), "a?b?");
  for (int code = 0; code < 0x20; ++code) {
    const char c = static_cast<char>(code);
    EXPECT_EQ(Printable(std::string(1, c)), c == '\t' || c == '\n' || c == '\r' ? " " : "?");
  }
  // 8-bit control characters work in UTF-8 terminals, too: U+009B is ESC [.
  EXPECT_EQ(Printable("a\u009b31m\u0080\u009f"), "a?31m??");
}

TEST(PrintableTest, WhiteSpaceKeepsWordsApartInOneLine) {
  EXPECT_EQ(Printable("one\ttwo\nthree\r\nfour\rfive\n\nsix"), "one two three four five  six");
}

TEST(PrintableTest, BytesThatAreNoUtf8DoNotHideAControlCharacter) {
  EXPECT_EQ(Printable("\x9b"
                      "2J"),
            "?2J")
      << "a bare 8-bit CSI";
  EXPECT_EQ(Printable("\xc2"), "?") << "cut";
  EXPECT_EQ(Printable("\xe2\x80"), "??") << "cut";
  EXPECT_EQ(Printable("\xc2\x1b["), "??[") << "the second byte is a character of its own";
  EXPECT_EQ(Printable("\xc0\x9b"), "??") << "longer than need be: ESC in two bytes";
  EXPECT_EQ(Printable("\xc1\x9b\xe0\x80\x9b\xf0\x80\x80\x9b"), "?????????") << "in two to four";
  EXPECT_EQ(Printable("\xed\xa0\x80"), "???") << "half a pair of UTF-16";
  EXPECT_EQ(Printable("\xf4\x90\x80\x80\xf5\x80\x80\x80\xff"), "?????????") << "beyond the last";
}

TEST(PrintableTest, AsciiHasOneByteForEachColumn) {
  EXPECT_EQ(PrintableAscii("\u00e4\x1b\x9b ok\n"), "???? ok ");
}

TEST(PrintableTest, JsonSaysTheSameWithoutControlCharacters) {
  EXPECT_EQ(PrintableJson("{\n  \"a\": \"\\u001b[\u009b\x7f\u00e4\"\n}"),
            "{\n  \"a\": \"\\u001b[\\u009b\\u007f\u00e4\"\n}");
}

}  // namespace
}  // namespace isoscope::base
