#include "partition-agent/shard/point_gradients.h"

#include <algorithm>
#include <cstdint>
#include <map>
#include <string>
#include <utility>

#include "absl/status/status.h"

#include "core/base/status_macros.h"
#include "core/math/matrix.h"
#include "core/store/shard_reader.h"
#include "core/volume/field_gradient.h"

namespace isoscope::agent {
namespace {

// A point, and its position in index space.
struct Place {
  std::size_t point_index = 0;
  math::Vec3d position;
};
using PlacesByBlock = std::map<volume::BlockId, std::vector<Place>>;

PlacesByBlock PlacesOf(const volume::GridGeometry& geometry, const volume::BlockLayout& layout,
                       const std::vector<math::Vec3d>& points) {
  const math::Mat4d index_from_world = geometry.index_from_world();
  PlacesByBlock places;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const math::Vec3d position = math::TransformPoint(index_from_world, points[i]);
    if (math::IsFinite(position)) {
      places[volume::BlockOfCell(layout, volume::CellAt(layout, position))].push_back(
          {i, position});
    }
  }
  return places;
}

}  // namespace

absl::StatusOr<std::vector<PointGradient>> GradientsAt(const Shards& shards,
                                                       const std::vector<math::Vec3d>& points,
                                                       const base::Cancellation& cancellation) {
  const volume::GridGeometry& geometry = shards.front()->reader->manifest().geometry;
  const volume::BlockLayout& layout = shards.front()->reader->layout();
  const PlacesByBlock places = PlacesOf(geometry, layout, points);
  std::vector<PointGradient> gradients;
  const auto visit = [&](const volume::BlockSamples& samples) {
    for (const Place& place : places.at(samples.block_id)) {
      const math::Vec3d gradient = volume::GradientAt(geometry, layout, samples, place.position);
      if (math::IsFinite(gradient)) {
        gradients.push_back({place.point_index, gradient});
      }
    }
    return cancellation.Check();
  };
  for (const std::shared_ptr<const Shard>& shard : shards) {
    const store::ShardReader& reader = *shard->reader;
    std::vector<std::uint32_t> ordinals;
    for (std::uint32_t ordinal = 0; ordinal < reader.block_count(); ++ordinal) {
      if (places.contains(reader.block_id(ordinal))) {
        ordinals.push_back(ordinal);
      }
    }
    for (const store::ShardReader::DiskRun& run : reader.PlanDiskRuns(ordinals)) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
      std::string buffer(static_cast<std::size_t>(run.size), '\0');
      ISOSCOPE_RETURN_IF_ERROR(reader.ReadDiskRun(run, ordinals, buffer.data(), visit));
    }
  }
  std::sort(gradients.begin(), gradients.end(), [](const PointGradient& a, const PointGradient& b) {
    return a.point_index < b.point_index;
  });
  return gradients;
}

std::vector<PointShard> ShardsOf(const Shards& shards,
                                 const std::vector<std::optional<volume::BlockId>>& block_ids) {
  std::map<volume::BlockId, std::vector<std::size_t>> points_of;
  for (std::size_t i = 0; i < block_ids.size(); ++i) {
    if (block_ids[i].has_value()) {
      points_of[*block_ids[i]].push_back(i);
    }
  }
  std::vector<PointShard> found;
  if (points_of.empty()) {
    return found;
  }
  for (const std::shared_ptr<const Shard>& shard : shards) {
    const store::ShardReader& reader = *shard->reader;
    for (std::uint32_t ordinal = 0; ordinal < reader.block_count(); ++ordinal) {
      const auto points = points_of.find(reader.block_id(ordinal));
      if (points == points_of.end()) {
        continue;
      }
      for (const std::size_t point_index : points->second) {
        found.push_back({point_index, reader.shard_index()});
      }
    }
  }
  std::sort(found.begin(), found.end(),
            [](const PointShard& a, const PointShard& b) { return a.point_index < b.point_index; });
  return found;
}

}  // namespace isoscope::agent
