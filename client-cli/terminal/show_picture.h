// `render --show`: the picture in the terminal, as large as fits.

#ifndef ISOSCOPE_CLIENT_CLI_TERMINAL_SHOW_PICTURE_H_
#define ISOSCOPE_CLIENT_CLI_TERMINAL_SHOW_PICTURE_H_

#include <optional>
#include <string>

#include "absl/status/statusor.h"

#include "client-cli/terminal/terminal.h"
#include "client-cli/terminal/terminal_picture.h"
#include "core/cli/command.h"
#include "core/cli/flag_set.h"
#include "core/image/png_codec.h"
#include "core/view/camera.h"

namespace isoscope::cli {

enum class ShowMode { kAuto, kNever, kKitty, kITerm2, kSixel, kBlocks };

// Registers --show; `mode` must outlive the parsing.
void AddShowFlag(FlagSet* set, std::optional<ShowMode>* mode, const std::string& help);
// True for the formats, which are shown whatever standard output is.
bool IsFormat(ShowMode mode);
// The format that was asked for; blocks in the colours of the environment. Unset for kAuto and
// kNever.
std::optional<PictureFormat> FormatOf(ShowMode mode, const Environment& environment);

// A picture for a place in a terminal. Thread-compatible.
class PictureDisplay {
 public:
  // `terminal`: unset if the bytes go to a file; pictures then keep their size, blocks have 80
  // columns.
  PictureDisplay(PictureFormat format, const std::optional<TerminalSize>& terminal);

  // For standard output. kNone if nothing is to be shown there.
  static PictureDisplay ForStandardOutput(ShowMode mode, const Context& context);

  [[nodiscard]] bool is_on() const { return format_ != PictureFormat::kNone; }
  // The size that a picture of `size` is shown with, in pixels; of half blocks, in theirs.
  [[nodiscard]] view::Viewport SizeOf(const view::Viewport& size) const;
  // The bytes of a picture that has the size of SizeOf, with the end of the line behind them.
  // Errors of SixelPicture. REQUIRES: is_on().
  [[nodiscard]] absl::StatusOr<std::string> Encode(const image::RgbaImage& picture) const;

 private:
  [[nodiscard]] bool is_blocks() const {
    return format_ == PictureFormat::kBlocks24Bit || format_ == PictureFormat::kBlocks256;
  }
  // Where a terminal that does not tell its pixels shows a picture.
  [[nodiscard]] CellBox BoxOf(const image::RgbaImage& picture) const;

  PictureFormat format_;
  std::optional<TerminalSize> terminal_;
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_TERMINAL_SHOW_PICTURE_H_
