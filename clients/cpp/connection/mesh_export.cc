#include "clients/cpp/connection/mesh_export.h"

#include <algorithm>
#include <memory>
#include <optional>

#include "clients/cpp/mesh_file/mesh_writer.h"
#include "clients/cpp/request/label_flags.h"
#include "core/base/status_macros.h"
#include "core/io/atomic_file.h"
#include "core/rpc/field_selection.h"

namespace isoscope::client {

namespace v1 = isoscope::v1;

absl::Status ReceiveMesh(const v1::ExportIsosurfaceRequest& request, absl::Duration timeout,
                         ServiceClient* client, MeshSink* sink, const MeshProgress& progress) {
  MeshDecoder decoder(std::max(1, request.surfaces_size()));
  const auto add_chunk = [&](const v1::ExportIsosurfaceResponse& chunk) -> absl::Status {
    if (progress != nullptr) {
      progress(decoder.vertex_count(), decoder.triangle_count());
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const MeshPiece piece,
                              decoder.Decode(chunk.surface_index(), chunk.positions(),
                                             chunk.normals(), chunk.triangles()));
    return sink->Add(piece);
  };
  return client->ExportIsosurface(request, timeout, add_chunk);
}

std::optional<MeshField> PinSelection(const v1::Dataset& dataset,
                                      v1::ExportIsosurfaceRequest* request) {
  if (dataset.fields().empty()) {
    return std::nullopt;
  }
  const absl::StatusOr<v1::FieldSelection> selection =
      rpc::ResolveSelection(request->selection(), dataset);
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
    field.time = rpc::TimeOf(dataset, selection->time_step());
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
  options.surfaces[0].isovalue = request.isovalue();
  if (request.surfaces_size() > 0) {
    options.surfaces.clear();
    for (const auto& surface : request.surfaces()) {
      options.surfaces.push_back(
          {.isovalue = surface.isovalue(),
           .name =
               NameOfLabels({surface.labels().begin(), surface.labels().end()}, v1::Dataset())});
    }
  }
  ISOSCOPE_RETURN_IF_ERROR(io::CheckWritable(path));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<MeshWriter> writer, MeshWriter::Create(options));
  ISOSCOPE_RETURN_IF_ERROR(ReceiveMesh(request, timeout, client, writer.get()));
  ISOSCOPE_RETURN_IF_ERROR(writer->Finish());
  return MeshFileSummary{.vertex_count = writer->vertex_count(),
                         .triangle_count = writer->triangle_count(),
                         .size_bytes = writer->size_bytes()};
}

}  // namespace isoscope::client
