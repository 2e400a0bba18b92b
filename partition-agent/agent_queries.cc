// Questions of the coordinator that are no frames. Each AnswerQuery converts and checks its request
// before it looks for the shards, and counts nothing: the service does.
//
//   GetShardHistogram   counts by value, costs of isovalues, the label values of the samples
//   GetActiveBox        one shard is enough, because each has the ranges of all blocks
//   GetCellBox          reads on the threads of frames
//   GetResolvedBlocks   so does this, blocks of a level; active blocks of level 0 are in any shard
//   GetDepthBounds      any shard, too; the parts divide the volume's blocks, not its shards
//   GetGradients        gradient, shard, values and label of picked points; a point is answered by
//                       the shard that has its block
//
// DescribePlain, AddSeries, AddOpening and AddDamages make the answer of DescribeShards.

#include "partition-agent/agent_queries.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "core/base/version.h"
#include "core/frame/frame_spec.h"
#include "core/volume/volume_level.h"
#include "partition-agent/shard/point_gradients.h"
#include "partition-agent/shard/shard_histogram.h"
#include "partition-agent/shard/shard_label_values.h"
#include "partition-agent/supply/block_bounds.h"
#include "partition-agent/supply/cell_box.h"
#include "partition-agent/supply/level_resolution.h"
#include "partition-agent/supply/point_values.h"
#include "wire/depth_bounds_convert.h"
#include "wire/frame_convert.h"
#include "wire/histogram_convert.h"
#include "wire/pick_convert.h"
#include "wire/proto_convert.h"
#include "wire/series_convert.h"

namespace isoscope::agent {

namespace v1 = isoscope::internal::v1;

namespace {

void SortShards(v1::DescribeShardsResponse* description) {
  std::sort(description->mutable_shards()->begin(), description->mutable_shards()->end(),
            [](const v1::ShardDescription& a, const v1::ShardDescription& b) {
              return std::pair(a.dataset().name(), a.shard_index()) <
                     std::pair(b.dataset().name(), b.shard_index());
            });
}

v1::LevelsDescription DescribeLevels(const std::vector<int>& levels, volume::LevelFilter filter) {
  v1::LevelsDescription description;
  for (const int level : levels) {
    description.add_levels(level);
  }
  description.set_filter(filter == volume::LevelFilter::kMean
                             ? isoscope::v1::DatasetLevel::FILTER_MEAN
                             : isoscope::v1::DatasetLevel::FILTER_MAJORITY);
  return description;
}

// The rules of a question about active blocks or cells.
template <typename Request>
absl::StatusOr<std::vector<volume::InsideRule>> RulesOf(const Request& request) {
  if (request.isovalues().empty() && request.label_sets().empty()) {
    return absl::InvalidArgumentError(
        "isovalues is empty: must name at least one, unless there are label_sets");
  }
  std::vector<volume::InsideRule> rules;
  for (const double isovalue : request.isovalues()) {
    ISOSCOPE_RETURN_IF_ERROR(wire::CheckFinite(isovalue, "isovalues"));
    rules.push_back(volume::InsideRule::OfIsovalue(isovalue));
  }
  for (int i = 0; i < request.label_sets_size(); ++i) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        rules.emplace_back(),
        wire::LabelsFromProto(request.label_sets(i).labels(), /*smooths=*/false,
                              absl::StrCat("label_sets[", i, "].labels")));
  }
  return rules;
}

// The active blocks as a tree: a large volume keeps it, that of another is made of its set.
absl::StatusOr<std::shared_ptr<const volume::BlockTree>> ActiveTreeOf(
    const store::ShardReader& reader, const volume::InsideRule& rule) {
  const volume::BlockLayout& layout = reader.layout();
  if (layout.block_count() > volume::kMaxDenseBlocks) {
    return reader.ActiveTree(rule);
  }
  return std::make_shared<const volume::BlockTree>(layout.block_dims(), *reader.ActiveBlocks(rule));
}

// Adds the labels, and the values of scalar volumes, that a request asks for.
absl::Status AddValues(const ShardSet& shards, const v1::GetGradientsRequest& request,
                       const Shards& found, const std::vector<math::Vec3d>& points,
                       const std::vector<std::optional<volume::BlockId>>& block_ids,
                       const base::Cancellation& cancellation, v1::GetGradientsResponse* response) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<wire::PickedSurface> surfaces,
                            wire::PickedSurfacesFromProto(request));
  if (surfaces.empty()) {
    return absl::OkStatus();
  }
  std::vector<SurfacePoint> surface_points;
  for (std::size_t i = 0; i < points.size(); ++i) {
    surface_points.push_back({points[i], block_ids[i], surfaces[i].rule, surfaces[i].is_on_cap});
  }
  std::vector<Shards> volumes;
  for (const std::string& id : request.values().dataset_ids()) {
    ISOSCOPE_ASSIGN_OR_RETURN(volumes.emplace_back(), shards.Find(id, request.shard_indices()));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<PointValues> values,
                            ValuesAt(found, volumes, surface_points, cancellation));
  for (const PointValues& point : values) {
    const auto point_index = static_cast<std::int32_t>(point.point_index);
    if (!volumes.empty()) {
      v1::PointValues* const out = response->add_values();
      out->set_point_index(point_index);
      out->mutable_values()->Assign(point.values.begin(), point.values.end());
    }
    if (point.label.has_value()) {
      v1::PointLabel* const out = response->add_labels();
      out->set_point_index(point_index);
      out->set_label(*point.label);
    }
  }
  return absl::OkStatus();
}

}  // namespace

