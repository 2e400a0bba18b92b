// ReceiveMesh asks for the surfaces in groups, as many in a call as the server allows:
//
//   1. Each call streams chunks. MeshDecoder checks and decodes a chunk to a piece.
//   2. GroupReceiver moves the piece's surface and vertices behind those of earlier calls, so that
//      the sink sees one mesh. A mesh file has 32-bit vertices: more are an error.
//   3. With measures, each surface must have had them by the end.
//
// PinSelection resolves field and step before the first call, so that all calls have the same.

#include "clients/cpp/connection/mesh_export.h"

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"

#include "clients/cpp/connection/features.h"
#include "clients/cpp/mesh_file/mesh_writer.h"
#include "clients/cpp/request/label_flags.h"
#include "clients/cpp/request/render_request.h"
#include "core/base/status_macros.h"
#include "core/io/atomic_file.h"
#include "wire/field_selection.h"

namespace isoscope::client {

namespace v1 = isoscope::v1;

namespace {

SurfaceMeasures MeasuresOf(const v1::SurfaceMeasures& proto) {
  SurfaceMeasures measures{.area = proto.area(),
                           .triangle_count = proto.triangle_count(),
                           .open_edge_count = proto.open_edge_count()};
  if (proto.has_volume()) {
    measures.volume = proto.volume();
  }
  return measures;
}

// Receives the surfaces of one call after those of earlier ones.
struct GroupReceiver {
  MeshSink* sink = nullptr;
  const MeshProgress& progress;
  std::vector<std::optional<SurfaceMeasures>>* measures = nullptr;  // by surface
  int first_surface = 0;
  std::int64_t vertex_count = 0;  // of all calls
  std::int64_t triangle_count = 0;

