// What the terminal is like: its size, and which kind of pictures it shows.
//
// The environment decides where it is sure, and the terminal itself is asked where it is not: for
// its device attributes, which every terminal knows, behind what only some know. So one answer
// tells that all have come, and a terminal that is silent costs one time-out.

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
  kBlocks256,    // in those of xterm
};

struct TerminalSize {
  int columns = 80;
  int rows = 24;
  // Of the whole window; 0 x 0 if it is not known.
  view::Viewport pixels = {};

  friend bool operator==(const TerminalSize&, const TerminalSize&) = default;
};
// Unset if `fd` is no terminal. A terminal that does not know its size has 80 x 24.
std::optional<TerminalSize> SizeOfTerminal(int fd);

// The value of a variable of the environment, "" if it is not set.
using Environment = std::function<std::string(const char*)>;
std::string ProcessEnvironment(const char* name);

// What a terminal has said of itself.
struct TerminalAnswer {
  bool is_whole = false;  // the device attributes, which come last, are there
  bool has_kitty = false;
  bool has_sixel = false;
  // Of a character; 0 x 0 if it did not say.
  view::Viewport cell = {};

  friend bool operator==(const TerminalAnswer&, const TerminalAnswer&) = default;
};
// Any bytes: keys that were pressed meanwhile are skipped.
TerminalAnswer ParseTerminalAnswer(absl::string_view bytes);

// What the environment alone tells for sure; unset if the terminal must be asked. NO_COLOR and
// TERM=dumb: no pictures. Inside tmux and screen, which pass pictures on only sometimes: blocks.
std::optional<PictureFormat> FormatOfEnvironment(const Environment& environment);
// The best format, once the terminal was asked. An answer that is not whole leaves it to the
// environment.
PictureFormat ChooseFormat(const Environment& environment, const TerminalAnswer& answer);
// The best blocks; kNone where there are no colours.
PictureFormat BlocksOfEnvironment(const Environment& environment);

// Asks the terminal on `fd`, whose settings are as before afterwards. Waits for the whole answer,
// up to `timeout`. Asks nothing if the terminal belongs to another program just now.
TerminalAnswer AskTerminal(int fd, absl::Duration timeout);
// The time-out for AskTerminal: longer through ssh, where a late answer would look like keys.
absl::Duration AnswerTimeout(const Environment& environment);

struct PictureTerminal {
  PictureFormat format = PictureFormat::kNone;
  TerminalSize size;
};
// The terminal on `fd`, asked through /dev/tty if need be. `wanted`: a format that is used whatever
// the terminal says. Unset if `fd` is no terminal.
std::optional<PictureTerminal> FindPictureTerminal(int fd, const Environment& environment,
                                                   std::optional<PictureFormat> wanted);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_TERMINAL_TERMINAL_H_
