// Flags of `render` and `pick` for cameras: by name, by fit, and from files.

#ifndef ISOSCOPE_CLIENTS_CPP_REQUEST_VIEW_FLAGS_H_
#define ISOSCOPE_CLIENTS_CPP_REQUEST_VIEW_FLAGS_H_

#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "clients/cpp/request/camera_flags.h"
#include "core/cli/flag_set.h"
#include "core/view/camera_fit.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::client {

struct ViewFlags {
  std::optional<view::NamedView> view = std::nullopt;
  std::optional<isoscope::v1::CameraFit> fit = std::nullopt;
  std::optional<std::string> camera_file = std::nullopt;
  std::optional<std::string> save_camera_file = std::nullopt;

  [[nodiscard]] bool fits_surface() const {
    return fit == isoscope::v1::CAMERA_FIT_SURFACE || fit == isoscope::v1::CAMERA_FIT_CELLS;
  }
};

// Registers the flags that name no file: --view and --fit. `flags` must outlive the parsing.
void AddNamedViewFlags(cli::FlagSet* set, ViewFlags* flags);
// Registers all flags.
void AddViewFlags(cli::FlagSet* set, ViewFlags* flags);

// UsageError if the flags do not fit each other.
absl::Status CheckUsage(const ViewFlags& flags, const CameraFlags& camera);

// Returns true if a flag says anything of the camera. Without one, programs ask for the first look
// (wire/first_look.h).
bool HasCamera(const ViewFlags& flags, const CameraFlags& camera);

// Returns the camera of the first frame for the request, before the server fits it to the surface.
// A camera from a file has the same bits as when it was saved.
//
// INVALID_ARGUMENT: the camera is invalid, the file holds none, or the view is one of a patient and
// the dataset has no patient frame. Else errors of reading the file.
absl::StatusOr<isoscope::v1::Camera> ResolveView(const ViewFlags& flags, const CameraFlags& camera,
                                                 const isoscope::v1::Dataset& dataset);

// Returns the camera of the first look that shows the whole volume from all sides: for films, whose
// surface moves, and for servers that don't know CAMERA_FIT_CELLS.
absl::StatusOr<isoscope::v1::Camera> FirstLookCamera(const isoscope::v1::Dataset& dataset);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_REQUEST_VIEW_FLAGS_H_
