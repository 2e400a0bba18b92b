// One FromProto and one ToProto function for each message, from small messages to large ones:
// vectors, camera, viewport, region, colour, grid, dataset, block lists, statistics, durations.
//
// Each From function builds the path of a field with Join and reports a wrong value with Invalid,
// as "camera.eye.x is nan: must be finite". Checks that core has itself (view::Validate) are called
// there, and WithPath puts the path in front of their errors.
//
// Invariants: degrees and radians convert so that a camera survives the way to the wire and back
// (DegreesOf). Ids of blocks travel as differences, each checked against the rest of the range, so
// that no sum overflows.

#include "wire/proto_convert.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/store/shard_format.h"
#include "core/volume/patient_frame.h"
#include "wire/enum_table.h"

namespace isoscope::wire {

namespace v1 = isoscope::v1;

namespace {

constexpr double kRadiansPerDegree = std::numbers::pi / 180;
constexpr double kMaxByte = 255;
constexpr std::int64_t kMaxDurationSeconds = 315'576'000'000;  // google.protobuf.Duration's limit

constexpr EnumRow<frame::Culling, v1::Culling> kCullings[] = {
    {frame::Culling::kDepth, v1::CULLING_DEPTH},
    {frame::Culling::kDepth, v1::CULLING_UNSPECIFIED},
    {frame::Culling::kMask, v1::CULLING_MASK},
    {frame::Culling::kNone, v1::CULLING_NONE}};
constexpr EnumRow<volume::ScalarType, v1::SampleType> kSampleTypes[] = {
    {volume::ScalarType::kUint8, v1::SAMPLE_TYPE_UINT8},
    {volume::ScalarType::kInt8, v1::SAMPLE_TYPE_INT8},
    {volume::ScalarType::kUint16, v1::SAMPLE_TYPE_UINT16},
    {volume::ScalarType::kInt16, v1::SAMPLE_TYPE_INT16},
    {volume::ScalarType::kUint32, v1::SAMPLE_TYPE_UINT32},
    {volume::ScalarType::kInt32, v1::SAMPLE_TYPE_INT32},
    {volume::ScalarType::kFloat32, v1::SAMPLE_TYPE_FLOAT32},
    {volume::ScalarType::kFloat64, v1::SAMPLE_TYPE_FLOAT64}};

absl::Status Invalid(absl::string_view path, const absl::AlphaNum& value,
                     absl::string_view allowed) {
  return absl::InvalidArgumentError(absl::StrCat(path, " is ", value, ": ", allowed));
}

std::string Join(absl::string_view path, absl::string_view field) {
  return path.empty() ? std::string(field) : absl::StrCat(path, ".", field);
}

// Returns degrees that become `radians` again after multiplication, a short decimal if there is
// one. If no degrees do: the nearest ones.
double DegreesOf(double radians) {
  const double degrees = radians / kRadiansPerDegree;
  const double lower = std::nextafter(degrees, 0.0);
  const double upper = std::nextafter(degrees, 180.0);
  // Product and quotient are rounded by half a step each: that is up to two steps of the degrees.
  for (const double candidate : {std::round(degrees * 1e9) / 1e9, degrees, lower, upper,
                                 std::nextafter(lower, 0.0), std::nextafter(upper, 180.0)}) {
    if (candidate * kRadiansPerDegree == radians && candidate < 180.0) {
      return candidate;
    }
  }
  return degrees;
}

// Puts the path of the field into an error of core's own checks, such as "camera up ...".
absl::Status WithPath(const absl::Status& status, absl::string_view path) {
  if (status.ok()) {
    return status;
  }
  return absl::InvalidArgumentError(absl::StrCat(path, ": ", status.message()));
}

absl::StatusOr<math::Index3> DimensionsFromProto(const v1::Dimensions& proto, std::int64_t min,
                                                 absl::string_view path) {
  const math::Index3 dims{proto.x(), proto.y(), proto.z()};
  if (dims.x < min || dims.y < min || dims.z < min) {
    return absl::InvalidArgumentError(absl::StrFormat("%s is %d x %d x %d: each must be >= %d",
                                                      path, dims.x, dims.y, dims.z, min));
  }
  return dims;
}

absl::StatusOr<std::uint8_t> ChannelFromProto(float value, absl::string_view path) {
  if (!(value >= 0.0F && value <= 1.0F)) {
    return Invalid(path, value, "must be in [0, 1]");
  }
  return static_cast<std::uint8_t>(std::lround(static_cast<double>(value) * kMaxByte));
}

}  // namespace

v1::Dimensions ToProto(const math::Index3& dims) {
  v1::Dimensions proto;
  proto.set_x(dims.x);
  proto.set_y(dims.y);
  proto.set_z(dims.z);
  return proto;
}

absl::Status CheckFinite(double value, absl::string_view path) {
  if (!std::isfinite(value)) {
    return Invalid(path, value, "must be finite");
  }
  return absl::OkStatus();
}

absl::StatusOr<math::Vec3d> VectorFromProto(const v1::Vec3& proto, absl::string_view path) {
  ISOSCOPE_RETURN_IF_ERROR(CheckFinite(proto.x(), Join(path, "x")));
  ISOSCOPE_RETURN_IF_ERROR(CheckFinite(proto.y(), Join(path, "y")));
  ISOSCOPE_RETURN_IF_ERROR(CheckFinite(proto.z(), Join(path, "z")));
  return math::Vec3d{proto.x(), proto.y(), proto.z()};
}

v1::Vec3 ToProto(const math::Vec3d& vector) {
  v1::Vec3 proto;
  proto.set_x(vector.x);
  proto.set_y(vector.y);
  proto.set_z(vector.z);
  return proto;
}

absl::StatusOr<view::Camera> CameraFromProto(const v1::Camera& proto, absl::string_view path) {
  if (!proto.has_eye() || !proto.has_target()) {
    return Invalid(Join(path, proto.has_eye() ? "target" : "eye"), "not set",
                   "a camera needs eye, target and a projection");
  }
  view::Camera camera;
  ISOSCOPE_ASSIGN_OR_RETURN(camera.eye, VectorFromProto(proto.eye(), Join(path, "eye")));
  ISOSCOPE_ASSIGN_OR_RETURN(camera.target, VectorFromProto(proto.target(), Join(path, "target")));
  if (proto.has_up()) {
    ISOSCOPE_ASSIGN_OR_RETURN(camera.up, VectorFromProto(proto.up(), Join(path, "up")));
  }
  switch (proto.projection_case()) {
    case v1::Camera::kPerspective: {
      const double degrees = proto.perspective().fov_y_degrees();
      if (!(degrees > 0 && degrees < 180)) {
        return Invalid(Join(path, "perspective.fov_y_degrees"), degrees,
                       "must be in (0, 180), exclusive");
      }
      camera.projection = view::Projection::kPerspective;
      camera.fov_y_radians = degrees * kRadiansPerDegree;
      break;
    }
    case v1::Camera::kOrthographic: {
      const double height = proto.orthographic().height();
      if (!(std::isfinite(height) && height > 0)) {
        return Invalid(Join(path, "orthographic.height"), height,
                       "must be finite and greater than 0");
      }
      camera.projection = view::Projection::kOrthographic;
      camera.view_height = height;
      break;
    }
    case v1::Camera::PROJECTION_NOT_SET:
      return Invalid(Join(path, "projection"), "not set", "set perspective or orthographic");
  }
  ISOSCOPE_RETURN_IF_ERROR(WithPath(view::Validate(camera), path));
  return camera;
}

v1::Camera ToProto(const view::Camera& camera) {
  v1::Camera proto;
  *proto.mutable_eye() = ToProto(camera.eye);
  *proto.mutable_target() = ToProto(camera.target);
  *proto.mutable_up() = ToProto(camera.up);
  if (camera.projection == view::Projection::kPerspective) {
    proto.mutable_perspective()->set_fov_y_degrees(DegreesOf(camera.fov_y_radians));
  } else {
    proto.mutable_orthographic()->set_height(camera.view_height);
  }
  return proto;
}

absl::StatusOr<view::Viewport> ViewportFromProto(const v1::Viewport& proto, absl::string_view path,
                                                 int max_side_px) {
  const auto check = [&](absl::string_view field, std::int32_t value) {
    if (value < 1 || value > max_side_px) {
      return Invalid(
          Join(path, field), value,
          absl::StrCat("must be in [1, ", max_side_px, "]",
                       value > max_side_px && value <= view::kMaxWholeViewportPx
                           ? absl::StrCat("; with a region, up to ", view::kMaxWholeViewportPx)
                           : ""));
    }
    return absl::OkStatus();
  };
  ISOSCOPE_RETURN_IF_ERROR(check("width_px", proto.width_px()));
  ISOSCOPE_RETURN_IF_ERROR(check("height_px", proto.height_px()));
  return view::Viewport{proto.width_px(), proto.height_px()};
}

absl::StatusOr<view::Region> RegionFromProto(const v1::Region& proto,
                                             const view::Viewport& viewport,
                                             absl::string_view path) {
  const auto check = [&](absl::string_view field, std::int32_t value, int least, int most) {
    return value < least || value > most
               ? Invalid(Join(path, field), value,
                         absl::StrCat("must be in [", least, ", ", most, "]"))
               : absl::OkStatus();
  };
  ISOSCOPE_RETURN_IF_ERROR(check("x", proto.x(), 0, viewport.width_px - 1));
  ISOSCOPE_RETURN_IF_ERROR(check("y", proto.y(), 0, viewport.height_px - 1));
  ISOSCOPE_RETURN_IF_ERROR(check("width_px", proto.width_px(), 1,
                                 std::min(viewport.width_px - proto.x(), view::kMaxViewportPx)));
  ISOSCOPE_RETURN_IF_ERROR(check("height_px", proto.height_px(), 1,
                                 std::min(viewport.height_px - proto.y(), view::kMaxViewportPx)));
  return view::Region{proto.x(), proto.y(), proto.width_px(), proto.height_px()};
}

v1::Region ToProto(const view::Region& region) {
  v1::Region proto;
  proto.set_x(region.x);
  proto.set_y(region.y);
  proto.set_width_px(region.width_px);
  proto.set_height_px(region.height_px);
  return proto;
}

v1::Viewport ToProto(const view::Viewport& viewport) {
  v1::Viewport proto;
  proto.set_width_px(viewport.width_px);
  proto.set_height_px(viewport.height_px);
  return proto;
}

absl::StatusOr<frame::Culling> CullingFromProto(v1::Culling proto, absl::string_view path) {
  return EnumFromProto(kCullings, proto, path,
                       "must be CULLING_DEPTH (1), CULLING_MASK (2) or CULLING_NONE (3)");
}

v1::Culling ToProto(frame::Culling culling) { return EnumToProto(kCullings, culling); }

absl::StatusOr<image::Rgba8> ColorFromProto(const v1::Color& proto, absl::string_view path) {
  image::Rgba8 color;
  ISOSCOPE_ASSIGN_OR_RETURN(color.r, ChannelFromProto(proto.red(), Join(path, "red")));
  ISOSCOPE_ASSIGN_OR_RETURN(color.g, ChannelFromProto(proto.green(), Join(path, "green")));
  ISOSCOPE_ASSIGN_OR_RETURN(color.b, ChannelFromProto(proto.blue(), Join(path, "blue")));
  ISOSCOPE_ASSIGN_OR_RETURN(color.a, ChannelFromProto(proto.alpha(), Join(path, "alpha")));
  return color;
}

v1::Color ToProto(image::Rgba8 color) {
  constexpr float kScale = 255.0F;
  v1::Color proto;
  proto.set_red(static_cast<float>(color.r) / kScale);
  proto.set_green(static_cast<float>(color.g) / kScale);
  proto.set_blue(static_cast<float>(color.b) / kScale);
  proto.set_alpha(static_cast<float>(color.a) / kScale);
  return proto;
}

absl::StatusOr<volume::GridGeometry> GeometryFromProto(const v1::GridGeometry& proto,
                                                       absl::string_view path) {
  volume::GridGeometry geometry;
  ISOSCOPE_ASSIGN_OR_RETURN(geometry.sample_dims,
                            DimensionsFromProto(proto.sample_dims(), 2, Join(path, "sample_dims")));
  ISOSCOPE_ASSIGN_OR_RETURN(geometry.spacing,
                            VectorFromProto(proto.spacing(), Join(path, "spacing")));
  ISOSCOPE_ASSIGN_OR_RETURN(geometry.origin, VectorFromProto(proto.origin(), Join(path, "origin")));
  const std::string columns_path = Join(path, "direction_columns");
  const int column_count = proto.direction_columns_size();
  if (column_count != 0 && column_count != 3) {
    return Invalid(columns_path, absl::StrCat("a list of ", column_count),
                   "must have 3 columns, or none for the identity");
  }
  for (int i = 0; i < column_count; ++i) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        geometry.direction.columns[static_cast<std::size_t>(i)],
        VectorFromProto(proto.direction_columns(i), absl::StrCat(columns_path, "[", i, "]")));
  }
  ISOSCOPE_RETURN_IF_ERROR(WithPath(volume::Validate(geometry), path));
  return geometry;
}