  absl::Status Receive(const v1::ExportIsosurfaceRequest& group, absl::Duration timeout,
                       ServiceClient* client) {
    MeshDecoder decoder(std::max(1, group.surfaces_size()));
    const std::int64_t first_vertex = vertex_count;
    return client->ExportIsosurface(
        group, timeout, [&](const v1::ExportIsosurfaceResponse& chunk) -> absl::Status {
          if (progress != nullptr) {
            progress(vertex_count, triangle_count);
          }
          std::optional<math::Vec3d> origin;
          if (chunk.has_origin()) {
            origin = {chunk.origin().x(), chunk.origin().y(), chunk.origin().z()};
          }
          ISOSCOPE_ASSIGN_OR_RETURN(MeshPiece piece,
                                    decoder.Decode(chunk.surface_index(), chunk.positions(),
                                                   chunk.normals(), chunk.triangles(), origin));
          if (piece.vertex_count() > kMaxVertexCount - vertex_count) {
            return absl::OutOfRangeError(
                absl::StrCat("the surfaces have more than ", kMaxVertexCount,
                             " vertices together, the most that a mesh file can hold: write one "
                             "file for each"));
          }
          piece.surface_index += first_surface;
          for (std::uint32_t& vertex : piece.triangles) {
            vertex += static_cast<std::uint32_t>(first_vertex);
          }
          if (chunk.has_measures()) {
            (*measures)[static_cast<std::size_t>(piece.surface_index)] =
                MeasuresOf(chunk.measures());
          }
          vertex_count += piece.vertex_count();
          triangle_count += piece.triangle_count();
          if (piece.positions.empty() && piece.triangles.empty()) {
            return absl::OkStatus();
          }
          return sink != nullptr ? sink->Add(piece)
                                 : absl::DataLossError("the server sent a mesh that nobody wants");
        });
  }
};

}  // namespace

absl::StatusOr<std::vector<SurfaceMeasures>> ReceiveMesh(const v1::ExportIsosurfaceRequest& request,
                                                         absl::Duration timeout,
                                                         ServiceClient* client, MeshSink* sink,
                                                         const MeshProgress& progress,
                                                         int group_size) {
  const int surface_count = std::max(1, request.surfaces_size());
  std::vector<std::optional<SurfaceMeasures>> measures(static_cast<std::size_t>(surface_count));
  GroupReceiver receiver{.sink = sink, .progress = progress, .measures = &measures};
  for (int first = 0; first < surface_count; first += group_size) {
    v1::ExportIsosurfaceRequest group = request;
    if (surface_count > group_size) {
      group.clear_surfaces();
      for (int i = first; i < std::min(surface_count, first + group_size); ++i) {
        *group.add_surfaces() = request.surfaces(i);
      }
    }
    receiver.first_surface = first;
    ISOSCOPE_RETURN_IF_ERROR(receiver.Receive(group, timeout, client));
  }
  std::vector<SurfaceMeasures> all;
  for (std::size_t i = 0; i < measures.size() && request.with_measures(); ++i) {
    if (!measures[i].has_value()) {
      return absl::DataLossError(absl::StrCat("the server sent no measures of surface ", i));
    }
    all.push_back(*measures[i]);
  }
  return all;
}

absl::StatusOr<std::vector<SurfaceMeasures>> MeasureSurfaces(
    const v1::ExportIsosurfaceRequest& request, absl::Duration timeout, ServiceClient* client) {
  ISOSCOPE_ASSIGN_OR_RETURN(const bool is_known, HasFeature("closed_meshes", timeout, client));
  if (!is_known) {
    return absl::FailedPreconditionError(
        "the server does not measure surfaces: it is older than this program");
  }
  v1::ExportIsosurfaceRequest measuring = request;
  measuring.set_with_measures(true);
  measuring.set_without_mesh(true);
  return ReceiveMesh(measuring, timeout, client, /*sink=*/nullptr);
}

std::optional<MeshField> PinSelection(const v1::Dataset& dataset,
                                      v1::ExportIsosurfaceRequest* request) {
  if (dataset.fields().empty()) {
    return std::nullopt;
  }
  const absl::StatusOr<v1::FieldSelection> selection =
      wire::ResolveSelection(request->selection(), dataset);
  if (!selection.ok()) {
    return std::nullopt;
  }
  *request->mutable_selection() = *selection;
  MeshField field{.name = selection->field(), .component = selection->component()};
  const auto found =
      std::find_if(dataset.fields().begin(), dataset.fields().end(),
                   [&](const v1::Field& one) { return one.name() == selection->field(); });
  field.unit = found->unit();
  if (selection->has_time_step()) {
    field.step = selection->time_step();
    field.time = wire::TimeOf(dataset, selection->time_step());
    field.time_unit = dataset.time_unit();
  }
  return field;
}

absl::StatusOr<MeshFileSummary> WriteMeshFile(const v1::ExportIsosurfaceRequest& request,
                                              const std::string& path, absl::Duration timeout,
                                              ServiceClient* client,
                                              const std::optional<MeshField>& field) {
  MeshFileOptions options{.path = path, .field = field};
  ISOSCOPE_ASSIGN_OR_RETURN(options.format, MeshFormatOf(path, std::nullopt));
  v1::ExportIsosurfaceRequest whole = request;
  PromoteIsovalue(&whole);
  options.surfaces.clear();
  for (const auto& surface : whole.surfaces()) {
    options.surfaces.push_back(
        {.isovalue = surface.isovalue(),
         .name = NameOfLabels({surface.labels().begin(), surface.labels().end()}, v1::Dataset())});
  }
  ISOSCOPE_RETURN_IF_ERROR(io::CheckWritable(path));
  ISOSCOPE_ASSIGN_OR_RETURN(const bool knows_origin, HasFeature("closed_meshes", timeout, client));
  v1::ExportIsosurfaceRequest with_origin = request;
  with_origin.set_with_origin(knows_origin);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<MeshWriter> writer, MeshWriter::Create(options));
  ISOSCOPE_RETURN_IF_ERROR(ReceiveMesh(with_origin, timeout, client, writer.get()).status());
  ISOSCOPE_RETURN_IF_ERROR(writer->Finish());
  return MeshFileSummary{.vertex_count = writer->vertex_count(),
                         .triangle_count = writer->triangle_count(),
                         .size_bytes = writer->size_bytes()};
}

}  // namespace isoscope::client
