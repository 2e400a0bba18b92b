#include "client-cli/commands/surface_exporter.h"

#include <memory>
#include <ostream>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "clients/cpp/connection/mesh_export.h"
#include "clients/cpp/connection/service_client.h"
#include "core/base/status_macros.h"
#include "core/cli/format.h"
#include "core/cli/progress_line.h"

namespace isoscope::cli {
namespace {

// Passes pieces on, as those of one surface.
class SurfaceSink : public client::MeshSink {
 public:
  SurfaceSink(int surface_index, client::MeshSink* sink)
      : surface_index_(surface_index), sink_(*sink) {}

  absl::Status Add(const client::MeshPiece& piece) override {
    client::MeshPiece own = piece;
    own.surface_index = surface_index_;
    return sink_.Add(own);
  }
  absl::Status Finish() override { return absl::OkStatus(); }

 private:
  const int surface_index_;
  client::MeshSink& sink_;
};

}  // namespace

absl::Status SurfaceExporter::Run(const std::string& scratch_folder) {
  if (filters_.empty() && !files_.has_file_for_each()) {
    ISOSCOPE_ASSIGN_OR_RETURN(measures_, Receive(request_, &files_));
    return files_.Finish();
  }
  for (int i = 0; i < surface_count_; ++i) {
    ISOSCOPE_RETURN_IF_ERROR(RunOne(i, scratch_folder));
  }
  ReportFilters();
  return files_.Finish();
}

absl::StatusOr<std::vector<client::SurfaceMeasures>> SurfaceExporter::Receive(
    const isoscope::v1::ExportIsosurfaceRequest& request, client::MeshSink* sink) {
  ProgressLine line(context_.err, context_.err_is_terminal);
  return client::ReceiveMesh(
      request, session_.export_timeout(), &session_.client(), sink,
      [&](std::int64_t vertex_count, std::int64_t triangle_count) {
        line.Update(absl::StrCat("exporting  ", FormatCount(vertex_count), " vertices, ",
                                 FormatCount(triangle_count), " triangles"));
      });
}

absl::Status SurfaceExporter::RunOne(int surface_index, const std::string& scratch_folder) {
  isoscope::v1::ExportIsosurfaceRequest one = request_;
  if (request_.surfaces_size() > 0) {
    one.clear_surfaces();
    *one.add_surfaces() = request_.surfaces(surface_index);
  }
  if (filters_.empty()) {
    SurfaceSink sink(surface_index, &files_);
    ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<client::SurfaceMeasures> measures,
                              Receive(one, &sink));
    measures_.insert(measures_.end(), measures.begin(), measures.end());
    return absl::OkStatus();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<client::MeshStore> mesh,
                            client::MeshStore::Create(scratch_folder));
  one.set_with_measures(false);  // filters change the surface
  ISOSCOPE_RETURN_IF_ERROR(Receive(one, mesh.get()).status());
  ISOSCOPE_RETURN_IF_ERROR(Filter(surface_index, mesh.get()));
  ISOSCOPE_ASSIGN_OR_RETURN(measures_.emplace_back(), client::MeasureMesh(mesh.get()));
  return mesh->Emit(&files_, files_.VertexCountBefore(surface_index), surface_index);
}

absl::Status SurfaceExporter::Filter(int surface_index, client::MeshStore* mesh) {
  received_triangle_count_ += mesh->triangle_count();
  if (filters_.min_component) {
    ISOSCOPE_ASSIGN_OR_RETURN(const client::DroppedComponents dropped,
                              client::DropSmallComponents(*filters_.min_component, mesh));
    dropped_.component_count += dropped.component_count;
    dropped_.dropped_count += dropped.dropped_count;
    dropped_.dropped_triangle_count += dropped.dropped_triangle_count;
  }
  kept_triangle_count_ += mesh->triangle_count();
  if (!filters_.simplifies()) {
    return absl::OkStatus();
  }
  ProgressLine line(context_.err, context_.err_is_terminal);
  client::SimplifyOptions options{.share = filters_.simplify_share,
                                  .max_error = filters_.simplify_error};
  options.progress = [&](double done) {
    line.Update(
        absl::StrFormat("simplifying  %.0f %%", 100 * (surface_index + done) / surface_count_));
    return context_.interrupt->cancellation().Check();
  };
  ISOSCOPE_ASSIGN_OR_RETURN(const client::SimplifyResult result,
                            client::SimplifyMesh(options, mesh));
  simplified_.triangle_count += result.triangle_count;
  simplified_.error = std::max(simplified_.error, result.error);
  return absl::OkStatus();
}

void SurfaceExporter::ReportFilters() const {
  if (filters_.min_component) {
    *context_.out << "dropped " << FormatCount(dropped_.dropped_count) << " of "
                  << FormatCount(dropped_.component_count) << " components, "
                  << FormatCount(dropped_.dropped_triangle_count) << " of "
                  << FormatCount(received_triangle_count_) << " triangles\n";
  }
  if (filters_.simplifies()) {
    *context_.out << "simplified " << FormatCount(kept_triangle_count_) << " triangles to "
                  << FormatCount(simplified_.triangle_count)
                  << absl::StrFormat(", estimated error %.3g world units\n", simplified_.error);
  }
}

}  // namespace isoscope::cli
