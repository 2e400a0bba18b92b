#include "server/frame/pick_job.h"

#include <cstddef>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/image/fragment.h"
#include "core/picture/layer_blending.h"
#include "core/view/clip_crossings.h"
#include "core/view/clip_region.h"
#include "server/frame/agent_queries.h"
#include "server/frame/render_statistics.h"
#include "server/picture/frame_output.h"
#include "wire/proto_convert.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;

v1::PickedPoint ToProto(const std::optional<PixelPoint>& point) {
  v1::PickedPoint proto;
  if (!point.has_value()) {
    return proto;
  }
  proto.set_is_hit(true);
  *proto.mutable_position() = wire::ToProto(point->position);
  proto.set_depth(point->distance);
  proto.set_surface_index(static_cast<std::int32_t>(point->surface_index));
  if (point->normal.has_value()) {
    *proto.mutable_normal() = wire::ToProto(*point->normal);
  }
  proto.set_block_id(point->block_id);
  return proto;
}

void SetLabel(const v1::Dataset& dataset, double value, v1::PickedPoint* point) {
  point->set_label(value);
  for (const v1::Label& label : dataset.labels()) {
    if (label.value() == value) {
      point->set_label_name(label.name());
    }
  }
}

// Returns true if a pixel of the drawn region shows a cap, by the depth of its fragment: that of a
// crossing of its ray with the border of the clip region.
bool ShowsCap(const view::ClipCrossingFinder& crossings, const wire::PixelPosition& pixel,
              float depth) {
  const view::ClipCrossings at = crossings.At(pixel.x + 0.5, pixel.y + 0.5);
  return (at.entry.has_value() && at.entry->depth == depth) ||
         (at.exit.has_value() && at.exit->depth == depth);
}

}  // namespace

absl::StatusOr<std::unique_ptr<PickJob>> PickJob::Admit(std::shared_ptr<FrameTicket> ticket,
                                                        const Request& request) {
  ISOSCOPE_ASSIGN_OR_RETURN(wire::PickSpec pick, wire::PickSpecFromProto(request));
  if (pick.request.with_trace()) {
    return absl::InvalidArgumentError(
        "frame.with_trace is set: must be unset, picks have no trace");
  }
  ISOSCOPE_RETURN_IF_ERROR(ticket->TakePlace(pick.frame));
  return std::unique_ptr<PickJob>(new PickJob(std::move(ticket), std::move(pick)));
}

PickJob::PickJob(std::shared_ptr<FrameTicket> ticket, wire::PickSpec pick)
    : ticket_(std::move(ticket)),
      asked_{std::move(pick.request), std::move(pick.frame), pick.with_field_values},
      pixels_(std::move(pick.pixels)) {}

absl::Status PickJob::Run(Response* response) {
  return ticket_->Run(asked_, response, [&] { return TryRun(response); });
}

absl::Status PickJob::TryRun(Response* response) {
  ISOSCOPE_ASSIGN_OR_RETURN(const FrameTarget target, ticket_->Prepare(&asked_, /*trace=*/nullptr));
  *response->mutable_camera() = asked_.request.camera();
  if (target.selected.selection.has_value()) {
    *response->mutable_selection() = *target.selected.selection;
  }
  if (target.selected.time.has_value()) {
    response->set_time(*target.selected.time);
  }
  asked_.spec.sends_normals = true;
  ShowSurfacesOnCaps(&asked_);
  std::vector<FramePart> parts = target.parts;
  FrameRunner* const runner = ticket_->runner();
  const FrameIdentity identity = ticket_->Identity();
  ISOSCOPE_ASSIGN_OR_RETURN(drawn_, runner->Run(identity, asked_, target, &parts));
  *response->mutable_statistics() = StatisticsOf(drawn_);
  ISOSCOPE_RETURN_IF_ERROR(
      runner->AddMissingShards(identity, asked_, target, parts, response->mutable_statistics()));
  base::RunIn(runner->arena(), [&] { picture::ShowNearest(drawn_.layers, &drawn_.image); });
  const view::ClipCrossingFinder crossings(target.view,
                                           view::Clipper(asked_.spec.clip, target.view.geometry()));
  for (const wire::PixelPosition& pixel : pixels_) {
    const int x = pixel.x - asked_.spec.region->x;
    const int y = pixel.y - asked_.spec.region->y;
    *response->add_points() =
        ToProto(PointAt(drawn_.image, x, y, target.view, target.order, asked_.spec.sends_normals));
    const float depth = image::DepthOf(drawn_.image.keys[drawn_.image.IndexOf(x, y)]);
    shows_cap_.push_back(asked_.spec.caps.has_value() && ShowsCap(crossings, pixel, depth));
  }
  return AskAgentsOfPoints(target, parts, response);
}

absl::Status PickJob::AskAgentsOfPoints(const FrameTarget& target,
                                        const std::vector<FramePart>& parts, Response* response) {
  std::vector<ShownPoint> points;
  std::vector<v1::PickedPoint*> hits;
  for (std::size_t i = 0; i < pixels_.size(); ++i) {
    v1::PickedPoint& point = *response->mutable_points(static_cast<int>(i));
    if (point.is_hit()) {
      hits.push_back(&point);
      const math::Vec3d position = {point.position().x(), point.position().y(),
                                    point.position().z()};
      const auto surface = static_cast<std::size_t>(point.surface_index());
      points.push_back({.position = position,
                        .block_id = static_cast<volume::BlockId>(point.block_id()),
                        .rule = asked_.spec.surfaces[surface].rule,
                        .is_on_cap = shows_cap_[i]});
    }
  }
  if (points.empty()) {
    return absl::OkStatus();
  }
  const std::vector<FieldVolume>& fields = target.selected.all_fields;
  std::vector<std::string> volume_ids;
  for (const FieldVolume& field : fields) {
    volume_ids.push_back(field.dataset_id);
  }
  const QueryOutcome<std::vector<PointAnswer>> outcome =
      AskPoints({target.dataset->dataset.dataset_id(), parts}, points, volume_ids,
                ticket_->request(), ticket_->cancellation());
  ticket_->runner()->ReportQuery(ticket_->request(), outcome.report);
  ISOSCOPE_RETURN_IF_ERROR(outcome.result.status());
  for (std::size_t i = 0; i < hits.size(); ++i) {
    const PointAnswer& answer = (*outcome.result)[i];
    if (!answer.shard_index.has_value() || answer.values.size() != fields.size()) {
      return absl::InternalError(
          absl::StrCat("a pixel shows block ", hits[i]->block_id(), ", which no agent has"));
    }
    hits[i]->set_shard_index(*answer.shard_index);
    if (points[i].rule.has_labels()) {
      if (!answer.label.has_value()) {
        return absl::InternalError(absl::StrCat("a pixel shows block ", hits[i]->block_id(),
                                                ", where no agent found a label"));
      }
      SetLabel(target.dataset->dataset, *answer.label, hits[i]);
    } else if (answer.gradient.has_value()) {
      *hits[i]->mutable_gradient() = wire::ToProto(*answer.gradient);
    }
    for (std::size_t k = 0; k < fields.size(); ++k) {
      v1::FieldValue* const out = hits[i]->add_field_values();
      out->set_field(fields[k].field);
      out->set_component(fields[k].component);
      out->set_unit(fields[k].unit);
      out->set_value(answer.values[k]);
    }
  }
  return absl::OkStatus();
}

}  // namespace isoscope::server
