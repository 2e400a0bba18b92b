// Messages that become core types. The first byte chooses the message. What is refused is
// INVALID_ARGUMENT; what is accepted is in the range that its type promises.

#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/store/manifest.h"
#include "core/volume/block_layout.h"
#include "core/volume/volume_level.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "isoscope/v1/dataset_service.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "tests/fuzz/fuzz_input.h"
#include "wire/depth_bounds_convert.h"
#include "wire/frame_convert.h"
#include "wire/histogram_convert.h"
#include "wire/known_fields.h"
#include "wire/pick_convert.h"
#include "wire/proto_convert.h"
#include "wire/trace_convert.h"

namespace isoscope::fuzz {
namespace {

namespace v1 = isoscope::v1;
namespace internal = isoscope::internal::v1;

template <typename Message>
bool Parse(absl::string_view bytes, Message* message) {
  return message->ParseFromArray(bytes.data(), static_cast<int>(bytes.size()));
}

void RequireRefusal(const absl::Status& status) {
  RequireError(status, {absl::StatusCode::kInvalidArgument});
}

void RequireFrame(const frame::FrameSpec& spec) {
  Require(spec.viewport.width_px >= 1 && spec.viewport.height_px >= 1 &&
              spec.viewport.width_px <= view::kMaxViewportPx &&
              spec.viewport.height_px <= view::kMaxViewportPx,
          "an accepted frame has a size that may be");
  Require(!spec.surfaces.empty() && spec.surfaces.size() <= frame::kMaxSurfaces,
          "an accepted frame has surfaces");
  for (const auto& surface : spec.surfaces) {
    Require(std::isfinite(surface.rule.isovalue), "an accepted isovalue is finite");
    Require(surface.rule.labels.size() <= volume::kMaxLabels, "labels are few");
    for (const double label : surface.rule.labels) {
      Require(std::isfinite(label), "an accepted label is finite");
    }
  }
  Require(spec.level >= 0 && spec.level <= volume::kMaxLevel, "an accepted level may exist");
  if (spec.camera) {
    Require(wire::CameraFromProto(wire::ToProto(*spec.camera), "camera").ok(),
            "an accepted camera comes back from its message");
  }
}

void ReadFrame(absl::string_view bytes) {
  v1::RenderIsosurfaceRequest request;
  if (!Parse(bytes, &request)) {
    return;
  }
  const auto spec = wire::FrameSpecFromProto(request);
  if (!spec.ok()) {
    RequireRefusal(spec.status());
    return;
  }
  Require(wire::CheckKnownFields(request).ok(), "an accepted request has known fields only");
  RequireFrame(*spec);
  // The coordinator resolves the camera and passes the frame on: agents must accept it.
  frame::FrameSpec drawn = *spec;
  const absl::Status status = wire::ResolveCamera({{0, 0, 0}, {10, 10, 10}}, &drawn, std::nullopt);
  if (!status.ok()) {
    RequireRefusal(status);
    return;
  }
  frame::FrameSpec fitted = *spec;
  if (const absl::Status fit =
          wire::ResolveCellsCamera({{0, 0, 0}, {10, 10, 10}}, math::Box3d{{1, 1, 1}, {2, 3, 4}},
                                   std::nullopt, fitted.viewport, &fitted);
      !fit.ok()) {
    RequireRefusal(fit);
  }
  const auto agent_spec = wire::FrameSpecFromProto(wire::ToProto(drawn));
  drawn.nan_color.reset();
  drawn.output = {};
  drawn.effects = {};
  Require(agent_spec.ok() && *agent_spec == drawn, "agents see the frame that the coordinator has");
}

void ReadPick(absl::string_view bytes) {
  v1::PickSurfaceRequest request;
  if (!Parse(bytes, &request)) {
    return;
  }
  const auto spec = wire::PickSpecFromProto(request);
  if (!spec.ok()) {
    RequireRefusal(spec.status());
    return;
  }
  const frame::FrameSpec& frame = spec->asked.spec;
  RequireFrame(frame);
  Require(frame.region.has_value() && !spec->pixels.empty() &&
              spec->pixels.size() <= static_cast<std::size_t>(wire::kMaxPickedPixels),
          "an accepted pick has pixels, and a region around them");
  const view::Region& region = *frame.region;
  for (const wire::PixelPosition& pixel : spec->pixels) {
    Require(pixel.x >= region.x && pixel.x < region.x + region.width_px && pixel.y >= region.y &&
                pixel.y < region.y + region.height_px,
            "the region of a pick holds its pixels");
  }
}

void ReadExport(absl::string_view bytes) {
  v1::ExportIsosurfaceRequest request;
  if (!Parse(bytes, &request)) {
    return;
  }
  const auto spec = wire::ExportSpecFromProto(request);
  if (!spec.ok()) {
    RequireRefusal(spec.status());
    return;
  }
  Require(!spec->rules.empty() && spec->rules.size() <= frame::kMaxSurfaces,
          "an accepted export has surfaces");
}

void ReadHistograms(absl::string_view bytes) {
  v1::GetHistogramRequest request;
  if (Parse(bytes, &request)) {
    const auto query = wire::HistogramQueryFromProto(request);
    if (!query.ok()) {
      RequireRefusal(query.status());
    } else {
      Require(query->max_bin_count >= 1 && query->max_bin_count <= volume::kMaxHistogramBins,
              "an accepted query has a number of bins that may be");
    }
  }
  internal::GetShardHistogramResponse response;
  if (!Parse(bytes, &response)) {
    return;
  }
  const auto part = wire::HistogramPartFromProto(response);
  if (!part.ok()) {
    RequireRefusal(part.status());
    return;
  }
  Require(part->active_block_counts.size() == static_cast<std::size_t>(part->groups.count) &&
              part->active_block_bytes.size() == part->active_block_counts.size() &&
              part->estimated_triangle_counts.size() == part->active_block_counts.size(),
          "an accepted part has numbers for each group");
  const auto again = wire::HistogramPartFromProto(wire::ToProto(*part));
  Require(again.ok() && again->groups == part->groups &&
              again->active_block_counts == part->active_block_counts &&
              again->samples == part->samples,
          "a part comes back from its message");
  volume::HistogramPart sum = *part;
  static_cast<void>(volume::AddPart(*again, &sum));
  static_cast<void>(wire::ToProto(sum, {}));
}

void ReadAnswersOfAgents(absl::string_view bytes) {
  const auto layout = volume::BlockLayout::Make({33, 33, 33}, {8, 8, 8});
  internal::GetCellBoxResponse cell_box;
  if (Parse(bytes, &cell_box)) {
    const auto cells = wire::CellBoxFromProto(cell_box, *layout);
    if (!cells.ok()) {
      RequireRefusal(cells.status());
    } else if (*cells) {
      Require(!(*cells)->empty() && math::IndexBox{{0, 0, 0}, {32, 32, 32}}.Covers(**cells),
              "accepted cells lie in the volume");
    }
  }
  internal::GetDepthBoundsRequest question;
  if (Parse(bytes, &question)) {
    const auto query = wire::DepthBoundsQueryFromProto(question);
    if (!query.ok()) {
      RequireRefusal(query.status());
    } else {
      Require(query->part_index < query->part_count && query->spec.camera.has_value(),
              "an accepted question has a part and a camera");
    }
  }
  internal::GetDepthBoundsResponse answer;
  if (Parse(bytes, &answer)) {
    const auto bounds = wire::DepthBoundsFromProto(answer, {4, 2});
    if (bounds.ok()) {
      const auto again = wire::DepthBoundsFromProto(wire::ToProto(*bounds), {4, 2});
      Require(again.ok() && *again == *bounds, "bounds come back from their message");
    }
  }
  internal::GetActiveBoxResponse box;
  if (Parse(bytes, &box)) {
    const auto cells = wire::ActiveBoxFromProto(box, *layout);
    if (!cells.ok()) {
      RequireRefusal(cells.status());
    } else if (*cells) {
      Require(
          (*cells)->begin.x >= 0 && (*cells)->begin.x < (*cells)->end.x && (*cells)->end.x <= 32,
          "an accepted box lies in the volume");
    }
  }
  internal::GetGradientsResponse gradients;
  if (Parse(bytes, &gradients)) {
    std::vector<std::optional<math::Vec3d>> point_gradients(3);
    const absl::Status status = wire::AddGradients(gradients, &point_gradients);
    if (!status.ok()) {
      RequireRefusal(status);
    }
    Require(point_gradients.size() == 3, "an answer adds no points");
    std::vector<std::vector<double>> values(3);
    if (const absl::Status added = wire::AddPointValues(gradients, 2, &values); !added.ok()) {
      RequireRefusal(added);
    }
    for (const std::vector<double>& point_values : values) {
      Require(point_values.empty() || point_values.size() == 2,
              "a point has the values of all volumes");
    }
  }
  internal::GetGradientsRequest points;
  if (Parse(bytes, &points)) {
    const auto picked = wire::PickedPointsFromProto(points);
    Require(!picked.ok() || picked->size() <= static_cast<std::size_t>(wire::kMaxPickedPixels),
            "an accepted request has few points");
    const auto surfaces = wire::PickedSurfacesFromProto(points);
    if (!surfaces.ok()) {
      RequireRefusal(surfaces.status());
    } else {
      Require(
          surfaces->empty() || surfaces->size() == static_cast<std::size_t>(points.points_size()),
          "an accepted point has a surface");
    }
  }
}

void ReadDataset(absl::string_view bytes) {
  v1::Dataset dataset;
  if (!Parse(bytes, &dataset)) {
    return;
  }
  const absl::Status status = wire::Validate(dataset, "dataset");
  if (!status.ok()) {
    RequireError(status, {absl::StatusCode::kInvalidArgument}, "dataset");
    return;
  }
  const auto geometry = wire::GeometryFromProto(dataset.geometry(), "geometry");
  Require(geometry.ok() && volume::Validate(*geometry).ok(), "an accepted dataset has a grid");
}

void ReadTrace(absl::string_view bytes) {
  internal::AgentTrace trace;
  if (!Parse(bytes, &trace)) {
    return;
  }
  const base::TraceTime zero;
  const auto at = [&](int ms) { return zero + std::chrono::milliseconds(ms); };
  const v1::ProcessTrace aligned = wire::AlignAgentTrace(
      trace, {.sent = {at(1), at(5)}, .received = {at(3), at(9), at(12)}}, zero, "a:1");
  Require(aligned.tracks_size() >= trace.spans().tracks_size(), "no track is lost");
  internal::FrameDone done;
  if (Parse(bytes, &done)) {
    static_cast<void>(wire::AgentStatisticsFromProto(done.statistics()));
  }
}

void Run(Input input) {
  const std::uint8_t choice = input.Byte();
  const absl::string_view bytes = input.Rest();
  switch (choice % 7) {
    case 0:
      return ReadFrame(bytes);
    case 1:
      return ReadPick(bytes);
    case 2:
      return ReadExport(bytes);
    case 3:
      return ReadHistograms(bytes);
    case 4:
      return ReadAnswersOfAgents(bytes);
    case 5:
      return ReadDataset(bytes);
    default:
      return ReadTrace(bytes);
  }
}

v1::RenderIsosurfaceRequest RichRequest() {
  v1::RenderIsosurfaceRequest request;
  request.set_dataset("head");
  request.mutable_viewport()->set_width_px(64);
  request.mutable_viewport()->set_height_px(48);
  request.mutable_camera()->mutable_eye()->set_z(30);
  request.mutable_camera()->mutable_target()->set_x(1);
  request.mutable_camera()->mutable_perspective()->set_fov_y_degrees(30);
  v1::Surface* const surface = request.add_surfaces();
  surface->set_isovalue(128);
  surface->mutable_color()->set_red(0.5F);
  surface->mutable_color()->set_alpha(0.5F);
  surface->mutable_material()->set_shininess(20);
  v1::ColorBy* const color_by = request.add_surfaces()->mutable_color_by();
  color_by->set_quantity(v1::ColorBy::QUANTITY_POSITION_Z);
  color_by->set_color_map(v1::COLOR_MAP_TURBO);
  color_by->mutable_range()->set_max(10);
  request.mutable_clip()->add_half_spaces()->mutable_normal()->set_x(1);
  request.mutable_clip()->mutable_box()->mutable_max()->set_x(5);
  request.add_lights()->mutable_direction()->set_z(1);
  request.mutable_region()->set_width_px(10);
  request.mutable_region()->set_height_px(10);
  request.mutable_output()->set_depth(true);
  request.mutable_ambient_occlusion()->set_radius_px(8);
  request.mutable_silhouette()->set_width_px(2);
  request.set_samples(4);
  request.set_max_layers(4);
  request.mutable_caps()->set_color_map(v1::COLOR_MAP_GREY);
  return request;
}

}  // namespace

std::vector<std::string> Seeds() {
  std::vector<std::string> seeds;
  const auto add = [&](char choice, const google::protobuf::Message& message) {
    seeds.push_back(std::string(1, choice) + message.SerializeAsString());
  };
  v1::RenderIsosurfaceRequest plain;
  plain.set_isovalue(100);
  plain.mutable_viewport()->set_width_px(32);
  plain.mutable_viewport()->set_height_px(16);
  add('\0', plain);
  add('\0', RichRequest());
  plain.set_camera_fit(v1::CAMERA_FIT_SURFACE);
  plain.mutable_camera()->mutable_eye()->set_z(30);
  plain.mutable_camera()->mutable_orthographic()->set_height(30);
  plain.mutable_camera()->mutable_target();
  add('\0', plain);
  v1::PickSurfaceRequest pick;
  *pick.mutable_frame() = plain;
  pick.add_pixels()->set_x(3);
  pick.add_pixels()->set_y(7);
  add('\1', pick);
  v1::ExportIsosurfaceRequest mesh;
  mesh.set_isovalue(3);
  *mesh.mutable_clip() = RichRequest().clip();
  add('\2', mesh);
  v1::GetHistogramRequest histogram;
  histogram.set_max_bin_count(16);
  histogram.mutable_value_range()->set_max(10);
  add('\3', histogram);
  internal::GetShardHistogramResponse part;
  part.set_first_bin(10);
  part.set_stored_bin_count(2);
  part.set_bins_per_group_count(1);
  for (const int count : {3, 4}) {
    part.add_active_block_counts(count);
    part.add_active_block_bytes(100 * count);
    part.add_estimated_triangle_counts(17 * count);
    part.mutable_samples()->add_counts(1000 * count);
  }
  add('\3', part);
  internal::GetActiveBoxResponse box;
  box.set_active_block_count(2);
  box.mutable_begin_cell();
  box.mutable_end_cell()->set_x(8);
  box.mutable_end_cell()->set_y(16);
  box.mutable_end_cell()->set_z(32);
  add('\4', box);
  visibility::DepthBounds bounds(4, 2);
  bounds.AddToRows({1, 0, 3, 2}, 0.25F, 0.5F, 0, 2);
  add('\4', wire::ToProto(bounds));
  internal::GetGradientsResponse gradients;
  gradients.add_gradients()->set_point_index(1);
  gradients.mutable_gradients(0)->mutable_gradient()->set_x(1);
  add('\4', gradients);
  gradients.add_values()->set_point_index(2);
  gradients.mutable_values(0)->add_values(1);
  gradients.mutable_values(0)->add_values(2);
  add('\4', gradients);
  store::Manifest manifest;
  manifest.dataset_id = "0123456789abcdef0123456789abcdef";
  manifest.name = "head";
  manifest.geometry.sample_dims = {9, 9, 9};
  manifest.block_cells = {4, 4, 4};
  manifest.shards.resize(2);
  add('\5', wire::ToProto(manifest));
  internal::AgentTrace trace;
  v1::TraceTrack* const track = trace.mutable_spans()->add_tracks();
  track->set_name("frame 1");
  v1::TraceSpan* const span = track->add_spans();
  span->set_name("draw");
  span->mutable_start_duration()->set_nanos(2000000);
  span->mutable_span_duration()->set_nanos(1000000);
  for (const int ms : {0, 3}) {
    trace.add_receive_duration()->set_nanos(ms * 1000000);
    trace.add_send_duration()->set_nanos((ms + 2) * 1000000);
  }
  add('\6', trace);
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isoscope::fuzz::Run(isoscope::fuzz::Input(data, size));
  return 0;
}
