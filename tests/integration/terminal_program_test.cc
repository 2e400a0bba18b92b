// The program on a terminal: what it draws, read back as pixels, and how it leaves the terminal.

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/time/clock.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "core/image/png_codec.h"
#include "core/io/file.h"
#include "tests/integration/cli_fixture.h"
#include "tests/support/pseudo_terminal.h"
#include "tests/support/terminal_screen.h"

namespace isoscope {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::PseudoTerminal;
using testing::PseudoTerminalSize;
using testing::ReadTerminalBytes;
using testing::TerminalScreen;

constexpr PseudoTerminalSize kWindow{.columns = 80, .rows = 24, .width_px = 640, .height_px = 384};
constexpr char kQuestion[] = "\x1B[c";
constexpr char kAnswerWithSixel[] = "\x1B[?62;4c";

class TerminalTest : public CliTest {
 protected:
  void SetUp() override { Partition(gyroid_, "data", 2); }

  [[nodiscard]] std::vector<std::string> Environment(const std::vector<std::string>& more) const {
    std::vector<std::string> variables = {"XDG_CACHE_HOME=" + Path("cache"), "HOME=" + Path("home"),
                                          "PATH=/usr/bin:/bin"};
    variables.insert(variables.end(), more.begin(), more.end());
    return variables;
  }
  [[nodiscard]] std::vector<std::string> Command(const std::vector<std::string>& arguments) const {
    return Join({ISOSCOPE_TEST_PROGRAM}, arguments);
  }
  [[nodiscard]] std::vector<std::string> RenderCommand(const std::vector<std::string>& more) const {
    return Command(Join({"render", Path("data"), "--isovalue", kIsovalue, "--renderer", "cpu",
                         "--width", "160", "--height", "120"},
                        more));
  }
  [[nodiscard]] std::vector<std::string> ViewCommand() const {
    return Command(
        {"view", Path("data"), "--isovalue", kIsovalue, "--renderer", "cpu", "--terminal"});
  }
  image::RgbaImage RenderedPicture(const std::vector<std::string>& flags) {
    const std::string png = Path("reference.png");
    MustRun(Join({"render", Path("data"), "--isovalue", kIsovalue, "--renderer", "cpu",
                  "--no-metadata", "--output", png},
                 flags),
            Options());
    return image::DecodePng(ReadFile(png)).value();
  }
};

bool IsLineMode(const PseudoTerminal& terminal) {
  return (terminal.settings().c_lflag & (ICANON | ECHO)) == (ICANON | ECHO);
}

// The last picture of kitty that is exact, once there is one behind `mark`.
bool HasExact(const std::string& bytes) { return absl::StrContains(bytes, " exact "); }

TEST_F(TerminalTest, RenderShowsThePixelsOfTheFileInKitty) {
  PseudoTerminal terminal(kWindow);
  terminal.Start(RenderCommand({"--output", Path("a.png")}), Environment({"TERM=xterm-kitty"}));
  ASSERT_EQ(terminal.Wait(), 0) << terminal.bytes();
  const TerminalScreen screen = ReadTerminalBytes(terminal.bytes());
  ASSERT_EQ(screen.pictures.size(), 1);
  // Smaller than the window: not a pixel is touched.
  EXPECT_EQ(image::DecodePng(screen.pictures[0].file).value(),
            image::DecodePng(ReadFile(Path("a.png"))).value());
  EXPECT_THAT(screen.text, HasSubstr("a.png: 160 x 120 pixels"));
  EXPECT_TRUE(IsLineMode(terminal));
}

TEST_F(TerminalTest, RenderNeedsNoFileOnATerminalAndAsksWhatThatCan) {
  PseudoTerminal terminal(kWindow);
  terminal.Start(RenderCommand({}), Environment({"TERM=xterm-256color"}));
  ASSERT_TRUE(terminal.ReadUntilText(kQuestion));
  terminal.Press(kAnswerWithSixel);
  ASSERT_EQ(terminal.Wait(), 0) << terminal.bytes();
  const TerminalScreen screen = ReadTerminalBytes(terminal.bytes());
  ASSERT_EQ(screen.pictures.size(), 1);
  const image::RgbaImage& shown = screen.pictures[0].sixels;
  const image::RgbaImage rendered = RenderedPicture({"--width", "160", "--height", "120"});
  ASSERT_EQ(shown.width, rendered.width);
  ASSERT_EQ(shown.height, rendered.height);
  // 256 colours by error diffusion: true in the mean.
  double difference = 0;
  for (std::size_t i = 0; i < shown.pixels.size(); ++i) {
    difference += shown.pixels[i].g - rendered.pixels[i].g;
  }
  EXPECT_LT(std::abs(difference) / static_cast<double>(shown.pixels.size()), 2);
  EXPECT_TRUE(IsLineMode(terminal));
}

TEST_F(TerminalTest, ASilentTerminalGetsBlocks) {
  PseudoTerminal terminal(kWindow);
  terminal.Start(RenderCommand({"--quiet"}), Environment({"TERM=xterm", "COLORTERM=truecolor"}));
  ASSERT_EQ(terminal.Wait(), 0) << terminal.bytes();
  const TerminalScreen screen = ReadTerminalBytes(terminal.bytes());
  EXPECT_EQ(screen.pictures.size(), 0);
  // 20 rows of half blocks, 160 : 120.
  EXPECT_EQ(screen.blocks.width, 53);
}

// Symptom: with 256 colours a smooth surface fell into patches.
TEST_F(TerminalTest, BlocksOf256ColoursAreTrueInTheMean) {
  const auto shown_with = [&](const std::vector<std::string>& variables) {
    PseudoTerminal terminal(kWindow);
    terminal.Start(RenderCommand({"--quiet", "--show", "blocks"}), Environment(variables));
    EXPECT_EQ(terminal.Wait(), 0) << terminal.bytes();
    return ReadTerminalBytes(terminal.bytes()).blocks;
  };
  const image::RgbaImage exact = shown_with({"TERM=xterm", "COLORTERM=truecolor"});
  const image::RgbaImage dithered = shown_with({"TERM=xterm-256color"});
  ASSERT_EQ(exact.width, dithered.width);
  ASSERT_EQ(exact.height, dithered.height);
  ASSERT_FALSE(exact.pixels.empty());
  double difference = 0;
  for (std::size_t i = 0; i < exact.pixels.size(); ++i) {
    difference += dithered.pixels[i].g - exact.pixels[i].g;
  }
  EXPECT_LT(std::abs(difference) / static_cast<double>(exact.pixels.size()), 3);
  EXPECT_EQ(shown_with({"TERM=xterm-256color"}), dithered) << "the same bytes every time";
}

TEST_F(TerminalTest, HelpKeepsToTheWidthOfTheWindow) {
  for (const int columns : {60, 100}) {
    PseudoTerminal terminal({.columns = columns, .rows = 24, .width_px = 0, .height_px = 0});
    terminal.Start(Command({"render", "--help"}), Environment({"TERM=xterm"}));
    ASSERT_EQ(terminal.Wait(), 0) << terminal.bytes();
    const std::string text = terminal.bytes().substr(0, terminal.bytes().find("Examples:"));
    std::size_t longest = 0;
    for (const absl::string_view line : absl::StrSplit(text, absl::ByAnyChar("\r\n"))) {
      // The values of --color-by are one word, longer than 60 characters.
      longest =
          absl::StrContains(line, "--color-by x|y|z") ? longest : std::max(longest, line.size());
    }
    EXPECT_LE(longest, static_cast<std::size_t>(columns));
    EXPECT_GT(longest, static_cast<std::size_t>(columns) / 2);
  }
}

TEST_F(TerminalTest, NoEscapesWithoutColoursOrATerminal) {
  const std::vector<std::vector<std::string>> plain = {{"TERM=dumb"},
                                                       {"TERM=xterm-kitty", "NO_COLOR=1"}};
  for (const std::vector<std::string>& variables : plain) {
    PseudoTerminal terminal(kWindow);
    terminal.Start(RenderCommand({"--output", Path("a.png")}), Environment(variables));
    ASSERT_EQ(terminal.Wait(), 0) << terminal.bytes();
    EXPECT_TRUE(ReadTerminalBytes(terminal.bytes()).pictures.empty()) << variables[0];
  }
  PseudoTerminal terminal(kWindow);
  terminal.Start(RenderCommand({"--output", Path("a.png"), "--show", "never"}),
                 Environment({"TERM=xterm-kitty"}));
  ASSERT_EQ(terminal.Wait(), 0) << terminal.bytes();
  EXPECT_THAT(terminal.bytes(), Not(HasSubstr("\x1B_G")));
  const std::string piped = MustRun({"render", Path("data"), "--isovalue", kIsovalue, "--output",
                                     Path("a.png"), "--width", "16", "--height", "16"},
                                    Options());
  EXPECT_THAT(piped, Not(HasSubstr("\x1B")));
}

TEST_F(TerminalTest, AFormatGoesToAFileAndTheTextBesideIt) {
  const testing::CommandResult result =
      testing::RunIsoscope({"render", Path("data"), "--isovalue", kIsovalue, "--renderer", "cpu",
                            "--width", "200", "--height", "100", "--show", "kitty"},
                           Options());
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const TerminalScreen screen = ReadTerminalBytes(result.out);
  ASSERT_EQ(screen.pictures.size(), 1);
  EXPECT_EQ(image::DecodePng(screen.pictures[0].file).value(),
            RenderedPicture({"--width", "200", "--height", "100"}));
  EXPECT_EQ(screen.text, "\n");
  EXPECT_THAT(result.err, HasSubstr("200 x 100 pixels"));
}

TEST_F(TerminalTest, ViewDrawsTheExactFrameAndSaysItsFlags) {
  PseudoTerminal terminal(kWindow);
  terminal.Start(ViewCommand(), Environment({"TERM=xterm-kitty"}));
  ASSERT_TRUE(terminal.ReadUntil(HasExact));
  EXPECT_FALSE(IsLineMode(terminal));
  EXPECT_THAT(terminal.bytes(), HasSubstr("\x1B[?1049h"));
  terminal.Forget();
  terminal.Press("\x1B[C\x1B[Al]+");
  ASSERT_TRUE(terminal.ReadUntil(HasExact));
  terminal.Press("q");
  ASSERT_EQ(terminal.Wait(), 0) << terminal.bytes();
  EXPECT_TRUE(IsLineMode(terminal));
  EXPECT_THAT(terminal.bytes(), HasSubstr("\x1B[?25h\x1B[?1049l"));
  const std::size_t said = terminal.bytes().find("isoscope render: ");
  ASSERT_NE(said, std::string::npos);
  const std::string line = terminal.bytes().substr(said + 17);
  std::vector<std::string> flags = absl::StrSplit(line.substr(0, line.find_first_of("\r\n")), ' ');
  ASSERT_EQ(flags[0], "--isovalue");
  EXPECT_NE(flags[1], kIsovalue);
  const TerminalScreen screen = ReadTerminalBytes(terminal.bytes());
  ASSERT_FALSE(screen.pictures.empty());
  const std::string png = Path("again.png");
  MustRun(
      Join({"render", Path("data"), "--renderer", "cpu", "--no-metadata", "--output", png}, flags),
      Options());
  EXPECT_EQ(screen.pictures.back().file, ReadFile(png)) << "the same bytes as render's";
}

TEST_F(TerminalTest, ASegmentationOpensAsLabelsWhichKeysShowAloneHideAndHighlight) {
  MustRun({"generate", "labels", "--dims", "32,32,32", "--regions", "3", "--output",
           Path("labels.nrrd")},
          Options());
  PseudoTerminal terminal(kWindow);
  terminal.Start(Command({"view", Path("labels.nrrd"), "--renderer", "cpu", "--terminal"}),
                 Environment({"TERM=xterm-kitty"}));
  ASSERT_TRUE(terminal.ReadUntil(HasExact));
  EXPECT_THAT(terminal.bytes(), HasSubstr("3 labels"));
  const auto all = ReadTerminalBytes(terminal.bytes()).pictures.back().file;
  terminal.Forget();
  terminal.Press("nn");
  ASSERT_TRUE(terminal.ReadUntil([](const std::string& bytes) {
    return absl::StrContains(bytes, "(2 of 3)") && HasExact(bytes);
  }));
  // Hidden, and the next one highlighted before the one that is left.
  terminal.Forget();
  terminal.Press("x");
  ASSERT_TRUE(terminal.ReadUntil([](const std::string& bytes) {
    return absl::StrContains(bytes, "2 of 3 labels") && HasExact(bytes);
  }));
  terminal.Forget();
  terminal.Press("d");
  ASSERT_TRUE(terminal.ReadUntil([](const std::string& bytes) {
    return absl::StrContains(bytes, "(3 of 3) highlighted") && HasExact(bytes);
  }));
  terminal.Press("q");
  ASSERT_EQ(terminal.Wait(), 0) << terminal.bytes();
  const TerminalScreen screen = ReadTerminalBytes(terminal.bytes());
  ASSERT_FALSE(screen.pictures.empty());
  EXPECT_NE(screen.pictures.back().file, all);
  const std::size_t said = terminal.bytes().find("isoscope render: ");
  ASSERT_NE(said, std::string::npos);
  const std::string line = terminal.bytes().substr(said + 17);
  const std::vector<std::string> flags =
      absl::StrSplit(line.substr(0, line.find_first_of("\r\n")), ' ');
  EXPECT_EQ(flags[0], "--label");
  EXPECT_THAT(line, HasSubstr(":0.150000006 --label "));
  const std::string png = Path("again.png");
  MustRun(
      Join({"render", Path("labels.nrrd"), "--renderer", "cpu", "--no-metadata", "--output", png},
           flags),
      Options());
  EXPECT_EQ(screen.pictures.back().file, ReadFile(png)) << "the same bytes as render's";
}

TEST_F(TerminalTest, SignalsGiveTheTerminalBack) {
  for (const int number : {SIGINT, SIGTERM, SIGQUIT, SIGHUP}) {
    PseudoTerminal terminal(kWindow);
    terminal.Start(ViewCommand(), Environment({"TERM=xterm-kitty"}));
    ASSERT_TRUE(terminal.ReadUntil(HasExact));
    if (number == SIGINT) {
      terminal.Press("\x03");  // as the user does
    } else {
      kill(terminal.pid(), number);
    }
    const int code = terminal.Wait();
    EXPECT_EQ(code, number == SIGINT || number == SIGTERM ? 0 : 128 + number);
    EXPECT_TRUE(IsLineMode(terminal)) << number;
    EXPECT_THAT(terminal.bytes(), HasSubstr("\x1B[?25h\x1B[?1049l")) << number;
  }
}

TEST_F(TerminalTest, ANewSizeOfTheWindowIsANewPicture) {
  PseudoTerminal terminal(kWindow);
  terminal.Start(ViewCommand(), Environment({"TERM=xterm-kitty"}));
  ASSERT_TRUE(terminal.ReadUntil(HasExact));
  EXPECT_THAT(terminal.bytes(), HasSubstr("640 x 368 exact"));
  terminal.Forget();
  terminal.Resize({.columns = 40, .rows = 12, .width_px = 320, .height_px = 192});
  ASSERT_TRUE(terminal.ReadUntilText("320 x 176 exact"));
  terminal.Press("q");
  EXPECT_EQ(terminal.Wait(), 0);
}

TEST_F(TerminalTest, CtrlZStopsWithTheTerminalInOrderAndGoesOnWhereItWas) {
  PseudoTerminal terminal(kWindow);
  // A shell with job control, which answers when it has the terminal back.
  terminal.Start({"/bin/bash", "--norc", "-i"}, Environment({"TERM=xterm-kitty", "PS1=ready> "}));
  ASSERT_TRUE(terminal.ReadUntilText("ready> "));
  std::string line;
  for (const std::string& word : ViewCommand()) {
    line += word + " ";
  }
  terminal.Press(line + "\n");
  ASSERT_TRUE(terminal.ReadUntil(HasExact));
  terminal.Forget();
  terminal.Press("\x1A");
  ASSERT_TRUE(terminal.ReadUntilText("Stopped"));
  EXPECT_THAT(terminal.bytes(), HasSubstr("\x1B[?25h\x1B[?1049l"));
  terminal.Forget();
  terminal.Press("fg\n");
  ASSERT_TRUE(terminal.ReadUntil([](const std::string& bytes) {
    return absl::StrContains(bytes, "\x1B[?1049h") && HasExact(bytes);
  }));
  terminal.Forget();
  terminal.Press("q");
  ASSERT_TRUE(terminal.ReadUntilText("ready> "));
  terminal.Press("exit\n");
  EXPECT_EQ(terminal.Wait(), 0);
}

TEST_F(TerminalTest, ViewInBlocksShowsHelpAndMoves) {
  PseudoTerminal terminal({.columns = 60, .rows = 20, .width_px = 0, .height_px = 0});
  terminal.Start(ViewCommand(), Environment({"TERM=xterm-256color", "TMUX=x"}));
  ASSERT_TRUE(terminal.ReadUntil(HasExact));
  EXPECT_EQ(ReadTerminalBytes(terminal.bytes()).pictures.size(), 0);
  EXPECT_LE(ReadTerminalBytes(terminal.bytes()).blocks.width, 60);
  terminal.Forget();
  terminal.Press("?");
  ASSERT_TRUE(terminal.ReadUntilText("lower, raise the isovalue"));
  terminal.Forget();
  terminal.Press("x");
  ASSERT_TRUE(terminal.ReadUntil(HasExact));
  terminal.Press("q");
  EXPECT_EQ(terminal.Wait(), 0);
}

TEST_F(TerminalTest, ViewWithoutATerminalSaysSo) {
  const testing::CommandResult result = testing::RunIsoscope(
      {"view", Path("data"), "--isovalue", kIsovalue, "--terminal", "--show", "never"}, Options());
  EXPECT_EQ(result.exit_code, 2);
  PseudoTerminal terminal(kWindow);
  terminal.Start(ViewCommand(), Environment({"TERM=dumb"}));
  EXPECT_EQ(terminal.Wait(), 1);
  EXPECT_THAT(terminal.bytes(), HasSubstr("this terminal shows no pictures"));
}

TEST_F(TerminalTest, TheBrowserGetsTheTokenByAFileThatOnlyItsOwnerReads) {
  // A desktop whose browser tells what it was given.
  std::filesystem::create_directory(Path("bin"));
  std::filesystem::create_directory(Path("tmp"));
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(
      Path("bin/xdg-open"), absl::StrCat("#!/bin/sh\nexec > '", Path("opened"),
                                         ".part'\n"
                                         "stat -c 'modes %a' \"$1\" \"${1%/*}\"\n"
                                         "echo arguments \"$@\"\n"
                                         "cat \"$1\"\n"
                                         "mv '",
                                         Path("opened"), ".part' '", Path("opened"), "'\n")));
  std::filesystem::permissions(Path("bin/xdg-open"), std::filesystem::perms::owner_all);
  PseudoTerminal terminal(kWindow);
  terminal.Start(Command({"view", Path("data"), "--isovalue", kIsovalue, "--renderer", "cpu",
                          "--listen", "127.0.0.1:0"}),
                 {"XDG_CACHE_HOME=" + Path("cache"), "HOME=" + Path("home"), "TERM=xterm",
                  "DISPLAY=:0", "TMPDIR=" + Path("tmp"), "PATH=" + Path("bin") + ":/usr/bin:/bin"});
  const base::MonotonicTime deadline = base::MonotonicNow() + testing::kPatience;
  while (!std::filesystem::exists(Path("opened")) && base::MonotonicNow() < deadline) {
    absl::SleepFor(absl::Milliseconds(10));
  }
  const std::string opened = ReadFile(Path("opened"));
  const std::vector<std::string> lines = absl::StrSplit(opened, '\n');
  ASSERT_GT(lines.size(), 3U) << opened;
  EXPECT_EQ(lines[0], "modes 600");
  EXPECT_EQ(lines[1], "modes 700");
  EXPECT_THAT(lines[2], ::testing::StartsWith("arguments " + Path("tmp") + "/isoscope-"));
  EXPECT_THAT(lines[2], Not(HasSubstr("token")));
  EXPECT_THAT(opened, HasSubstr("url=http://127.0.0.1:"));
  ASSERT_TRUE(terminal.ReadUntilText("until Ctrl-C"));
  const std::size_t begin = terminal.bytes().find("?token=");
  ASSERT_NE(begin, std::string::npos) << terminal.bytes();
  const std::string token = terminal.bytes().substr(begin + 7, 32);
  EXPECT_THAT(opened, HasSubstr("?token=" + token + "&amp;dataset=data"));
  std::ifstream command_line(absl::StrCat("/proc/", terminal.pid(), "/cmdline"));
  const std::string words{std::istreambuf_iterator<char>(command_line), {}};
  EXPECT_THAT(words, AllOf(HasSubstr("view"), Not(HasSubstr(token))));
  terminal.Press("\x03");
  EXPECT_EQ(terminal.Wait(), 0) << terminal.bytes();
  EXPECT_TRUE(std::filesystem::is_empty(Path("tmp"))) << "the file is still there";
}

