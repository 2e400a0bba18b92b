#include "client-cli/commands/info_surfaces.h"

#include "client-cli/commands/surface_notes.h"
#include "clients/cpp/connection/label_query.h"
#include "clients/cpp/connection/mesh_export.h"
#include "clients/cpp/connection/service_client.h"
#include "clients/cpp/request/dataset_fields.h"
#include "clients/cpp/request/parse_value.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"
#include "core/cli/waiting_line.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::cli {

void AddInfoSurfaceFlags(FlagSet* set, InfoSurfaceFlags* flags) {
  AddRepeatableFlag(set, "--isovalue", "V", &flags->isovalues, client::ParseNumber,
                    "measure the area of this isosurface, and the volume that it encloses if it is "
                    "closed, any number of times (a volume is partitioned into the cache first)");
  client::AddLabelFlags(set, &flags->label, /*has_opacity=*/false);
  client::AddClipFlags(set, &flags->clip, "measure");
  set->AddSwitch("--close", &flags->closes,
                 "close each surface first where its solid ends, as export --close does");
}

absl::Status CheckUsage(const InfoSurfaceFlags& flags) {
  if (flags.empty() && (flags.closes || !flags.clip.empty())) {
    return UsageError(
        "--close, --clip-plane and --clip-box are for the surfaces that --isovalue, --label or "
        "--labels measures");
  }
  ISOSCOPE_RETURN_IF_ERROR(client::CheckUsage(flags.label, client::kAnyNumberOfSurfaces));
  return client::CheckUsage(flags.clip);
}

absl::StatusOr<std::vector<MeasuredSurface>> MeasureInfoSurfaces(
    const InfoSurfaceFlags& flags, const client::SelectionFlags& given,
    const isoscope::v1::Dataset& dataset, Session* session, const Context& context) {
  client::SelectionFlags selection = given;
  session->AdaptSelection(&selection);
  ISOSCOPE_RETURN_IF_ERROR(client::ResolveNames(dataset, &selection));
  client::LabelFlags label = flags.label;
  ISOSCOPE_RETURN_IF_ERROR(client::ResolveLabels(dataset, selection, session->frame_timeout(),
                                                 &session->client(), &label,
                                                 client::kAnyNumberOfSurfaces));
  isoscope::v1::ExportIsosurfaceRequest request;
  request.set_dataset(dataset.name());
  for (const double isovalue : flags.isovalues) {
    request.add_surfaces()->set_isovalue(isovalue);
  }
  std::vector<std::string> names;
  for (const client::LabelSurface& surface : label.surfaces) {
    client::AddTo(surface, request.add_surfaces());
    names.push_back(surface.name);
  }
  if (!flags.clip.empty()) {
    *request.mutable_clip() = client::ToProto(flags.clip);
  }
  if (const auto selected = client::ToProto(selection)) {
    *request.mutable_selection() = *selected;
  }
  request.set_closes(flags.closes);
  std::vector<client::SurfaceMeasures> measures;
  {
    const WaitingLine waiting(context.err, context.err_is_terminal, "measuring");
    ISOSCOPE_ASSIGN_OR_RETURN(
        measures, client::MeasureSurfaces(request, session->export_timeout(), &session->client()));
  }
  ISOSCOPE_RETURN_IF_ERROR(WriteNotesOnMesh(
      request,
      [&measures](int surface) {
        return measures[static_cast<std::size_t>(surface)].triangle_count > 0;
      },
      session, context));
  return MeasuredSurfaces(request, names, measures);
}

}  // namespace isoscope::cli
