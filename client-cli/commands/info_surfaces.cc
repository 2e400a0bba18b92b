#include "client-cli/commands/info_surfaces.h"

#include <cstdint>
#include <vector>

#include "absl/status/status.h"

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
namespace {

// A frame without surfaces.
isoscope::v1::RenderIsosurfaceRequest FrameLike(
    const isoscope::v1::ExportIsosurfaceRequest& request) {
  isoscope::v1::RenderIsosurfaceRequest frame;
  frame.set_dataset(request.dataset());
  frame.mutable_viewport()->set_width_px(kLevelCostSidePx);
  frame.mutable_viewport()->set_height_px(kLevelCostSidePx);
  frame.mutable_output()->set_image_format(isoscope::v1::OutputOptions::IMAGE_FORMAT_NONE);
  frame.mutable_output()->set_surface_index(true);  // the smallest answer
  if (request.has_clip()) {
    *frame.mutable_clip() = request.clip();
  }
  if (request.has_selection()) {
    *frame.mutable_selection() = request.selection();
  }
  return frame;
}

// Draws each isosurface from each level that it can be drawn from.
absl::Status AddLevelCosts(const isoscope::v1::ExportIsosurfaceRequest& request,
                           const isoscope::v1::Dataset& dataset, Session* session,
                           const Context& context, std::vector<MeasuredSurface>* surfaces) {
  isoscope::v1::RenderIsosurfaceRequest frame = FrameLike(request);
  std::vector<std::int32_t> levels = {0};
  for (const isoscope::v1::DatasetLevel& level : dataset.levels()) {
    levels.push_back(level.level());
  }
  const WaitingLine waiting(context.err, context.err_is_terminal, "drawing levels");
  for (MeasuredSurface& surface : *surfaces) {
    if (!surface.surface.labels().empty()) {
      continue;  // may be hundreds
    }
    frame.clear_surfaces();
    frame.add_surfaces()->set_isovalue(surface.surface.isovalue());
    for (const std::int32_t level : levels) {
      frame.mutable_level()->set_level(level);
      const auto drawn = session->client().RenderIsosurface(frame, session->frame_timeout());
      if (level > 0 && absl::IsFailedPrecondition(drawn.status())) {
        continue;  // of labels, or not of this field and step
      }
      ISOSCOPE_RETURN_IF_ERROR(drawn.status());
      const isoscope::v1::RenderStatistics& statistics = drawn->statistics();
      surface.levels.push_back({.level = level,
                                .max_spacing_px = drawn->drawn_level().max_spacing_px(),
                                .active_block_count = statistics.active_block_count(),
                                .visible_block_count = statistics.visible_block_count(),
                                .triangle_count = statistics.triangle_count()});
    }
    if (surface.levels.size() == 1) {
      surface.levels.clear();  // there is nothing to choose
    }
  }
  return absl::OkStatus();
}

}  // namespace

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
  std::vector<MeasuredSurface> surfaces = MeasuredSurfaces(request, names, measures);
  if (!dataset.levels().empty()) {
    ISOSCOPE_RETURN_IF_ERROR(AddLevelCosts(request, dataset, session, context, &surfaces));
  }
  return surfaces;
}

}  // namespace isoscope::cli
