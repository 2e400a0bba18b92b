// A pick is a frame, and then a question to the agents:
//
// 1. Prepare and Run draw the region around the pixels, with normals in place of colours.
// 2. ShowNearest puts the nearest translucent fragment of each pixel into the image.
// 3. PointAt reads position, surface, block and normal of each pixel. A pixel shows a cap if its
//    depth is that of a crossing of its ray with the clip region.
// 4. AskAgentsOfPoints asks for shard, label or gradient, and values at all points that are hit.
//    A hit without a shard, a value, or a label of its surface is INTERNAL.
// 5. ToProto joins both. A background pixel gives an empty point.

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

void SetLabel(const v1::Dataset& dataset, double value, v1::PickedPoint* point) {
  point->set_label(value);
  for (const v1::Label& label : dataset.labels()) {
    if (label.value() == value) {
      point->set_label_name(label.name());
    }
  }
}

v1::PickedPoint ToProto(const PixelPoint& seen, const PointAnswer& answer,
                        const FrameTarget& target) {
  v1::PickedPoint proto;
  proto.set_is_hit(true);
  *proto.mutable_position() = wire::ToProto(seen.position);
  proto.set_depth(seen.distance);
  proto.set_surface_index(static_cast<std::int32_t>(seen.surface_index));
  if (seen.normal.has_value()) {
    *proto.mutable_normal() = wire::ToProto(*seen.normal);
  }
  proto.set_block_id(seen.block_id);
  proto.set_shard_index(*answer.shard_index);
  if (answer.label.has_value()) {
    SetLabel(target.dataset->dataset, *answer.label, &proto);
  } else if (answer.gradient.has_value()) {
    *proto.mutable_gradient() = wire::ToProto(*answer.gradient);
  }
  const std::vector<FieldVolume>& fields = target.selected.all_fields;
  for (std::size_t i = 0; i < fields.size(); ++i) {
    v1::FieldValue* const value = proto.add_field_values();
    value->set_field(fields[i].field);
    value->set_component(fields[i].component);
    value->set_unit(fields[i].unit);
    value->set_value(answer.values[i]);
  }
  return proto;
}

// Returns true if a pixel of the drawn region shows a cap: the depth of its fragment is that of a
// crossing of its ray with the border of the clip region.
bool ShowsCap(const view::ClipCrossingFinder& crossings, const wire::PixelPosition& pixel,
              float depth) {
  const view::ClipCrossings at = crossings.At(pixel.x + 0.5, pixel.y + 0.5);
  return (at.entry.has_value() && at.entry->depth == depth) ||
         (at.exit.has_value() && at.exit->depth == depth);
}

}  // namespace

absl::StatusOr<std::unique_ptr<PickJob>> PickJob::Admit(FrameRunner* runner,
                                                        std::shared_ptr<FrameTicket> ticket,
                                                        const Request& request) {
  ISOSCOPE_ASSIGN_OR_RETURN(wire::PickSpec pick, wire::PickSpecFromProto(request));
  if (pick.asked.with_trace) {
    return absl::InvalidArgumentError(
        "frame.with_trace is set: must be unset, picks have no trace");
  }
  ISOSCOPE_RETURN_IF_ERROR(ticket->TakePlace(pick.asked.spec));
  return std::unique_ptr<PickJob>(new PickJob(runner, std::move(ticket), std::move(pick)));
}

PickJob::PickJob(FrameRunner* runner, std::shared_ptr<FrameTicket> ticket, wire::PickSpec pick)
    : runner_(*runner),
      ticket_(std::move(ticket)),
      asked_(std::move(pick.asked)),
      pixels_(std::move(pick.pixels)) {}

absl::Status PickJob::Run(Response* response) {
  return ticket_->Run(asked_.spec, cost_, [&] { return TryRun(response); });
}