v1::GridGeometry ToProto(const volume::GridGeometry& geometry) {
  v1::GridGeometry proto;
  *proto.mutable_sample_dims() = ToProto(geometry.sample_dims);
  *proto.mutable_spacing() = ToProto(geometry.spacing);
  *proto.mutable_origin() = ToProto(geometry.origin);
  for (const math::Vec3d& column : geometry.direction.columns) {
    *proto.add_direction_columns() = ToProto(column);
  }
  return proto;
}

v1::SampleType ToProto(volume::ScalarType type) { return EnumToProto(kSampleTypes, type); }

absl::StatusOr<volume::ScalarType> ScalarTypeFromProto(v1::SampleType proto,
                                                       absl::string_view path) {
  return EnumFromProto(kSampleTypes, proto, path, "must be 1 (uint8) to 8 (float64)");
}

v1::Dataset ToProto(const store::Manifest& manifest) {
  v1::Dataset proto;
  proto.set_name(manifest.name);
  proto.set_dataset_id(manifest.dataset_id);
  proto.set_samples_digest(manifest.samples_digest);
  proto.set_source(manifest.source);
  *proto.mutable_geometry() = ToProto(manifest.geometry);
  proto.set_sample_type(ToProto(manifest.scalar_type));
  if (manifest.value_range.min <= manifest.value_range.max) {
    proto.mutable_value_range()->set_min(manifest.value_range.min);
    proto.mutable_value_range()->set_max(manifest.value_range.max);
  }
  if (manifest.finite_range.has_value() && volume::IsFinite(*manifest.finite_range)) {
    proto.mutable_finite_range()->set_min(manifest.finite_range->min);
    proto.mutable_finite_range()->set_max(manifest.finite_range->max);
  }
  *proto.mutable_block_cells() = ToProto(manifest.block_cells);
  const absl::StatusOr<volume::BlockLayout> layout =
      volume::BlockLayout::Make(manifest.geometry.sample_dims, manifest.block_cells);
  proto.set_block_count(layout.ok() ? layout->block_count() : 0);
  proto.set_shard_count(static_cast<std::int32_t>(manifest.shards.size()));
  if (manifest.patient_frame.has_value()) {
    proto.set_patient_frame(manifest.patient_frame->name());
  }
  if (manifest.max_gradient_magnitude.has_value()) {
    proto.set_max_gradient_magnitude(*manifest.max_gradient_magnitude);
  }
  for (const volume::Label& label : manifest.labels) {
    *proto.add_labels() = ToProto(label);
  }
  return proto;
}

