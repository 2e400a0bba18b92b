#include "core/source/bytes/text_scanner.h"

#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class TextScannerTest : public ::testing::Test {
 protected:
  const io::RandomAccessFile* Write(const std::string& bytes) {
    testing::WriteFile(dir_.Sub("text"), bytes);
    file_ = *io::OpenRandomAccessFile(dir_.Sub("text"));
    return file_.get();
  }
  testing::TempDir dir_;
  std::unique_ptr<io::RandomAccessFile> file_;
};

std::vector<std::string> Words(TextScanner scanner) {
  std::vector<std::string> words;
  while (true) {
    words.emplace_back(*scanner.NextWord());
    if (words.back().empty()) {
      words.pop_back();
      return words;
    }
  }
}

TEST_F(TextScannerTest, WordsAreApartByAnyWhiteSpace) {
  EXPECT_THAT(Words(TextScanner(Write(" 1\t2\r\n\v\f3 "))), ElementsAre("1", "2", "3"));
  EXPECT_THAT(Words(TextScanner(Write("last"))), ElementsAre("last"));
  EXPECT_THAT(Words(TextScanner(Write(""))), ElementsAre());
  EXPECT_THAT(Words(TextScanner(Write("skipped 1"), 8)), ElementsAre("1"));
}

TEST_F(TextScannerTest, LinesEndAsOnUnixAndWindowsAndAtTheEndOfTheFile) {
  TextScanner scanner(Write("one\r\n\ntwo words\nthree"));
  std::vector<std::string> lines;
  while (!scanner.is_at_end()) {
    lines.emplace_back(*scanner.NextLine());
  }
  EXPECT_THAT(lines, ElementsAre("one", "", "two words", "three"));
  EXPECT_EQ(*scanner.NextLine(), "");
}

TEST_F(TextScannerTest, WordsAndPositionsAreRightAcrossTheBuffersEnds) {
  std::string text;
  std::vector<std::string> expected;
  for (int i = 0; i < 50'000; ++i) {
    expected.push_back(std::to_string(i * 37));
    text += expected.back() + (i % 7 == 0 ? "\n" : " ");
  }
  TextScanner scanner(Write(text));
  std::string got;
  for (const std::string& word : expected) {
    ASSERT_EQ(*scanner.NextWord(), word);
    ASSERT_EQ(text.substr(static_cast<std::size_t>(scanner.position()) - word.size(), word.size()),
              word);
  }
  scanner.MoveTo(0);
  EXPECT_EQ(*scanner.NextWord(), "0");
  EXPECT_EQ(scanner.position(), 1);
}

TEST_F(TextScannerTest, WhatIsNoTextIsRefusedInBoundedMemory) {
  TextScanner scanner(Write(std::string(100'000, 'x')));
  EXPECT_THAT(scanner.NextWord().status(),
              testing::StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("without a break")));
  scanner.MoveTo(0);
  EXPECT_FALSE(scanner.NextLine().ok());
}

}  // namespace
}  // namespace isoscope::source
