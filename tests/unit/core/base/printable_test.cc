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

TEST(PrintableTest, MarksOfDirectionSeparatorsAndTagsSteerTooAndAreReplaced) {
  EXPECT_EQ(Printable("a\u202egnp.exe"), "a?gnp.exe") << "read from right to left";
  EXPECT_EQ(Printable("\u061c\u200e\u200f\u202a\u202b\u202c\u202d"), "???????");
  EXPECT_EQ(Printable("\u2066\u2067\u2068\u2069"), "????");
  EXPECT_EQ(Printable("one\u2028two\u2029three"), "one?two?three") << "lines of their own";
  EXPECT_EQ(Printable("\U000e0001\U000e0061\U000e007f"), "???") << "seen nowhere";
  // Their neighbours, and joiners that words of people need.
  const std::string plain = "\u061b\u061d\u200c\u200d\u2010\u2027\u202f\u2065\u206a\U000e0080";
  EXPECT_EQ(Printable(plain), plain);
}

TEST(PrintableTest, EscapedTextSaysWhichCharacterItHad) {
  EXPECT_EQ(Escaped("a\n\r\t\"\\b"), R"(a\n\r\t\"\\b)");
  EXPECT_EQ(Escaped("\x1b[2J\u009b\x7f"), R"(\u001b[2J\u009b\u007f)");
  EXPECT_EQ(Escaped("\xff\xc3"), R"(\xff\xc3)");
  EXPECT_EQ(Escaped("\u2028\u202e\U000e0001"), R"(\u2028\u202e\U000e0001)");
  EXPECT_EQ(Escaped(absl::string_view("a\0b", 3)), R"(a\u0000b)");
  const std::string plain = "Sch\u00e4del \U0001f480 'x' 60 %";
  EXPECT_EQ(Escaped(plain), plain);
  EXPECT_TRUE(IsPlain(plain));
  for (const char* text : {"\"", "\\", "\n", "\x1b", "\xff", "\u202e", "a\u2028"}) {
    EXPECT_FALSE(IsPlain(text)) << Escaped(text);
  }
}

TEST(PrintableTest, LongTextIsCutAndSaysSo) {
  EXPECT_EQ(CutText(std::string(256, 'a')), std::string(256, 'a'));
  EXPECT_EQ(CutText(std::string(257, 'a')), std::string(256, 'a') + "... (cut, 257 bytes)");
  EXPECT_EQ(CutText("abc", 3), "abc");
  EXPECT_EQ(CutText("abc", 2), "ab... (cut, 3 bytes)");
  EXPECT_EQ(CutText("abc", 0), "... (cut, 3 bytes)");
}

TEST(PrintableTest, NoCharacterIsCutInTwo) {
  // U+00E4 has two bytes, U+2013 three, U+1F480 four.
  EXPECT_EQ(CutText("a\u00e4bc", 2), "a... (cut, 5 bytes)");
  EXPECT_EQ(CutText("a\u00e4bc", 3), "a\u00e4... (cut, 5 bytes)");
  EXPECT_EQ(CutText("a\u2013bc", 3), "a... (cut, 6 bytes)");
  EXPECT_EQ(CutText("a\u2013bc", 4), "a\u2013... (cut, 6 bytes)");
  for (const std::size_t bytes : {1U, 2U, 3U, 4U}) {
    EXPECT_EQ(CutText("a\U0001f480bc", bytes), "a... (cut, 7 bytes)") << bytes;
  }
  EXPECT_EQ(CutText("a\U0001f480bc", 5), "a\U0001f480... (cut, 7 bytes)");
  EXPECT_EQ(CutText("\x80\x80\x80\x80\x80\x80", 5), "\x80\x80\x80\x80\x80... (cut, 6 bytes)");
}

TEST(PrintableTest, ForeignTextIsBoundedWhenItIsKept) {
  const ForeignText text = std::string(1000, 'x');
  EXPECT_EQ(text.text(), CutText(std::string(1000, 'x')));
  EXPECT_EQ(ForeignText("head").text(), "head");
  EXPECT_TRUE(ForeignText().empty());
  EXPECT_FALSE(text.empty());
}

TEST(PrintableTest, AQuotedNameCanNotEndItsQuotes) {
  EXPECT_EQ(Quoted("head"), "\"head\"");
  EXPECT_EQ(Quoted("a\" is not a\n"), R"("a\" is not a\n")");
  EXPECT_EQ(Quoted("head", '\''), "'head'");
  EXPECT_EQ(Quoted(std::string(900'000, 'x')),
            "\"" + std::string(256, 'x') + "... (cut, 900000 bytes)\"");
}

TEST(PrintableTest, JsonStringsAreUtf8WithoutSteeringCharacters) {
  EXPECT_EQ(JsonString("\x1b[2J"), R"("\u001b[2J")");
  EXPECT_EQ(JsonString("say \"hi\"\\ \n\r\t"), R"("say \"hi\"\\ \n\r\t")");
  EXPECT_EQ(JsonString(absl::string_view("a\0b", 3)), R"("a\u0000b")");
  EXPECT_EQ(JsonString("gr\u00fc\u00df \xff\xc3"), "\"gr\u00fc\u00df \\ufffd\\ufffd\"");
  EXPECT_EQ(JsonString("\u2028\u202e\U000e0001\U0001f480"),
            "\"\\u2028\\u202e\\udb40\\udc01\U0001f480\"");
}

TEST(PrintableTest, JsonSaysTheSameWithoutSteeringCharacters) {
  EXPECT_EQ(PrintableJson("{\n  \"a\": \"\\u001b[\u009b\x7f\u00e4\u202e\U000e0001\"\n}"),
            "{\n  \"a\": \"\\u001b[\\u009b\\u007f\u00e4\\u202e\\udb40\\udc01\"\n}");
}

TEST(PrintableTest, BytesThatAreNoUtf8AreReplacedAlone) {
  EXPECT_EQ(ValidUtf8("a\xff\n\x1b\u00e4\xc3"), "a?\n\x1b\u00e4?");
}

}  // namespace
}  // namespace isoscope::base
