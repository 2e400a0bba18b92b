// A pick goes through these conversions:
//
// 1. PickSpecFromProto, in the coordinator: a request becomes the frame of the smallest region
//    around its pixels, without its look, with normals and exact culling.
// 2. Picked...FromProto, in an agent: points, blocks and surfaces of a question. Lists that belong
//    together have one element a point, or none at all.
// 3. Add..., in the coordinator: each answer names its point by index, and is written there. An
//    index out of range, or an answer that was not asked for, is an error.
//
// An agent answers only the points in its shards, so the coordinator adds up several answers.

#include "wire/pick_convert.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "wire/known_fields.h"
#include "wire/proto_convert.h"
#include "wire/surface_convert.h"

namespace isoscope::wire {
namespace {

// Returns the smallest region that holds all pixels. REQUIRES: at least one.
view::Region RegionAround(const std::vector<PixelPosition>& pixels) {
  PixelPosition low = pixels.front();
  PixelPosition high = low;
  for (const PixelPosition& pixel : pixels) {
    low = {std::min(low.x, pixel.x), std::min(low.y, pixel.y)};
    high = {std::max(high.x, pixel.x), std::max(high.y, pixel.y)};
  }
  return {low.x, low.y, high.x - low.x + 1, high.y - low.y + 1};
}

absl::Status CheckCoordinate(absl::string_view name, int index, int value, int size_px) {
  if (value < 0 || value >= size_px) {
    return absl::InvalidArgumentError(absl::StrCat("pixels[", index, "].", name, " is ", value,
                                                   ": must be in [0, ", size_px - 1, "]"));
  }
  return absl::OkStatus();
}

// Checks an index of an answer into the points of the request.
absl::Status CheckPointIndex(absl::string_view path, int point_index, std::size_t point_count) {
  if (point_index < 0 || static_cast<std::size_t>(point_index) >= point_count) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ".point_index is ", point_index, ": must be in [0, ", point_count, ")"));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<PickSpec> PickSpecFromProto(const isoscope::v1::PickSurfaceRequest& proto) {
  ISOSCOPE_RETURN_IF_ERROR(CheckKnownFields(proto));
  if (proto.frame().has_region() || proto.frame().has_output()) {
    return absl::InvalidArgumentError(
        absl::StrCat("frame.", proto.frame().has_region() ? "region" : "output",
                     " is set: must not be; pixels are those of the whole viewport"));
  }
  if (!proto.frame().has_viewport()) {
    return absl::InvalidArgumentError(
        "frame.viewport is not set: must say the size of the image whose pixels are meant");
  }
  ISOSCOPE_ASSIGN_OR_RETURN(
      const view::Viewport viewport,
      ViewportFromProto(proto.frame().viewport(), "frame.viewport", view::kMaxWholeViewportPx));
  if (proto.pixels_size() < 1 || proto.pixels_size() > kMaxPickedPixels) {
    return absl::InvalidArgumentError(absl::StrCat("pixels has ", proto.pixels_size(),
                                                   " elements: must have 1 to ", kMaxPickedPixels));
  }
  PickSpec spec;
  for (int i = 0; i < proto.pixels_size(); ++i) {
    const isoscope::v1::Pixel& pixel = proto.pixels(i);
    ISOSCOPE_RETURN_IF_ERROR(CheckCoordinate("x", i, pixel.x(), viewport.width_px));
    ISOSCOPE_RETURN_IF_ERROR(CheckCoordinate("y", i, pixel.y(), viewport.height_px));
    spec.pixels.push_back({pixel.x(), pixel.y()});
  }
  const view::Region region = RegionAround(spec.pixels);
  if (std::max(region.width_px, region.height_px) > view::kMaxViewportPx) {
    return absl::InvalidArgumentError(absl::StrCat(
        "pixels lie in a window of ", region.width_px, " x ", region.height_px,
        " pixels: must lie in one of at most ", view::kMaxViewportPx, " a side; ask in parts"));
  }
  ISOSCOPE_RETURN_IF_ERROR(CullingFromProto(proto.frame().culling(), "frame.culling").status());
  isoscope::v1::RenderIsosurfaceRequest frame = proto.frame();
  *frame.mutable_region() = ToProto(region);  // the viewport may then be larger than a picture
  ISOSCOPE_ASSIGN_OR_RETURN(spec.asked, AskedFrameFromProto(frame));
  spec.asked.spec = frame::WithoutLook(std::move(spec.asked.spec), /*sends_normals=*/true);
  spec.asked.spec.culling = frame::Culling::kDepth;
  spec.asked.level.reset();
  spec.asked.with_all_fields = proto.with_field_values();
  return spec;
}

absl::StatusOr<std::vector<math::Vec3d>> PickedPointsFromProto(
    const isoscope::internal::v1::GetGradientsRequest& proto) {
  if (proto.points_size() > kMaxPickedPixels) {
    return absl::InvalidArgumentError(absl::StrCat(
        "points has ", proto.points_size(), " elements: must have at most ", kMaxPickedPixels));
  }
  std::vector<math::Vec3d> points;
  for (int i = 0; i < proto.points_size(); ++i) {
    ISOSCOPE_ASSIGN_OR_RETURN(points.emplace_back(),
                              VectorFromProto(proto.points(i), absl::StrCat("points[", i, "]")));
  }
  return points;
}

absl::StatusOr<std::vector<std::optional<volume::BlockId>>> PickedBlocksFromProto(
    const isoscope::internal::v1::GetGradientsRequest& proto, std::int64_t block_count) {
  if (proto.block_ids_size() != 0 && proto.block_ids_size() != proto.points_size()) {
    return absl::InvalidArgumentError(absl::StrCat("block_ids has ", proto.block_ids_size(),
                                                   " elements: must have one for each ", "of the ",
                                                   proto.points_size(), " points, or none"));
  }
  std::vector<std::optional<volume::BlockId>> block_ids;
  for (int i = 0; i < proto.block_ids_size(); ++i) {
    const std::int64_t id = proto.block_ids(i);
    if (id < -1 || id >= block_count) {
      return absl::InvalidArgumentError(
          absl::StrCat("block_ids[", i, "] is ", id, ": must be in [-1, ", block_count - 1, "]"));
    }
    block_ids.emplace_back();
    if (id >= 0) {
      block_ids.back() = static_cast<volume::BlockId>(id);
    }
  }
  return block_ids;
}

absl::StatusOr<std::vector<PickedSurface>> PickedSurfacesFromProto(
    const isoscope::internal::v1::GetGradientsRequest& proto) {
  const isoscope::internal::v1::PointValuesQuery& query = proto.values();
  const bool has_labels = !proto.label_set_indices().empty() || !proto.label_sets().empty();
  if (!proto.has_values() && !has_labels) {
    return std::vector<PickedSurface>();
  }
  if (proto.has_values() &&
      (query.dataset_ids().empty() || query.dataset_ids_size() > kMaxPickedVolumes)) {
    return absl::InvalidArgumentError(
        absl::StrCat("values.dataset_ids has ", query.dataset_ids_size(),
                     " elements: must have 1 to ", kMaxPickedVolumes));
  }
  const auto check_size = [&](absl::string_view name, int size) {
    return size == proto.points_size()
               ? absl::OkStatus()
               : absl::InvalidArgumentError(
                     absl::StrCat(name, " has ", size, " elements: must have one for each of the ",
                                  proto.points_size(), " points"));
  };
  if (proto.has_values()) {
    ISOSCOPE_RETURN_IF_ERROR(check_size("values.isovalues", query.isovalues_size()));
  }
  if (has_labels) {
    ISOSCOPE_RETURN_IF_ERROR(check_size("label_set_indices", proto.label_set_indices_size()));
  }
  ISOSCOPE_RETURN_IF_ERROR(check_size("on_caps", proto.on_caps_size()));
  ISOSCOPE_RETURN_IF_ERROR(check_size("block_ids", proto.block_ids_size()));
  std::vector<volume::InsideRule> sets;
  for (int i = 0; i < proto.label_sets_size(); ++i) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        sets.emplace_back(),
        LabelsFromProto(proto.label_sets(i).labels(), proto.label_sets(i).smooth_labels(),
                        absl::StrCat("label_sets[", i, "].labels")));
  }
  std::vector<PickedSurface> surfaces;
  for (int i = 0; i < proto.points_size(); ++i) {
    PickedSurface& surface = surfaces.emplace_back();
    surface.is_on_cap = proto.on_caps(i);
    const int set = has_labels ? proto.label_set_indices(i) : -1;
    if (set < -1 || set >= proto.label_sets_size()) {
      return absl::InvalidArgumentError(absl::StrCat("label_set_indices[", i, "] is ", set,
                                                     ": must be in [-1, ",
                                                     proto.label_sets_size() - 1, "]"));
    }
    if (set >= 0) {
      surface.rule = sets[static_cast<std::size_t>(set)];
    } else if (proto.has_values()) {
      ISOSCOPE_RETURN_IF_ERROR(
          CheckFinite(query.isovalues(i), absl::StrCat("values.isovalues[", i, "]")));
      surface.rule = volume::InsideRule::OfIsovalue(query.isovalues(i));
    }
  }
  return surfaces;
}

