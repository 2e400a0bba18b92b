// `render --show`: the picture in the terminal, as large as possible.

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
// Returns true for modes that name a format; they apply to any standard output.
bool IsFormat(ShowMode mode);
// Returns true for the formats of half blocks.
bool IsBlocks(PictureFormat format);
// REQUIRES: IsBlocks(format).
BlockColors ColorsOfBlocks(PictureFormat format);
// Returns the requested format; blocks use the colours of the environment. Unset for kAuto and
// kNever.
std::optional<PictureFormat> FormatOf(ShowMode mode, const Environment& environment);

// Encodes a picture for an area of a terminal. Thread-compatible.
class PictureDisplay {
 public:
  // `terminal`: unset if the bytes go to a file. Then pictures keep their size, and blocks have 80
  // columns.
  PictureDisplay(PictureFormat format, const std::optional<TerminalSize>& terminal);

  // Returns the display for standard output. kNone if nothing shall be shown there.
  static PictureDisplay ForStandardOutput(ShowMode mode, const Context& context);

  [[nodiscard]] bool is_on() const { return format_ != PictureFormat::kNone; }
  // Returns the size at which a picture of `size` is shown, in pixels; for half blocks, in blocks.
  [[nodiscard]] view::Viewport SizeOf(const view::Viewport& size) const;
  // Returns the bytes of a picture that has the size of SizeOf, and a line feed. Errors of
  // SixelPicture. REQUIRES: is_on().
  [[nodiscard]] absl::StatusOr<std::string> Encode(const image::RgbaImage& picture) const;

 private:
  // Returns the cells of a picture in a terminal that does not report its pixels.
  [[nodiscard]] CellBox BoxOf(const image::RgbaImage& picture) const;

  PictureFormat format_;
  std::optional<TerminalSize> terminal_;
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_TERMINAL_SHOW_PICTURE_H_
