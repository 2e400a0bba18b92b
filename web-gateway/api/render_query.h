// The parameters of GET .../render and .../mesh.glb: those of the command line, parsed by the same
// code. "?isovalue=60&clip_plane=0,0,1,20" is "--isovalue=60 --clip-plane=0,0,1,20".

#ifndef ISOSCOPE_WEB_GATEWAY_API_RENDER_QUERY_H_
#define ISOSCOPE_WEB_GATEWAY_API_RENDER_QUERY_H_

#include <optional>
#include <vector>

#include "absl/status/statusor.h"

#include "clients/cpp/mesh_file/mesh_writer.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "web-gateway/http/url.h"

namespace isoscope::gateway {

// Returns the request for a picture of `dataset`. Parameters: the flags of `isoscope render` that
// affect a pixel, with '-' or '_', and
//   format   png (default), jpeg, or depth: float32 of each pixel, little-endian
//   quality  of a JPEG, 1 to 100
// INVALID_ARGUMENT names the parameter, its value and the allowed values; also for an unknown one.
absl::StatusOr<isoscope::v1::RenderIsosurfaceRequest> RenderRequestFromQuery(
    const QueryParameters& query, const isoscope::v1::Dataset& dataset);

struct MeshQuery {
  isoscope::v1::ExportIsosurfaceRequest request;
  std::vector<client::MeshSurface> surfaces;  // as many as the request has
};
// Parameters: isovalue, color, surface, clip-plane, clip-box, field, component, time, step. Errors
// as above.
absl::StatusOr<MeshQuery> MeshQueryFromQuery(const QueryParameters& query,
                                             const isoscope::v1::Dataset& dataset);

// Takes the parameters field, component, time and step out of `query`: unset if there are none.
// Errors as above.
absl::StatusOr<std::optional<isoscope::v1::FieldSelection>> TakeSelection(QueryParameters* query);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_API_RENDER_QUERY_H_