v1::Label ToProto(const volume::Label& label) {
  v1::Label proto;
  proto.set_value(label.value);
  proto.set_name(label.name);
  if (label.color.has_value()) {
    *proto.mutable_color() =
        ToProto(image::Rgba8{label.color->red, label.color->green, label.color->blue, 255});
  }
  return proto;
}

absl::StatusOr<std::vector<volume::Label>> LabelsFromProto(
    const google::protobuf::RepeatedPtrField<v1::Label>& proto, absl::string_view path) {
  if (proto.size() > static_cast<int>(volume::kMaxNamedLabels)) {
    return Invalid(path, absl::StrCat("a list of ", proto.size()),
                   absl::StrCat("at most ", volume::kMaxNamedLabels, " labels"));
  }
  std::vector<volume::Label> labels;
  labels.reserve(static_cast<std::size_t>(proto.size()));
  for (int i = 0; i < proto.size(); ++i) {
    volume::Label& label =
        labels.emplace_back(volume::Label{.value = proto[i].value(), .name = proto[i].name()});
    if (proto[i].has_color()) {
      ISOSCOPE_ASSIGN_OR_RETURN(
          const image::Rgba8 color,
          ColorFromProto(proto[i].color(), absl::StrCat(path, "[", i, "].color")));
      label.color = volume::LabelColor{.red = color.r, .green = color.g, .blue = color.b};
    }
  }
  ISOSCOPE_RETURN_IF_ERROR(WithPath(volume::ValidateLabels(labels), path));
  return labels;
}