v1::DescribeShardsResponse DescribePlain(const Shards& shards, const render::Renderer& renderer) {
  v1::DescribeShardsResponse description;
  description.set_version(std::string(base::Version()));
  description.set_renderer(renderer.description());
  *description.mutable_picture_revision() = wire::ToProto(renderer.picture_revision());
  for (const std::shared_ptr<const Shard>& shard : shards) {
    const store::ShardReader& reader = *shard->reader;
    v1::ShardDescription* const out = description.add_shards();
    *out->mutable_dataset() = wire::ToProto(reader.manifest());
    out->set_manifest_crc32c(reader.manifest_crc32c());
    out->set_range_table_crc32c(reader.manifest().range_table_crc32c);
    out->set_shard_index(reader.shard_index());
    out->set_block_count(reader.block_count());
    std::vector<int> levels;
    for (std::size_t i = 0; i < shard->levels.size(); ++i) {
      if (shard->levels[i] != nullptr) {
        levels.push_back(static_cast<int>(i) + 1);
      }
    }
    if (!levels.empty()) {
      *out->mutable_levels() = DescribeLevels(levels, reader.manifest().level_filter);
    }
  }
  SortShards(&description);
  return description;
}

void AddSeries(const ShardSet& shards, v1::DescribeShardsResponse* description) {
  if (shards.series().empty()) {
    return;
  }
  for (const std::shared_ptr<SeriesShard>& shard : shards.series()) {
    shard->Refresh();
    const std::shared_ptr<const SeriesShard::Served> served = shard->served();
    v1::ShardDescription* const out = description->add_shards();
    *out->mutable_dataset() = wire::ToProto(served->manifest);
    out->set_shard_index(shard->shard_index());
    for (std::size_t i = 0; i < served->volumes.size(); ++i) {
      v1::VolumeDescription* const volume = out->add_volumes();
      *volume = wire::ToProto(served->volumes[i]);
      if (!served->levels[i].empty()) {
        *volume->mutable_levels() =
            DescribeLevels(served->levels[i], served->volumes[i].level_filter);
      }
    }
  }
  SortShards(description);
}

void AddOpening(const OpeningProgress& progress, v1::DescribeShardsResponse* description) {
  isoscope::v1::OpeningProgress* const out = description->mutable_opening();
  out->set_shard_count(progress.shard_count);
  out->set_open_shard_count(progress.open_shard_count);
  out->set_table_bytes(progress.table_bytes);
  out->set_read_bytes(progress.read_bytes);
  description->mutable_opening_datasets()->Assign(progress.datasets.begin(),
                                                  progress.datasets.end());
}

void AddDamages(const std::vector<ShardDamage>& damages, v1::DescribeShardsResponse* description) {
  for (const ShardDamage& damage : damages) {
    isoscope::v1::DamagedShard* const out = description->add_damaged_shards();
    out->set_dataset(damage.dataset);
    out->set_shard_index(damage.shard_index);
    out->set_message(damage.message);
  }
}

absl::Status AnswerQuery(const ShardSet& shards, const v1::GetShardHistogramRequest& request,
                         const base::Cancellation& cancellation,
                         v1::GetShardHistogramResponse* response) {
  ISOSCOPE_ASSIGN_OR_RETURN(const wire::HistogramQuery query,
                            wire::HistogramQueryFromProto(request));
  ISOSCOPE_ASSIGN_OR_RETURN(const Shards found,
                            shards.Find(request.dataset_id(), request.shard_indices()));
  ISOSCOPE_ASSIGN_OR_RETURN(volume::HistogramPart part,
                            HistogramOfShards(found, query.max_bin_count, query.value_range));
  if (query.max_label_value_count > 0) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        part.label_values, LabelValuesOfShards(found, query.max_label_value_count, cancellation));
  }
  *response = wire::ToProto(part);
  return absl::OkStatus();
}

absl::Status AnswerQuery(const ShardSet& shards, const v1::GetActiveBoxRequest& request,
                         const base::Cancellation& /*cancellation*/,
                         v1::GetActiveBoxResponse* response) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<volume::InsideRule> rules, RulesOf(request));
  ISOSCOPE_ASSIGN_OR_RETURN(const view::ClipRegion clip,
                            wire::ClipRegionFromProto(request.clip(), "clip"));
  ISOSCOPE_ASSIGN_OR_RETURN(const int level, wire::LevelFromProto(request.level(), "level"));
  ISOSCOPE_ASSIGN_OR_RETURN(const LevelShards found, shards.FindAny(request.dataset_id(), level));
  for (volume::InsideRule& rule : rules) {
    rule = frame::InStoredValues(std::move(rule), found.value_scale);
  }
  const store::ShardReader& reader = *found.shards.front()->reader;
  ISOSCOPE_ASSIGN_OR_RETURN(
      const ActiveBox box,
      ActiveBoxOf(reader, rules, view::Clipper(clip, reader.manifest().geometry)));
  *response = wire::ToProto(box.block_count, box.cells);
  return absl::OkStatus();
}