absl::Status AddGradients(const isoscope::internal::v1::GetGradientsResponse& proto,
                          std::vector<std::optional<math::Vec3d>>* gradients) {
  for (int i = 0; i < proto.gradients_size(); ++i) {
    const isoscope::internal::v1::PointGradient& gradient = proto.gradients(i);
    const std::string path = absl::StrCat("gradients[", i, "]");
    ISOSCOPE_RETURN_IF_ERROR(CheckPointIndex(path, gradient.point_index(), gradients->size()));
    ISOSCOPE_ASSIGN_OR_RETURN(
        (*gradients)[static_cast<std::size_t>(gradient.point_index())],
        VectorFromProto(gradient.gradient(), absl::StrCat(path, ".gradient")));
  }
  return absl::OkStatus();
}

absl::Status AddPointShards(const isoscope::internal::v1::GetGradientsResponse& proto,
                            const std::vector<int>& asked,
                            std::vector<std::optional<int>>* shards) {
  for (int i = 0; i < proto.shards_size(); ++i) {
    const isoscope::internal::v1::PointShard& shard = proto.shards(i);
    const std::string path = absl::StrCat("shards[", i, "]");
    ISOSCOPE_RETURN_IF_ERROR(CheckPointIndex(path, shard.point_index(), shards->size()));
    if (!std::binary_search(asked.begin(), asked.end(), shard.shard_index())) {
      return absl::InvalidArgumentError(absl::StrCat(path, ".shard_index is ", shard.shard_index(),
                                                     ": the agent was not asked for it"));
    }
    (*shards)[static_cast<std::size_t>(shard.point_index())] = shard.shard_index();
  }
  return absl::OkStatus();
}

