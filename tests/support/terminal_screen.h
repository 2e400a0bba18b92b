// A terminal that understands what we send: pictures of every kind come back as pixels.

#ifndef ISOSCOPE_TESTS_SUPPORT_TERMINAL_SCREEN_H_
#define ISOSCOPE_TESTS_SUPPORT_TERMINAL_SCREEN_H_

#include <cstddef>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"

#include "core/image/png_codec.h"

namespace isoscope::testing {

struct ShownPicture {
  std::string file;               // of kitty and iTerm2: as it was sent
  std::string keys;               // of those: what stood before the data
  std::size_t longest_chunk = 0;  // of kitty, in characters
  image::RgbaImage sixels;        // of sixel; alpha is 0 where nothing was drawn
  bool keeps_background = false;  // of sixel
};

struct TerminalScreen {
  std::vector<ShownPicture> pictures;
  image::RgbaImage blocks;  // lines of half blocks, two pixels a character
  std::string text;         // everything but the sequences and blocks
};

// Reads a stream of bytes. Sequences that we do not send are skipped.
TerminalScreen ReadTerminalBytes(absl::string_view bytes);

// A colour of xterm's palette. REQUIRES: 16 <= index < 256.
image::Rgba8 XtermColor(int index);

// One of ANSI's eight colours, or of the eight bright ones behind them, as xterm has them.
// REQUIRES: 0 <= index < 16.
image::Rgba8 AnsiColor(int index);

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_TERMINAL_SCREEN_H_
