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

// Returns the bytes that draw a frame of any size at the upper left corner. `image_number`: for
// kitty. Errors of decoding and of SixelPicture.
absl::StatusOr<std::string> DrawFrame(const ViewerLayout& layout,
                                      const isoscope::v1::InteractResponse& response,
                                      int image_number);

// Returns the flags of `render` that reproduce the frame, bit for bit.
std::string FlagsOfFrame(const isoscope::v1::RenderIsosurfaceRequest& frame);

// The send times of a stream's states, by sequence number. While the view moves, a frame answers an
// older state than the newest. Thread-compatible.
class SentStates {
 public:
  void Add(std::int64_t sequence_number, absl::Time sent);
  // Returns the time from the state that a frame answers until `now`; nullopt if that state is not
  // known. Erases earlier states, which no later frame answers.
  std::optional<absl::Duration> TakeLatency(std::int64_t sequence_number, absl::Time now);

 private:
  std::map<std::int64_t, absl::Time> sent_;  // at most kMaxStates
};

// Shows the dataset on the terminal of this process until q or Ctrl-C, and restores the terminal.
// FAILED_PRECONDITION if there is no terminal, or one without pictures; errors of the Interact
// stream.
absl::Status RunTerminalViewer(const isoscope::v1::Dataset& dataset, double isovalue, ShowMode mode,
                               Session* session, const Context& context);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_TERMINAL_TERMINAL_VIEWER_H_