absl::Status AnswerQuery(const ShardSet& shards, const AgentResources& resources,
                         const v1::GetCellBoxRequest& request,
                         const base::Cancellation& cancellation, v1::GetCellBoxResponse* response) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<volume::InsideRule> rules, RulesOf(request));
  ISOSCOPE_ASSIGN_OR_RETURN(const view::ClipRegion clip,
                            wire::ClipRegionFromProto(request.clip(), "clip"));
  ISOSCOPE_ASSIGN_OR_RETURN(const Shards found,
                            shards.Find(request.dataset_id(), request.shard_indices()));
  ISOSCOPE_ASSIGN_OR_RETURN(const math::IndexBox cells,
                            CellBoxOfShards(found, rules, clip, resources, cancellation));
  *response = wire::ToProto(cells);
  return absl::OkStatus();
}

absl::Status AnswerQuery(const ShardSet& shards, const AgentResources& resources,
                         const v1::GetDepthBoundsRequest& request,
                         const base::Cancellation& cancellation,
                         v1::GetDepthBoundsResponse* response) {
  ISOSCOPE_ASSIGN_OR_RETURN(const wire::DepthBoundsQuery query,
                            wire::DepthBoundsQueryFromProto(request));
  ISOSCOPE_ASSIGN_OR_RETURN(const LevelShards found, shards.FindAny(request.dataset_id()));
  const store::ShardReader& reader = *found.shards.front()->reader;
  ISOSCOPE_ASSIGN_OR_RETURN(const view::View view,
                            view::View::Make(*query.spec.camera, query.spec.viewport,
                                             reader.manifest().geometry, query.spec.region));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const visibility::DepthBounds bounds,
      BoundsOfPart(reader, view, query.spec, {query.part_index, query.part_count}, resources.arena,
                   cancellation));
  *response = wire::ToProto(bounds);
  return absl::OkStatus();
}

absl::Status AnswerQuery(const ShardSet& shards, const AgentResources& resources,
                         const v1::GetResolvedBlocksRequest& request,
                         const base::Cancellation& cancellation,
                         v1::GetResolvedBlocksResponse* response) {
  ISOSCOPE_ASSIGN_OR_RETURN(
      const volume::InsideRule rule,
      wire::InsideRuleFromProto(request.isovalue(), request.labels(), /*smooths=*/false, ""));
  ISOSCOPE_ASSIGN_OR_RETURN(const int level, wire::LevelFromProto(request.level(), "level"));
  if (level == 0) {
    return absl::InvalidArgumentError("level is 0: must be at least 1");
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const LevelShards fine, shards.FindAny(request.dataset_id()));
  ISOSCOPE_ASSIGN_OR_RETURN(const LevelShards coarse,
                            shards.FindLevel(request.dataset_id(), request.shard_indices(), level));
  const store::ShardReader& reader = *fine.shards.front()->reader;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const volume::BlockTree> active,
                            ActiveTreeOf(reader, rule));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::vector<volume::BlockId> resolved,
      BlocksResolvedBy(coarse.shards, frame::InStoredValues(rule, coarse.value_scale),
                       {.fine = &reader.layout(), .fine_active = active.get(), .level = level},
                       resources, cancellation));
  *response->mutable_blocks() = wire::ToProto(resolved);
  response->set_active_block_count(active->count());
  return absl::OkStatus();
}

absl::Status AnswerQuery(const ShardSet& shards, const v1::GetGradientsRequest& request,
                         const base::Cancellation& cancellation,
                         v1::GetGradientsResponse* response) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<math::Vec3d> points,
                            wire::PickedPointsFromProto(request));
  ISOSCOPE_ASSIGN_OR_RETURN(const Shards found,
                            shards.Find(request.dataset_id(), request.shard_indices()));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::vector<std::optional<volume::BlockId>> block_ids,
      wire::PickedBlocksFromProto(request, found.front()->reader->layout().block_count()));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<PointGradient> gradients,
                            GradientsAt(found, points, cancellation));
  for (const PointGradient& gradient : gradients) {
    v1::PointGradient* const out = response->add_gradients();
    out->set_point_index(static_cast<std::int32_t>(gradient.point_index));
    *out->mutable_gradient() = wire::ToProto(gradient.gradient);
  }
  for (const PointShard& shard : ShardsOf(found, block_ids)) {
    v1::PointShard* const out = response->add_shards();
    out->set_point_index(static_cast<std::int32_t>(shard.point_index));
    out->set_shard_index(shard.shard_index);
  }
  return AddValues(shards, request, found, points, block_ids, cancellation, response);
}

}  // namespace isoscope::agent