absl::Status Validate(const v1::Dataset& dataset, absl::string_view path) {
  if (dataset.name().empty()) {
    return Invalid(Join(path, "name"), "empty", "must be set");
  }
  const std::string& id = dataset.dataset_id();
  const auto is_digest = [](const std::string& text) {
    return text.size() == 32 && std::all_of(text.begin(), text.end(), [](char c) {
             return absl::ascii_isxdigit(static_cast<unsigned char>(c));
           });
  };
  if (!is_digest(id)) {
    return Invalid(Join(path, "dataset_id"), base::Quoted(id), "must be 32 hexadecimal digits");
  }
  if (const std::string& digest = dataset.samples_digest(); !digest.empty() && !is_digest(digest)) {
    return Invalid(Join(path, "samples_digest"), base::Quoted(digest),
                   "must be empty or 32 hexadecimal digits");
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::GridGeometry geometry,
                            GeometryFromProto(dataset.geometry(), Join(path, "geometry")));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const math::Index3 block_cells,
      DimensionsFromProto(dataset.block_cells(), 1, Join(path, "block_cells")));
  const absl::StatusOr<volume::BlockLayout> layout =
      volume::BlockLayout::Make(geometry.sample_dims, block_cells);
  ISOSCOPE_RETURN_IF_ERROR(WithPath(layout.status(), Join(path, "block_cells")));
  if (dataset.block_count() != layout->block_count()) {
    return Invalid(Join(path, "block_count"), dataset.block_count(),
                   absl::StrCat("the grid has ", layout->block_count()));
  }
  if (dataset.shard_count() < 1 || dataset.shard_count() > store::kMaxShardCount) {
    return Invalid(Join(path, "shard_count"), dataset.shard_count(),
                   absl::StrCat("must be in [1, ", store::kMaxShardCount, "]"));
  }
  if (!dataset.patient_frame().empty()) {
    ISOSCOPE_RETURN_IF_ERROR(
        WithPath(volume::PatientFrame::FromName(dataset.patient_frame()).status(),
                 Join(path, "patient_frame")));
  }
  if (const double bound = dataset.max_gradient_magnitude();
      !(bound >= 0 && std::isfinite(bound))) {
    return Invalid(Join(path, "max_gradient_magnitude"), bound, "must be finite and >= 0");
  }
  ISOSCOPE_RETURN_IF_ERROR(LabelsFromProto(dataset.labels(), Join(path, "labels")).status());
  const v1::ValueRange& range = dataset.value_range();
  // Infinite samples count, NaN does not.
  if (dataset.has_value_range() && !(range.min() <= range.max())) {
    return Invalid(Join(path, "value_range"), absl::StrCat(range.min(), " to ", range.max()),
                   "min must be <= max");
  }
  const v1::ValueRange& finite = dataset.finite_range();
  if (!(finite.min() <= finite.max() && std::isfinite(finite.min()) &&
        std::isfinite(finite.max()))) {
    return Invalid(Join(path, "finite_range"), absl::StrCat(finite.min(), " to ", finite.max()),
                   "both must be finite, and min must be <= max");
  }
  return absl::OkStatus();
}