TEST_F(TerminalTest, AServerThatGoesAwayEndsTheViewWithTheTerminalInOrder) {
  absl::StatusOr<std::unique_ptr<testing::Process>> server = testing::Process::Start(
      Command({"serve", Path("data"), "--listen", "127.0.0.1:0", "--renderer", "cpu"}), Options());
  ISOSCOPE_ASSERT_OK(server);
  const absl::StatusOr<std::string> address = (*server)->WaitForOutLine("127.0.0.1:");
  ISOSCOPE_ASSERT_OK(address);
  const std::size_t begin = address->find("127.0.0.1:");
  const std::string host_port =
      address->substr(begin, address->find_first_not_of("0123456789.:", begin) - begin);
  PseudoTerminal terminal(kWindow);
  terminal.Start(Command({"view", "--server", host_port, "--isovalue", kIsovalue, "--terminal"}),
                 Environment({"TERM=xterm-kitty"}));
  ASSERT_TRUE(terminal.ReadUntil(HasExact));
  (*server)->Kill();
  EXPECT_EQ(terminal.Wait(), 1);
  EXPECT_TRUE(IsLineMode(terminal));
  EXPECT_THAT(terminal.bytes(), HasSubstr("isoscope: "));
}

}  // namespace
}  // namespace isoscope
