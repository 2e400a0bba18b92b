// For each block that shows points:
//
//   1. Its samples of the drawn volume are read, and its surfaces extracted: each point finds its
//      triangle, and its label if the surface has labels.
//   2. For each other volume, its samples are read, and the surfaces extracted once more, with
//      these values at the vertices.
//
// The surfaces of both steps have the same vertices in the same order.

#include "partition-agent/supply/point_values.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <utility>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/extract/block_extractor.h"
#include "core/extract/cell_label.h"
#include "core/math/matrix.h"
#include "core/mesh/mesh_point.h"
#include "core/store/shard_reader.h"
#include "core/volume/cell_samples.h"
#include "core/volume/field_gradient.h"
#include "core/volume/scalar_type.h"
#include "partition-agent/supply/color_volumes.h"

namespace isoscope::agent {
namespace {

// A point that a block shows.
struct SurfacePlace {
  std::size_t point_index = 0;
  math::Vec3d position;                                      // in index space
  std::optional<mesh::MeshPoint> on_surface = std::nullopt;  // not set: on a cap
};
using SurfacePlaces = std::map<volume::InsideRule, std::vector<SurfacePlace>>;
using SurfacePlacesByBlock = std::map<volume::BlockId, SurfacePlaces>;

SurfacePlacesByBlock SurfacePlacesOf(const volume::GridGeometry& geometry,
                                     const std::vector<SurfacePoint>& points) {
  const math::Mat4d index_from_world = geometry.index_from_world();
  SurfacePlacesByBlock places;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const math::Vec3d position = math::TransformPoint(index_from_world, points[i].position);
    if (points[i].block_id.has_value() && math::IsFinite(position)) {
      places[*points[i].block_id][points[i].rule].push_back({i, position});
    }
  }
  return places;
}

absl::Status ReadOneBlock(const store::ShardReader& reader, std::uint32_t ordinal,
                          absl::FunctionRef<absl::Status(const volume::BlockSamples&)> visit) {
  const std::array<std::uint32_t, 1> ordinals = {ordinal};
  for (const store::ShardReader::DiskRun& run : reader.PlanDiskRuns(ordinals)) {
    std::string buffer(static_cast<std::size_t>(run.size), '\0');
    ISOSCOPE_RETURN_IF_ERROR(reader.ReadDiskRun(run, ordinals, buffer.data(), visit));
  }
  return absl::OkStatus();
}

double SampleAt(const volume::BlockLayout& layout, const volume::BlockSamples& samples,
                const math::Index3& at) {
  const math::IndexBox stored = layout.StoredSamplesOf(samples.block_id);
  const math::Index3 dims = stored.dims();
  const math::Index3 local = at - stored.begin;
  const auto index = static_cast<std::size_t>(local.x + dims.x * (local.y + dims.y * local.z));
  return volume::VisitScalarType(samples.type, [&]<typename T>() {
    return static_cast<double>(base::LoadLittleEndian<T>(samples.bytes + index * sizeof(T)));
  });
}

double SquaredDistance(const math::Vec3d& a, const math::Vec3d& b) {
  return math::Dot(a - b, a - b);
}

// The nearest inside sample that the block stores; of those that are as near, the first.
std::optional<double> NearestLabel(const volume::BlockLayout& layout,
                                   const volume::BlockSamples& samples,
                                   const volume::InsideRule& rule, const math::Vec3d& position) {
  const math::IndexBox stored = layout.StoredSamplesOf(samples.block_id);
  std::optional<double> label;
  double least = std::numeric_limits<double>::infinity();
  for (std::int64_t z = stored.begin.z; z < stored.end.z; ++z) {
    for (std::int64_t y = stored.begin.y; y < stored.end.y; ++y) {
      for (std::int64_t x = stored.begin.x; x < stored.end.x; ++x) {
        const double distance = SquaredDistance(
            {static_cast<double>(x), static_cast<double>(y), static_cast<double>(z)}, position);
        const double sample = SampleAt(layout, samples, {x, y, z});
        if (distance < least && rule.IsInside(sample)) {
          least = distance;
          label = sample;
        }
      }
    }
  }
  return label;
}

// The cell of a point, or the nearest one whose samples the block stores.
math::Index3 StoredCellAt(const volume::BlockLayout& layout, const volume::BlockSamples& samples,
                          const math::Vec3d& position) {
  const math::IndexBox stored = layout.StoredSamplesOf(samples.block_id);
  math::Index3 cell = volume::CellAt(layout, position);
  for (int axis = 0; axis < 3; ++axis) {
    cell[axis] = std::clamp(cell[axis], stored.begin[axis], stored.end[axis] - 2);
  }
  return cell;
}

double ValueOfCell(const volume::BlockLayout& layout, const volume::BlockSamples& samples,
                   const math::Vec3d& position) {
  const math::Index3 cell = StoredCellAt(layout, samples, position);
  const math::IndexBox stored = layout.StoredSamplesOf(samples.block_id);
  return volume::ValueInCell(volume::SamplesOfCell(samples, stored, cell), cell, position);
}

std::optional<double> LabelOfCell(const volume::BlockLayout& layout,
                                  const volume::BlockSamples& samples,
                                  const volume::InsideRule& rule, const math::Vec3d& position) {
  const math::Index3 cell = StoredCellAt(layout, samples, position);
  const math::IndexBox stored = layout.StoredSamplesOf(samples.block_id);
  return extract::LabelInCell(volume::SamplesOfCell(samples, stored, cell), cell, position, rule);
}

// Answers for the points of one block after the other.
class PointReader {
 public:
  // All of them outlive the reader.
  PointReader(const Shards& shards, const ColorVolumes& volumes, std::size_t volume_count,
              const std::vector<SurfacePoint>& points)
      : shards_(shards),
        volumes_(volumes),
        points_(points),
        volume_count_(volume_count),
        layout_(shards.front()->reader->layout()),
        extractor_(shards.front()->reader->manifest().geometry, layout_) {}