isoscope::internal::v1::BlockList ToProto(const std::vector<volume::BlockId>& ids) {
  isoscope::internal::v1::BlockList proto;
  proto.mutable_block_id_deltas()->Reserve(static_cast<int>(ids.size()));
  std::int64_t previous = 0;
  for (const volume::BlockId id : ids) {
    proto.add_block_id_deltas(std::int64_t{id} - previous);
    previous = id;
  }
  return proto;
}

absl::StatusOr<std::vector<volume::BlockId>> BlockListFromProto(
    const isoscope::internal::v1::BlockList& proto, std::int64_t block_count,
    absl::string_view path) {
  std::vector<volume::BlockId> ids;
  ids.reserve(static_cast<std::size_t>(proto.block_id_deltas_size()));
  std::int64_t id = 0;
  for (int i = 0; i < proto.block_id_deltas_size(); ++i) {
    const std::int64_t delta = proto.block_id_deltas(i);
    const std::int64_t min = i == 0 ? 0 : 1;
    // This compares with the room that is left, so that no sum can overflow.
    if (delta < min || delta >= block_count - id) {
      return Invalid(absl::StrCat(path, ".block_id_deltas[", i, "]"), delta,
                     absl::StrCat("ids must ascend and lie in [0, ", block_count,
                                  "); the one before is ", id));
    }
    id += delta;
    ids.push_back(static_cast<volume::BlockId>(id));
  }
  return ids;
}

