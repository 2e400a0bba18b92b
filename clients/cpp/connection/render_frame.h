// Renders a frame with the call that suits its size, and writes its planes to files.

#ifndef ISOSCOPE_CLIENTS_CPP_CONNECTION_RENDER_FRAME_H_
#define ISOSCOPE_CLIENTS_CPP_CONNECTION_RENDER_FRAME_H_

#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "clients/cpp/connection/service_client.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::client {

// Renders one frame; large planes are sent in parts. Errors as ServiceClient::RenderIsosurface.
absl::StatusOr<isoscope::v1::RenderIsosurfaceResponse> RenderFrame(
    const isoscope::v1::RenderIsosurfaceRequest& request, absl::Duration timeout,
    ServiceClient* client);

// Paths of planes as NumPy files (.npy); unset ones are not written.
struct PlaneFiles {
  std::optional<std::string> depth = std::nullopt;
  std::optional<std::string> surface_index = std::nullopt;
  std::optional<std::string> position = std::nullopt;
  std::optional<std::string> normal = std::nullopt;
  std::optional<std::string> depth_bounds = std::nullopt;

  // Returns true if any plane is requested.
  [[nodiscard]] bool any_plane() const {
    return depth || surface_index || position || normal || depth_bounds;
  }
};

// Adds these planes to the request, and keeps the requested picture.
void RequestPlanes(const PlaneFiles& files, isoscope::v1::OutputOptions* options);

// Writes the planes of a response, as arrays of shape height, width and, for vectors, 3, for bounds
// 2. Each file appears complete or not at all. DATA_LOSS: a plane lacks the size of the picture, for instance
// because it was not requested. Else errors of writing.
absl::Status WritePlanes(const PlaneFiles& files,
                         const isoscope::v1::RenderIsosurfaceResponse& response);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_CONNECTION_RENDER_FRAME_H_
