#include "client-cli/commands/frame_measures.h"

#include <map>
#include <optional>
#include <ostream>
#include <string>

#include "absl/status/statusor.h"

#include "client-cli/output/surface_measures.h"
#include "clients/cpp/connection/mesh_export.h"
#include "clients/cpp/connection/service_client.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/cli/waiting_line.h"

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;

absl::StatusOr<FrameMeasures> Measure(const v1::ExportIsosurfaceRequest& request,
                                      const v1::Dataset& dataset,
                                      const std::vector<std::string>& names, Session* session) {
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::vector<client::SurfaceMeasures> measures,
      client::MeasureSurfaces(request, session->export_timeout(), &session->client()));
  return FrameMeasures{.length_unit = dataset.length_unit(),
                       .surfaces = MeasuredSurfaces(request, names, measures)};
}

}  // namespace

v1::ExportIsosurfaceRequest MeshOfFrame(const v1::RenderIsosurfaceRequest& frame) {
  v1::ExportIsosurfaceRequest request;
  request.set_dataset(frame.dataset());
  request.set_isovalue(frame.isovalue());
  for (const v1::Surface& surface : frame.surfaces()) {
    v1::Surface* const whole = request.add_surfaces();
    whole->set_isovalue(surface.isovalue());
    *whole->mutable_labels() = surface.labels();
    whole->set_smooth_labels(surface.smooth_labels());
  }
  if (frame.has_clip()) {
    *request.mutable_clip() = frame.clip();
  }
  if (frame.has_selection()) {
    *request.mutable_selection() = frame.selection();
  }
  request.set_dataset_id(frame.dataset_id());
  return request;
}

absl::Status AddMeasures(const v1::Dataset& dataset, const std::vector<std::string>& names,
                         Session* session, std::vector<FrameRecord>* frames,
                         const Context& context) {
  const WaitingLine waiting(context.err, context.err_is_terminal,
                            "measuring surfaces at level 0 (--no-measures leaves that out)");
  std::map<std::string, FrameMeasures> known;  // by request
  for (FrameRecord& frame : *frames) {
    const v1::ExportIsosurfaceRequest request = MeshOfFrame(frame.request);
    const std::string key = request.SerializeAsString();
    auto found = known.find(key);
    if (found == known.end()) {
      absl::StatusOr<FrameMeasures> measures = Measure(request, dataset, names, session);
      if (!measures.ok()) {
        if (absl::IsCancelled(measures.status())) {
          return measures.status();
        }
        *context.err << "isoscope: the statistics lack the areas and volumes of surfaces: "
                     << base::Printable(measures.status().message()) << std::endl;
        return absl::OkStatus();
      }
      found = known.emplace(key, *std::move(measures)).first;
    }
    frame.measures = found->second;
  }
  return absl::OkStatus();
}

}  // namespace isoscope::cli