absl::Status AddPointValues(const isoscope::internal::v1::GetGradientsResponse& proto,
                            std::size_t volume_count, std::vector<std::vector<double>>* values) {
  for (int i = 0; i < proto.values_size(); ++i) {
    const isoscope::internal::v1::PointValues& point_proto = proto.values(i);
    const std::string path = absl::StrCat("values[", i, "]");
    ISOSCOPE_RETURN_IF_ERROR(CheckPointIndex(path, point_proto.point_index(), values->size()));
    if (static_cast<std::size_t>(point_proto.values_size()) != volume_count) {
      return absl::InvalidArgumentError(
          absl::StrCat(path, ".values has ", point_proto.values_size(),
                       " elements: must have one for each of the ", volume_count, " volumes"));
    }
    (*values)[static_cast<std::size_t>(point_proto.point_index())] = {point_proto.values().begin(),
                                                                      point_proto.values().end()};
  }
  return absl::OkStatus();
}

absl::Status AddPointLabels(const isoscope::internal::v1::GetGradientsResponse& proto,
                            const std::vector<volume::InsideRule>& rules,
                            std::vector<std::optional<double>>* labels) {
  for (int i = 0; i < proto.labels_size(); ++i) {
    const isoscope::internal::v1::PointLabel& point_proto = proto.labels(i);
    const std::string path = absl::StrCat("labels[", i, "]");
    ISOSCOPE_RETURN_IF_ERROR(CheckPointIndex(path, point_proto.point_index(), labels->size()));
    const auto point = static_cast<std::size_t>(point_proto.point_index());
    if (!rules[point].has_labels() || !rules[point].IsInside(point_proto.label())) {
      return absl::InvalidArgumentError(absl::StrCat(path, ".label is ", point_proto.label(),
                                                     ": must be one of the surface, which has ",
                                                     rules[point].Text()));
    }
    (*labels)[point] = point_proto.label();
  }
  return absl::OkStatus();
}

}  // namespace isoscope::wire
