// The queries, in one write:
//
//   APC G i=31,a=q,...  kitty: does it support the graphics protocol? Answer: APC G i=31;OK
//   CSI 16 t            xterm: size of a character? Answer: CSI 6 ; height ; width t
//   CSI c               DEC: device attributes? Answer: CSI ? 62 ; 4 ; ... c, where 4 is sixel

#include "client-cli/terminal/terminal.h"

#include <fcntl.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_split.h"
#include <sys/ioctl.h>

#include "client-cli/terminal/raw_terminal.h"
#include "core/base/monotonic_time.h"

namespace isoscope::cli {
namespace {

constexpr char kQuestions[] = "\x1B_Gi=31,s=1,v=1,a=q,t=d,f=24;AAAA\x1B\\\x1B[16t\x1B[c";
// No terminal answers with more bytes: longer input is not an answer.
constexpr std::size_t kMaxAnswerBytes = 4096;
// Konsole 22.04 is the first version with kitty's graphics protocol.
constexpr int kKonsoleWithKitty = 220400;

bool IsSet(const Environment& environment, const char* name) { return !environment(name).empty(); }

// Returns true inside terminal multiplexers, whose variables describe the outer terminal.
bool IsMultiplexed(const Environment& environment) {
  const std::string term = environment("TERM");
  return IsSet(environment, "TMUX") || IsSet(environment, "STY") ||
         absl::StartsWith(term, "tmux") || absl::StartsWith(term, "screen");
}

// Variables that shells in another terminal may have inherited.
bool SeemsToBeKitty(const Environment& environment) {
  std::int64_t konsole = 0;
  return IsSet(environment, "KITTY_WINDOW_ID") ||
         absl::EqualsIgnoreCase(environment("TERM_PROGRAM"), "ghostty") ||
         (absl::SimpleAtoi(environment("KONSOLE_VERSION"), &konsole) &&
          konsole >= kKonsoleWithKitty);
}

bool IsITerm2(const Environment& environment) {
  const std::string program = environment("TERM_PROGRAM");
  return program == "iTerm.app" || program == "WezTerm" || environment("LC_TERMINAL") == "iTerm2";
}

// Reads "a;b;c" of a control sequence.
std::vector<int> Numbers(absl::string_view text) {
  std::vector<int> numbers;
  for (const absl::string_view part : absl::StrSplit(text, ';')) {
    int number = -1;
    numbers.push_back(absl::SimpleAtoi(part, &number) ? number : -1);
  }
  return numbers;
}

// Reads one control sequence: "CSI `parameters` `final`".
void ReadSequence(absl::string_view parameters, char final_byte, TerminalAnswer* answer) {
  if (final_byte == 'c' && absl::StartsWith(parameters, "?")) {
    answer->is_whole = true;
    for (const int attribute : Numbers(parameters.substr(1))) {
      answer->has_sixel = answer->has_sixel || attribute == 4;
    }
  } else if (final_byte == 't') {
    const std::vector<int> numbers = Numbers(parameters);
    constexpr int kMaxCell = 1000;
    if (numbers.size() == 3 && numbers[0] == 6 && numbers[1] > 0 && numbers[1] <= kMaxCell &&
        numbers[2] > 0 && numbers[2] <= kMaxCell) {
      answer->cell = {.width_px = numbers[2], .height_px = numbers[1]};
    }
  }
}

int OpenTerminal() { return open("/dev/tty", O_RDWR | O_NOCTTY | O_CLOEXEC); }

}  // namespace

std::optional<TerminalSize> SizeOfTerminal(int fd) {
  if (isatty(fd) != 1) {
    return std::nullopt;
  }
  TerminalSize size;
  winsize window{};
  if (ioctl(fd, TIOCGWINSZ, &window) == 0 && window.ws_col > 0 && window.ws_row > 0) {
    size = {.columns = window.ws_col,
            .rows = window.ws_row,
            .pixels = {.width_px = window.ws_xpixel, .height_px = window.ws_ypixel}};
    if (size.pixels.width_px < size.columns || size.pixels.height_px < size.rows) {
      size.pixels = {};
    }
  }
  return size;
}

std::string ProcessEnvironment(const char* name) {
  // NOLINTNEXTLINE(concurrency-mt-unsafe): nobody sets the environment
  const char* const value = getenv(name);
  return value != nullptr ? value : "";
}

TerminalAnswer ParseTerminalAnswer(absl::string_view bytes) {
  TerminalAnswer answer;
  answer.has_kitty = absl::StrContains(bytes, "\x1B_Gi=31;OK");
  std::size_t begin = bytes.find("\x1B[");
  while (begin != absl::string_view::npos) {
    const absl::string_view rest = bytes.substr(begin + 2);
    const std::size_t length = rest.find_first_not_of("0123456789;?");
    if (length == absl::string_view::npos) {
      break;
    }
    ReadSequence(rest.substr(0, length), rest[length], &answer);
    begin = bytes.find("\x1B[", begin + 2);
  }
  return answer;
}

PictureFormat BlocksOfEnvironment(const Environment& environment) {
  const std::string term = environment("TERM");
  const std::string colors = environment("COLORTERM");
  if (term.empty() || term == "dumb" || absl::StartsWith(term, "vt")) {
    return PictureFormat::kNone;
  }
  const bool has_all_colors =
      absl::StrContains(colors, "truecolor") || absl::StrContains(colors, "24bit") ||
      absl::EndsWith(term, "-direct") || absl::StartsWith(term, "xterm-kitty") ||
      absl::StartsWith(term, "xterm-ghostty");
  // Screen shows other colours wrongly.
  const bool is_screen = IsSet(environment, "STY");
  if (has_all_colors && !is_screen) {
    return PictureFormat::kBlocks24Bit;
  }
  return term == "linux" || term == "ansi"  ? PictureFormat::kBlocks8
         : absl::EndsWith(term, "-16color") ? PictureFormat::kBlocks16
                                            : PictureFormat::kBlocks256;
}

std::optional<PictureFormat> FormatOfEnvironment(const Environment& environment) {
  const std::string term = environment("TERM");
  if (IsSet(environment, "NO_COLOR") || term.empty() || term == "dumb") {
    return PictureFormat::kNone;
  }
  // The Linux console prints queries that it does not know.
  if (IsMultiplexed(environment) || term == "linux") {
    return BlocksOfEnvironment(environment);
  }
  // The terminal itself sets TERM, through ssh too.
  if (term == "xterm-kitty" || term == "xterm-ghostty") {
    return PictureFormat::kKitty;
  }
  return std::nullopt;
}

PictureFormat ChooseFormat(const Environment& environment, const TerminalAnswer& answer) {
  if (const std::optional<PictureFormat> sure = FormatOfEnvironment(environment)) {
    return *sure;
  }
  if (IsITerm2(environment)) {
    return PictureFormat::kITerm2;
  }
  if (answer.has_kitty || (!answer.is_whole && SeemsToBeKitty(environment))) {
    return PictureFormat::kKitty;
  }
  return answer.has_sixel ? PictureFormat::kSixel : BlocksOfEnvironment(environment);
}

TerminalAnswer AskTerminal(int fd, absl::Duration timeout) {
  const absl::StatusOr<std::unique_ptr<RawTerminal>> raw = RawTerminal::Enter(fd, kQuestions, "");
  if (!raw.ok()) {
    return {};
  }
  const base::MonotonicTime deadline = base::MonotonicNow() + timeout;
  std::string bytes;
  TerminalAnswer answer;
  while (!answer.is_whole && bytes.size() < kMaxAnswerBytes) {
    const absl::StatusOr<std::string> more = ReadFromTerminal(fd, deadline - base::MonotonicNow());
    if (!more.ok() || more->empty()) {
      break;
    }
    bytes += *more;
    answer = ParseTerminalAnswer(bytes);
  }
  return answer;
}

absl::Duration AnswerTimeout(const Environment& environment) {
  return IsSet(environment, "SSH_CONNECTION") || IsSet(environment, "SSH_TTY")
             ? absl::Seconds(1)
             : absl::Milliseconds(200);
}

std::optional<PictureTerminal> FindPictureTerminal(int fd, const Environment& environment,
                                                   std::optional<PictureFormat> wanted) {
  const std::optional<TerminalSize> size = SizeOfTerminal(fd);
  if (!size) {
    return std::nullopt;
  }
  PictureTerminal terminal{.format = wanted.value_or(PictureFormat::kNone), .size = *size};
  const std::optional<PictureFormat> sure = wanted ? wanted : FormatOfEnvironment(environment);
  const bool needs_pixels = sure == PictureFormat::kSixel || sure == PictureFormat::kKitty ||
                            sure == PictureFormat::kITerm2;
  TerminalAnswer answer;
  if (!sure || (needs_pixels && size->pixels.width_px == 0)) {
    if (const int tty = OpenTerminal(); tty >= 0) {
      answer = AskTerminal(tty, AnswerTimeout(environment));
      close(tty);
    }
  }
  if (!wanted) {
    terminal.format = ChooseFormat(environment, answer);
  }
  if (terminal.size.pixels.width_px == 0 && answer.cell.width_px > 0) {
    terminal.size.pixels = {.width_px = answer.cell.width_px * terminal.size.columns,
                            .height_px = answer.cell.height_px * terminal.size.rows};
  }
  return terminal;
}

}  // namespace isoscope::cli
