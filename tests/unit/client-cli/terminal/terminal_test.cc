#include "client-cli/terminal/terminal.h"

#include <unistd.h>

#include <map>
#include <ostream>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "tests/support/pseudo_terminal.h"

namespace isoscope::cli {
namespace {

Environment Variables(const std::map<std::string, std::string>& variables) {
  return [variables](const char* name) {
    const auto found = variables.find(name);
    return found == variables.end() ? std::string() : found->second;
  };
}

TEST(ParseTerminalAnswerTest, ReadsWhatTerminalsSay) {
  EXPECT_EQ(ParseTerminalAnswer(""), TerminalAnswer());
  // xterm with sixel.
  EXPECT_EQ(ParseTerminalAnswer("\x1B[6;18;9t\x1B[?63;1;2;4;6;9;15;22c"),
            (TerminalAnswer{.is_whole = true, .has_sixel = true, .cell = {9, 18}}));
  // kitty.
  EXPECT_EQ(ParseTerminalAnswer("\x1B_Gi=31;OK\x1B\\\x1B[6;20;10t\x1B[?62;c"),
            (TerminalAnswer{.is_whole = true, .has_kitty = true, .cell = {10, 20}}));
  // One that knows the protocol but refuses.
  EXPECT_EQ(ParseTerminalAnswer("\x1B_Gi=31;ENOTSUPPORTED:no\x1B\\\x1B[?62;c"),
            (TerminalAnswer{.is_whole = true}));
  // 4 is a whole number of the list, not a digit of one; 14 and 40 are others.
  EXPECT_FALSE(ParseTerminalAnswer("\x1B[?64;14;40c").has_sixel);
}

TEST(ParseTerminalAnswerTest, IsNotWholeBeforeTheLastByte) {
  const std::string answer = "\x1B[6;18;9t\x1B[?63;4c";
  for (std::size_t size = 0; size < answer.size(); ++size) {
    EXPECT_FALSE(ParseTerminalAnswer(answer.substr(0, size)).is_whole) << size;
  }
}

TEST(ParseTerminalAnswerTest, KeysAndNonsenseAreSkipped) {
  const TerminalAnswer answer =
      ParseTerminalAnswer("qq\x1B[A\x1B[\x1B[6;0;99999999999t\x1B[6;5t\x1B[?1;2cx");
  EXPECT_TRUE(answer.is_whole);
  EXPECT_FALSE(answer.has_sixel);
  EXPECT_EQ(answer.cell, (view::Viewport{0, 0}));
}

struct FormatRow {
  std::map<std::string, std::string> variables;
  TerminalAnswer answer;
  PictureFormat format;
};

std::ostream& operator<<(std::ostream& out, const FormatRow& row) {
  for (const auto& [name, value] : row.variables) {
    out << name << "=" << value << " ";
  }
  return out;
}

TEST(ChooseFormatTest, KnownTerminals) {
  const TerminalAnswer silent;
  const TerminalAnswer plain{.is_whole = true};
  const TerminalAnswer sixel{.is_whole = true, .has_sixel = true};
  const TerminalAnswer kitty{.is_whole = true, .has_kitty = true};
  const TerminalAnswer both{.is_whole = true, .has_kitty = true, .has_sixel = true};
  const std::vector<FormatRow> rows = {
      {{{"TERM", "xterm-kitty"}}, silent, PictureFormat::kKitty},
      {{{"TERM", "xterm-ghostty"}}, silent, PictureFormat::kKitty},
      {{{"TERM", "xterm-256color"}, {"KITTY_WINDOW_ID", "1"}}, silent, PictureFormat::kKitty},
      // Inherited by a terminal that was started from kitty.
      {{{"TERM", "xterm-256color"}, {"KITTY_WINDOW_ID", "1"}}, sixel, PictureFormat::kSixel},
      {{{"TERM", "xterm-256color"}, {"TERM_PROGRAM", "ghostty"}}, silent, PictureFormat::kKitty},
      {{{"TERM", "xterm-256color"}, {"KONSOLE_VERSION", "220401"}}, both, PictureFormat::kKitty},
      {{{"TERM", "xterm-256color"}, {"KONSOLE_VERSION", "211203"}},
       silent,
       PictureFormat::kBlocks256},
      {{{"TERM", "xterm-256color"}, {"TERM_PROGRAM", "iTerm.app"}}, plain, PictureFormat::kITerm2},
      {{{"TERM", "xterm-256color"}, {"LC_TERMINAL", "iTerm2"}}, plain, PictureFormat::kITerm2},
      {{{"TERM", "xterm-256color"}, {"TERM_PROGRAM", "WezTerm"}}, both, PictureFormat::kITerm2},
      {{{"TERM", "xterm-256color"}}, sixel, PictureFormat::kSixel},
      {{{"TERM", "foot"}}, sixel, PictureFormat::kSixel},
      {{{"TERM", "xterm-256color"}}, kitty, PictureFormat::kKitty},
      {{{"TERM", "xterm-256color"}, {"COLORTERM", "truecolor"}},
       plain,
       PictureFormat::kBlocks24Bit},
      {{{"TERM", "xterm-256color"}}, plain, PictureFormat::kBlocks256},
      {{{"TERM", "xterm-direct"}}, silent, PictureFormat::kBlocks24Bit},
      {{{"TERM", "vt220"}}, plain, PictureFormat::kNone},
      {{{"TERM", "linux"}}, sixel, PictureFormat::kBlocks8},
      {{{"TERM", "xterm-16color"}}, plain, PictureFormat::kBlocks16},
      // Inside others: their variables tell nothing of the window.
      {{{"TERM", "tmux-256color"}, {"TMUX", "/tmp/x"}, {"KITTY_WINDOW_ID", "1"}},
       kitty,
       PictureFormat::kBlocks256},
      {{{"TERM", "tmux-256color"}, {"COLORTERM", "truecolor"}}, sixel, PictureFormat::kBlocks24Bit},
      {{{"TERM", "screen"}, {"STY", "1"}, {"COLORTERM", "truecolor"}},
       silent,
       PictureFormat::kBlocks256},
      {{{"TERM", "xterm-kitty"}, {"TMUX", "/tmp/x"}}, kitty, PictureFormat::kBlocks24Bit},
      // No escapes at all.
      {{{"TERM", "dumb"}}, kitty, PictureFormat::kNone},
      {{}, kitty, PictureFormat::kNone},
      {{{"TERM", "xterm-kitty"}, {"NO_COLOR", "1"}}, kitty, PictureFormat::kNone},
  };
  for (const FormatRow& row : rows) {
    EXPECT_EQ(ChooseFormat(Variables(row.variables), row.answer), row.format) << row;
  }
}

TEST(SizeOfTerminalTest, IsUnsetForFilesAndAWindowsElse) {
  int ends[2] = {-1, -1};  // NOLINT(modernize-avoid-c-arrays): pipe
  ASSERT_EQ(pipe(ends), 0);
  EXPECT_FALSE(SizeOfTerminal(ends[1]).has_value());
  close(ends[0]);
  close(ends[1]);
  const testing::PseudoTerminal window({120, 40, 1200, 800});
  EXPECT_EQ(SizeOfTerminal(window.program_fd()), (TerminalSize{120, 40, {1200, 800}}));
  const testing::PseudoTerminal without_pixels({100, 30, 0, 0});
  EXPECT_EQ(SizeOfTerminal(without_pixels.program_fd()), (TerminalSize{100, 30, {0, 0}}));
  const testing::PseudoTerminal unknown({0, 0, 0, 0});
  EXPECT_EQ(SizeOfTerminal(unknown.program_fd()), (TerminalSize{80, 24, {0, 0}}));
}

}  // namespace
}  // namespace isoscope::cli
