// Where the terminal viewer draws, and a frame as the bytes that draw it there.

#ifndef ISOSCOPE_CLIENT_CLI_TERMINAL_VIEWER_LAYOUT_H_
#define ISOSCOPE_CLIENT_CLI_TERMINAL_VIEWER_LAYOUT_H_

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "client-cli/terminal/terminal.h"
#include "client-cli/terminal/terminal_picture.h"
#include "core/view/view.h"
#include "isoscope/v1/interact_service.pb.h"

namespace isoscope::cli {

// The size of a character; a usual one if the terminal does not tell its pixels.
view::Viewport CellOf(const TerminalSize& terminal);

// The layout of the window: the picture takes all rows but the last, which describes the view.
struct ViewerLayout {
  PictureFormat format = PictureFormat::kNone;
  TerminalSize terminal;
  CellBox box;              // of the picture
  view::Viewport viewport;  // size of the requested pictures
};
// Pictures have the pixels of the window, up to a limit that keeps them fast. For half blocks they
// have up to four times as many, so that edges are smooth.
ViewerLayout LayoutOf(PictureFormat format, const TerminalSize& terminal);

// What the last row says: `shown`, then `message`, or `figures` if that is empty, and the keys at
// the right where there is room. A long message stands without `shown`. Of figures, which have three
// spaces between them, the last ones are left out first. What is cut ends with "...". Exactly
// `columns` characters, without terminal commands, whatever the texts have.
std::string StatusText(absl::string_view shown, absl::string_view message,
                       absl::string_view figures, int columns);

// Returns the bytes that draw a frame of any size at the upper left corner. `image_number`: for
// kitty. Errors of decoding and of SixelPicture.
absl::StatusOr<std::string> DrawFrame(const ViewerLayout& layout,
                                      const isoscope::v1::InteractResponse& response,
                                      int image_number);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_TERMINAL_VIEWER_LAYOUT_H_
