// `isoscope view --terminal`: a surface in the terminal, turned with the keys.

#ifndef ISOSCOPE_CLIENT_CLI_TERMINAL_TERMINAL_VIEWER_H_
#define ISOSCOPE_CLIENT_CLI_TERMINAL_TERMINAL_VIEWER_H_

#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "client-cli/session/session.h"
#include "client-cli/terminal/show_picture.h"
#include "client-cli/terminal/terminal.h"
#include "core/cli/command.h"
#include "core/view/camera.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/interact_service.pb.h"

namespace isoscope::cli {

// Where the picture is: all rows of the window but the last, which says what is seen.
struct ViewerLayout {
  PictureFormat format = PictureFormat::kNone;
  TerminalSize terminal;
  CellBox box;              // of the picture
  view::Viewport viewport;  // what is asked for
};
// Pictures have the pixels of the window, up to a limit that keeps them fast; for half blocks up to
// four times as many, so that edges are smooth.
ViewerLayout LayoutOf(PictureFormat format, const TerminalSize& terminal);

// The bytes that draw a frame at the left upper corner, whatever its size. `image_number`: for
// kitty. Errors of decoding and of SixelPicture.
absl::StatusOr<std::string> DrawFrame(const ViewerLayout& layout,
                                      const isoscope::v1::InteractResponse& response,
                                      int image_number);

// The flags of `render` that make the frame again, bit for bit.
std::string FlagsOfFrame(const isoscope::v1::RenderIsosurfaceRequest& frame);

// When the states of a stream were sent, by sequence number. A frame answers a state that is older
// than the newest one as long as the view moves. Thread-compatible.
class SentStates {
 public:
  void Add(std::int64_t sequence_number, absl::Time sent);
  // The time from the state that a frame answers until `now`; nullopt if that state is not known.
  // States before it are forgotten: no later frame answers them.
  std::optional<absl::Duration> TakeLatency(std::int64_t sequence_number, absl::Time now);

 private:
  std::map<std::int64_t, absl::Time> sent_;  // at most kMaxStates
};

// Shows the dataset on the terminal of this process until q or Ctrl-C, and gives the terminal back.
// FAILED_PRECONDITION if there is none, or one without pictures; errors of the Interact stream.
absl::Status RunTerminalViewer(const isoscope::v1::Dataset& dataset, double isovalue, ShowMode mode,
                               Session* session, const Context& context);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_TERMINAL_TERMINAL_VIEWER_H_