  absl::Status Read(std::size_t shard_index, std::uint32_t ordinal, SurfacePlaces* places,
                    const base::Cancellation& cancellation) {
    const store::ShardReader& reader = *shards_[shard_index]->reader;
    ISOSCOPE_RETURN_IF_ERROR(volumes_.CheckBlock(shard_index, ordinal, reader.block_id(ordinal)));
    return ReadOneBlock(reader, ordinal, [&](const volume::BlockSamples& samples) -> absl::Status {
      FindTriangles(samples, places);
      for (std::size_t volume = 0; volume < volume_count_; ++volume) {
        ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
        ISOSCOPE_RETURN_IF_ERROR(ReadOneBlock(*volumes_.ShardOf(shard_index, volume)->reader,
                                              ordinal, [&](const volume::BlockSamples& field) {
                                                AddValues(samples, field, volume, *places);
                                                return absl::OkStatus();
                                              }));
      }
      return absl::OkStatus();
    });
  }

  std::vector<PointValues> Take() {
    std::vector<PointValues> found;
    for (auto& [point_index, values] : found_) {
      found.push_back(std::move(values));
    }
    return found;
  }

 private:
  void FindTriangles(const volume::BlockSamples& samples, SurfacePlaces* places) {
    for (auto& [rule, surface_places] : *places) {
      const mesh::BlockMeshView mesh = extractor_.Extract(samples, rule);
      for (SurfacePlace& place : surface_places) {
        const bool is_on_cap = points_[place.point_index].is_on_cap;
        if (!is_on_cap) {
          place.on_surface = mesh::NearestPoint(mesh, place.position);
        }
        if (rule.has_labels()) {
          PointValues& found = FoundOf(place);
          found.label =
              is_on_cap ? std::nullopt : LabelOfCell(layout_, samples, rule, place.position);
          if (!found.label.has_value()) {
            found.label = NearestLabel(layout_, samples, rule, place.position);
          }
        }
      }
    }
  }

  void AddValues(const volume::BlockSamples& samples, const volume::BlockSamples& field,
                 std::size_t volume, const SurfacePlaces& places) {
    for (const auto& [rule, surface_places] : places) {
      const mesh::BlockMeshView mesh = extractor_.ExtractWithField(samples, rule, field);
      for (const SurfacePlace& place : surface_places) {
        std::vector<double>& values = FoundOf(place).values;
        values.resize(volume_count_, std::numeric_limits<double>::quiet_NaN());
        values[volume] = place.on_surface.has_value()
                             ? mesh::ValueAt(mesh.values, *place.on_surface)
                             : ValueOfCell(layout_, field, place.position);
      }
    }
  }

  PointValues& FoundOf(const SurfacePlace& place) {
    PointValues& found = found_[place.point_index];
    found.point_index = place.point_index;
    return found;
  }

  const Shards& shards_;
  const ColorVolumes& volumes_;
  const std::vector<SurfacePoint>& points_;
  const std::size_t volume_count_;
  const volume::BlockLayout& layout_;
  extract::BlockExtractor extractor_;
  std::map<std::size_t, PointValues> found_;  // by point
};

}  // namespace

absl::StatusOr<std::vector<PointValues>> ValuesAt(const Shards& shards,
                                                  const std::vector<Shards>& volumes,
                                                  const std::vector<SurfacePoint>& points,
                                                  const base::Cancellation& cancellation) {
  ISOSCOPE_ASSIGN_OR_RETURN(const ColorVolumes checked, ColorVolumes::Make(shards, volumes));
  SurfacePlacesByBlock places =
      SurfacePlacesOf(shards.front()->reader->manifest().geometry, points);
  PointReader point_reader(shards, checked, volumes.size(), points);
  for (std::size_t shard = 0; shard < shards.size(); ++shard) {
    const store::ShardReader& reader = *shards[shard]->reader;
    for (std::uint32_t ordinal = 0; ordinal < reader.block_count(); ++ordinal) {
      if (const auto block_places = places.find(reader.block_id(ordinal));
          block_places != places.end()) {
        ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
        ISOSCOPE_RETURN_IF_ERROR(
            point_reader.Read(shard, ordinal, &block_places->second, cancellation));
      }
    }
  }
  return point_reader.Take();
}

}  // namespace isoscope::agent