absl::StatusOr<std::vector<int>> ShardIndicesFromProto(
    const google::protobuf::RepeatedField<std::int32_t>& proto, int shard_count,
    absl::string_view path) {
  if (proto.empty()) {
    return Invalid(path, "empty", "must name at least one shard");
  }
  std::vector<int> indices;
  indices.reserve(static_cast<std::size_t>(proto.size()));
  for (int i = 0; i < proto.size(); ++i) {
    const std::int32_t index = proto.Get(i);
    if (index < 0 || index >= shard_count || (i > 0 && index <= indices.back())) {
      return Invalid(absl::StrCat(path, "[", i, "]"), index,
                     absl::StrCat("must ascend and lie in [0, ", shard_count, ")"));
    }
    indices.push_back(index);
  }
  return indices;
}

v1::AgentStatistics ToProto(const frame::AgentStatistics& statistics) {
  v1::AgentStatistics proto;
  proto.set_agent_address(statistics.agent_address);
  for (const int index : statistics.shard_indices) {
    proto.add_shard_indices(index);
  }
  proto.set_active_block_count(statistics.active_block_count);
  proto.set_occluding_block_count(statistics.occluding_block_count);
  proto.set_visible_block_count(statistics.visible_block_count);
  proto.set_triangle_count(statistics.triangle_count);
  proto.set_unique_vertex_count(statistics.unique_vertex_count);
  proto.set_read_bytes(statistics.read_bytes);
  proto.set_index_page_read_count(statistics.index_page_read_count);
  *proto.mutable_extract_duration() = ToProto(statistics.extract_duration);
  *proto.mutable_render_duration() = ToProto(statistics.render_duration);
  *proto.mutable_busy_duration() = ToProto(statistics.busy_duration);
  for (const frame::SurfaceStatistics& surface : statistics.surfaces) {
    *proto.add_surfaces() = ToProto(surface);
  }
  return proto;
}

v1::SurfaceStatistics ToProto(const frame::SurfaceStatistics& statistics) {
  v1::SurfaceStatistics proto;
  proto.set_triangle_count(statistics.triangle_count);
  proto.set_unique_vertex_count(statistics.unique_vertex_count);
  return proto;
}

frame::AgentStatistics AgentStatisticsFromProto(const v1::AgentStatistics& proto) {
  std::vector<frame::SurfaceStatistics> surfaces;
  for (const v1::SurfaceStatistics& surface : proto.surfaces()) {
    surfaces.push_back({.triangle_count = surface.triangle_count(),
                        .unique_vertex_count = surface.unique_vertex_count()});
  }
  return {.agent_address = proto.agent_address(),
          .shard_indices = {proto.shard_indices().begin(), proto.shard_indices().end()},
          .active_block_count = proto.active_block_count(),
          .occluding_block_count = proto.occluding_block_count(),
          .visible_block_count = proto.visible_block_count(),
          .triangle_count = proto.triangle_count(),
          .unique_vertex_count = proto.unique_vertex_count(),
          .read_bytes = proto.read_bytes(),
          .index_page_read_count = proto.index_page_read_count(),
          .extract_duration = DurationFromProto(proto.extract_duration()),
          .render_duration = DurationFromProto(proto.render_duration()),
          .busy_duration = DurationFromProto(proto.busy_duration()),
          .surfaces = std::move(surfaces)};
}

google::protobuf::Duration ToProto(absl::Duration duration) {
  const absl::Duration clamped =
      std::clamp(duration, -absl::Seconds(kMaxDurationSeconds), absl::Seconds(kMaxDurationSeconds));
  absl::Duration rest;
  google::protobuf::Duration proto;
  proto.set_seconds(absl::IDivDuration(clamped, absl::Seconds(1), &rest));
  proto.set_nanos(static_cast<std::int32_t>(absl::ToInt64Nanoseconds(rest)));
  return proto;
}

absl::Duration DurationFromProto(const google::protobuf::Duration& proto) {
  return absl::Seconds(std::clamp(proto.seconds(), -kMaxDurationSeconds, kMaxDurationSeconds)) +
         absl::Nanoseconds(proto.nanos());
}

}  // namespace isoscope::wire