absl::Status PickJob::TryRun(Response* response) {
  // 1. The frame.
  ISOSCOPE_ASSIGN_OR_RETURN(const FrameTarget target,
                            runner_.Prepare(ticket_.get(), &asked_, /*trace=*/nullptr));
  std::vector<FramePart> parts = target.parts;
  const FrameIdentity identity = ticket_->Identity();
  ISOSCOPE_ASSIGN_OR_RETURN(drawn_, runner_.Run(identity, asked_, target, &parts));
  cost_ = CostOf(drawn_);
  ISOSCOPE_RETURN_IF_ERROR(runner_.AddMissingShards(identity, asked_, target, parts, &cost_));
  // 2. The nearest fragments.
  base::RunIn(runner_.state().arena.get(),
              [&] { picture::ShowNearest(drawn_.layers, &drawn_.image); });
  // 3. The points of the pixels.
  const frame::FrameSpec& spec = asked_.spec;
  const view::ClipCrossingFinder crossings(target.view,
                                           view::Clipper(spec.clip, target.view.geometry()));
  for (const wire::PixelPosition& pixel : pixels_) {
    const int x = pixel.x - spec.region->x;
    const int y = pixel.y - spec.region->y;
    const float depth = image::DepthOf(drawn_.image.keys[drawn_.image.IndexOf(x, y)]);
    points_.push_back(
        {.seen = PointAt(drawn_.image, x, y, target.view, target.order, spec.sends_normals),
         .is_on_cap = spec.caps.has_value() && ShowsCap(crossings, pixel, depth),
         .answer = {}});
  }
  // 4. The agents' answers.
  ISOSCOPE_RETURN_IF_ERROR(AskAgentsOfPoints(target, parts));
  // 5. The response.

  *response->mutable_camera() = wire::ToProto(*spec.camera);
  *response->mutable_statistics() = ToProto(cost_);
  if (target.selected.selection.has_value()) {
    *response->mutable_selection() = *target.selected.selection;
  }
  if (target.selected.time.has_value()) {
    response->set_time(*target.selected.time);
  }
  for (const Point& point : points_) {
    *response->add_points() =
        point.seen.has_value() ? ToProto(*point.seen, point.answer, target) : v1::PickedPoint();
  }
  return absl::OkStatus();
}

absl::Status PickJob::AskAgentsOfPoints(const FrameTarget& target,
                                        const std::vector<FramePart>& parts) {
  std::vector<ShownPoint> shown;
  std::vector<Point*> hits;
  for (Point& point : points_) {
    if (point.seen.has_value()) {
      hits.push_back(&point);
      shown.push_back({.position = point.seen->position,
                       .block_id = static_cast<volume::BlockId>(point.seen->block_id),
                       .rule = asked_.spec.surfaces[point.seen->surface_index].rule,
                       .is_on_cap = point.is_on_cap});
    }
  }
  if (hits.empty()) {
    return absl::OkStatus();
  }
  std::vector<std::string> volume_ids;
  for (const FieldVolume& field : target.selected.all_fields) {
    volume_ids.push_back(field.dataset_id);
  }
  QueryOutcome<std::vector<PointAnswer>> outcome =
      AskPoints({target.dataset->dataset.dataset_id(), parts}, shown, volume_ids,
                ticket_->request(), ticket_->cancellation());
  runner_.state().ReportQuery(ticket_->request(), outcome.report);
  ISOSCOPE_RETURN_IF_ERROR(outcome.result.status());
  for (std::size_t i = 0; i < hits.size(); ++i) {
    PointAnswer& answer = hits[i]->answer;
    answer = std::move((*outcome.result)[i]);
    if (!answer.shard_index.has_value() || answer.values.size() != volume_ids.size()) {
      return absl::InternalError(
          absl::StrCat("a pixel shows block ", shown[i].block_id, ", which no agent has"));
    }
    if (shown[i].rule.has_labels() && !answer.label.has_value()) {
      return absl::InternalError(absl::StrCat("a pixel shows block ", shown[i].block_id,
                                              ", where no agent found a label"));
    }
  }
  return absl::OkStatus();
}

}  // namespace isoscope::server
