// Gets the surfaces of an export, filters them, and writes them to mesh files.

#ifndef ISOSCOPE_CLIENT_CLI_COMMANDS_SURFACE_EXPORTER_H_
#define ISOSCOPE_CLIENT_CLI_COMMANDS_SURFACE_EXPORTER_H_

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "client-cli/output/mesh_files.h"
#include "client-cli/session/session.h"
#include "clients/cpp/mesh_file/mesh_components.h"
#include "clients/cpp/mesh_file/mesh_measures.h"
#include "clients/cpp/mesh_file/mesh_simplifier.h"
#include "clients/cpp/mesh_file/mesh_store.h"
#include "core/cli/command.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::cli {

// The filters of each surface before it is written.
struct MeshFilters {
  std::optional<std::int64_t> min_component;
  std::optional<double> simplify_share;
  std::optional<double> simplify_error;

  [[nodiscard]] bool simplifies() const { return simplify_share || simplify_error; }
  [[nodiscard]] bool empty() const { return !min_component && !simplifies(); }
};

// For a single use. Thread-compatible. Its arguments must outlive it.
class SurfaceExporter {
 public:
  SurfaceExporter(const MeshFilters& filters, isoscope::v1::ExportIsosurfaceRequest request,
                  Session* session, MeshFiles* files, const Context& context)
      : filters_(filters),
        request_(std::move(request)),
        session_(*session),
        files_(*files),
        context_(context),
        surface_count_(std::max(1, request_.surfaces_size())) {}

  // Without a filter, chunks go from the stream straight into the file: memory stays constant. With
  // a filter, or with a file for each surface, there is one call for each surface, so that neither
  // a filter nor a file's end keeps the server waiting. A filter has the surface in scratch files.
  //
  // scratch_folder: for these files
  absl::Status Run(const std::string& scratch_folder);

  // The measures of what was written, by surface; empty if the request did not ask for them.
  [[nodiscard]] const std::vector<client::SurfaceMeasures>& measures() const { return measures_; }

 private:
  absl::StatusOr<std::vector<client::SurfaceMeasures>> Receive(
      const isoscope::v1::ExportIsosurfaceRequest& request, client::MeshSink* sink);
  absl::Status RunOne(int surface_index, const std::string& scratch_folder);
  absl::Status Filter(int surface_index, client::MeshStore* mesh);
  void ReportFilters() const;

  const MeshFilters filters_;
  const isoscope::v1::ExportIsosurfaceRequest request_;
  Session& session_;
  MeshFiles& files_;
  const Context& context_;
  const int surface_count_;
  std::vector<client::SurfaceMeasures> measures_;
  // Sums over the surfaces.
  std::int64_t received_triangle_count_ = 0;
  client::DroppedComponents dropped_;
  std::int64_t kept_triangle_count_ = 0;  // by the filter of components
  client::SimplifyResult simplified_;
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_COMMANDS_SURFACE_EXPORTER_H_
