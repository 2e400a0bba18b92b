// Receives meshes from the service, into sinks and files.

#ifndef ISOSCOPE_CLIENTS_CPP_CONNECTION_MESH_EXPORT_H_
#define ISOSCOPE_CLIENTS_CPP_CONNECTION_MESH_EXPORT_H_

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "clients/cpp/connection/service_client.h"
#include "clients/cpp/mesh_file/mesh_field.h"
#include "clients/cpp/mesh_file/mesh_measures.h"
#include "clients/cpp/mesh_file/mesh_piece.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::client {

// Called with the counts of vertices and triangles so far, before each chunk is added to them.
using MeshProgress = std::function<void(std::int64_t vertex_count, std::int64_t triangle_count)>;

// Passes the surfaces of the request to `sink` as they arrive; does not call its Finish. `progress`
// may be null. A request may have any number of surfaces: it is sent in calls of at most
// `group_size` of them, each with the timeout.
//
// Returns the measures of all surfaces, if the request asks for them; else nothing. Errors as
// ServiceClient::ExportIsosurface, MeshDecoder and the sink; OUT_OF_RANGE above kMaxVertexCount
// vertices in all calls; DATA_LOSS if a surface has no measures.
//
// REQUIRES: 1 <= group_size <= kSurfacesOfCall
inline constexpr int kSurfacesOfCall = 128;
absl::StatusOr<std::vector<SurfaceMeasures>> ReceiveMesh(
    const isoscope::v1::ExportIsosurfaceRequest& request, absl::Duration timeout,
    ServiceClient* client, MeshSink* sink, const MeshProgress& progress = nullptr,
    int group_size = kSurfacesOfCall);

// Returns the measures of the surfaces of the request, without their meshes. FAILED_PRECONDITION if
// the server does not know them; else errors as ReceiveMesh.
absl::StatusOr<std::vector<SurfaceMeasures>> MeasureSurfaces(
    const isoscope::v1::ExportIsosurfaceRequest& request, absl::Duration timeout,
    ServiceClient* client);

// Replaces the selection of a request by the field and the step that it means in `dataset`, which
// is the request's, so that a step that is appended meanwhile changes nothing. Returns them for the
// mesh's file. Not set: the dataset has no fields, or serves nothing such, as the server will say.
std::optional<MeshField> PinSelection(const isoscope::v1::Dataset& dataset,
                                      isoscope::v1::ExportIsosurfaceRequest* request);

struct MeshFileSummary {
  std::int64_t vertex_count = 0;
  std::int64_t triangle_count = 0;
  std::int64_t size_bytes = 0;
};

// Writes the surfaces of the request to a file, in the format of its suffix: .ply, .stl, .obj, .glb
// or .vtp; with an origin, if the server has one. The file appears complete or not at all.
// INVALID_ARGUMENT: another suffix. Else errors of writing and as ReceiveMesh.
//
// field: that of PinSelection, which the file says; not set: it says none
absl::StatusOr<MeshFileSummary> WriteMeshFile(const isoscope::v1::ExportIsosurfaceRequest& request,
                                              const std::string& path, absl::Duration timeout,
                                              ServiceClient* client,
                                              const std::optional<MeshField>& field = std::nullopt);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_CONNECTION_MESH_EXPORT_H_
