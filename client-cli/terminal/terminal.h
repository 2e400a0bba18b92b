// The properties of a terminal: its size, and the kind of pictures that it shows.
//
// If the environment is conclusive, it decides; otherwise the terminal is asked. The last query is
// for the device attributes, which every terminal answers, after queries that only some know. So
// the last answer shows that all have come, and a silent terminal costs one time-out.

#ifndef ISOSCOPE_CLIENT_CLI_TERMINAL_TERMINAL_H_
#define ISOSCOPE_CLIENT_CLI_TERMINAL_TERMINAL_H_

#include <functional>
#include <optional>
#include <string>

#include "absl/strings/string_view.h"
#include "absl/time/time.h"

#include "core/view/camera.h"

namespace isoscope::cli {

enum class PictureFormat {
  kNone,
  kKitty,   // kitty's graphics protocol
  kITerm2,  // inline images
  kSixel,
  kBlocks24Bit,  // half blocks in any colour
  kBlocks256,    // half blocks in the colours of xterm
  kBlocks16,     // half blocks in ANSI's colours and their bright ones
  kBlocks8,      // half blocks in ANSI's colours
};

struct TerminalSize {
  int columns = 80;
  int rows = 24;
  // Size of the whole window in pixels; 0 x 0 if it is not known.
  view::Viewport pixels = {};

  friend bool operator==(const TerminalSize&, const TerminalSize&) = default;
};
// Unset if `fd` is no terminal. A terminal that does not know its size has 80 x 24.
std::optional<TerminalSize> SizeOfTerminal(int fd);

// The value of a variable of the environment, "" if it is not set.
using Environment = std::function<std::string(const char*)>;
std::string ProcessEnvironment(const char* name);

// The answers of a terminal.
struct TerminalAnswer {
  bool is_whole = false;  // the device attributes, which come last, are there
  bool has_kitty = false;
  bool has_sixel = false;
  // Size of a character in pixels; 0 x 0 without an answer.
  view::Viewport cell = {};

  friend bool operator==(const TerminalAnswer&, const TerminalAnswer&) = default;
};
// Parses any bytes: keys that were pressed meanwhile are skipped.
TerminalAnswer ParseTerminalAnswer(absl::string_view bytes);

// Returns the format if the environment is conclusive; unset if the terminal must be asked.
// NO_COLOR and TERM=dumb: no pictures. Inside tmux and screen, which forward pictures only
// sometimes: blocks.
std::optional<PictureFormat> FormatOfEnvironment(const Environment& environment);
// Returns the best format after the terminal was asked. With an incomplete answer the environment
// decides.
PictureFormat ChooseFormat(const Environment& environment, const TerminalAnswer& answer);
// Returns the best kind of blocks; kNone without colours.
PictureFormat BlocksOfEnvironment(const Environment& environment);

// Asks the terminal on `fd`, and restores its settings. Waits for the whole answer, up to
// `timeout`. Asks nothing while another program owns the terminal.
TerminalAnswer AskTerminal(int fd, absl::Duration timeout);
// The time-out for AskTerminal: longer through ssh, where a late answer would look like keys.
absl::Duration AnswerTimeout(const Environment& environment);

struct PictureTerminal {
  PictureFormat format = PictureFormat::kNone;
  TerminalSize size;
};
// Returns the terminal on `fd`, asked through /dev/tty if needed. `wanted`: a format that is used
// whatever the terminal answers. Unset if `fd` is no terminal.
std::optional<PictureTerminal> FindPictureTerminal(int fd, const Environment& environment,
                                                   std::optional<PictureFormat> wanted);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_TERMINAL_TERMINAL_H_
