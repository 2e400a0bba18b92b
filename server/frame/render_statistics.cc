#include "server/frame/render_statistics.h"

#include <cstddef>

#include "core/base/check.h"
#include "wire/proto_convert.h"

namespace isoscope::server {

FrameCost CostOf(const FrameResult& result) {
  FrameCost cost;
  for (const frame::AgentStatistics& agent : result.agents) {
    cost.total.active_block_count += agent.active_block_count;
    cost.total.occluding_block_count += agent.occluding_block_count;
    cost.total.visible_block_count += agent.visible_block_count;
    cost.total.triangle_count += agent.triangle_count;
    cost.total.unique_vertex_count += agent.unique_vertex_count;
    cost.total.read_bytes += agent.read_bytes;
    frame::AddTo(agent.surfaces, &cost.total.surfaces);
  }
  cost.agents = result.agents;
  cost.ray_hit_block_count = result.ray_hit_block_count;
  cost.network_bytes = result.network_bytes;
  cost.occluder_selection = result.occluder_selection_duration;
  cost.occluder_rendering = result.occluder_rendering_duration;
  cost.visibility_culling = result.visibility_culling_duration;
  cost.composite = result.composite_duration;
  return cost;
}

namespace {

void AddBand(const frame::AgentStatistics& band, bool has_surface, frame::AgentStatistics* sum) {
  if (has_surface) {
    sum->triangle_count += band.triangle_count;
    sum->unique_vertex_count += band.unique_vertex_count;
    frame::AddTo(band.surfaces, &sum->surfaces);
  }
  sum->read_bytes += band.read_bytes;
  sum->index_page_read_count += band.index_page_read_count;
  sum->extract_duration += band.extract_duration;
  sum->render_duration += band.render_duration;
  sum->busy_duration += band.busy_duration;
}

}  // namespace

void AddBand(const FrameCost& band, bool has_surface, FrameCost* cost) {
  ISOSCOPE_CHECK_EQ(band.agents.size(), cost->agents.size());
  AddBand(band.total, has_surface, &cost->total);
  for (std::size_t i = 0; i < band.agents.size(); ++i) {
    AddBand(band.agents[i], has_surface, &cost->agents[i]);
  }
  cost->network_bytes += band.network_bytes;
  cost->truncated_pixel_count += band.truncated_pixel_count;
  cost->occluder_selection += band.occluder_selection;
  cost->occluder_rendering += band.occluder_rendering;
  cost->visibility_culling += band.visibility_culling;
  cost->composite += band.composite;
  if (band.encode.has_value()) {
    cost->encode = cost->encode.value_or(absl::ZeroDuration()) + *band.encode;
  }
}

isoscope::v1::RenderStatistics ToProto(const FrameCost& cost) {
  isoscope::v1::RenderStatistics proto;
  const frame::AgentStatistics& total = cost.total;
  proto.set_active_block_count(total.active_block_count);
  proto.set_occluding_block_count(total.occluding_block_count);
  proto.set_visible_block_count(total.visible_block_count);
  proto.set_culled_block_count(total.active_block_count - total.visible_block_count);
  proto.set_triangle_count(total.triangle_count);
  proto.set_unique_vertex_count(total.unique_vertex_count);
  proto.set_read_bytes(total.read_bytes);
  for (const frame::AgentStatistics& agent : cost.agents) {
    *proto.add_agents() = wire::ToProto(agent);
  }
  for (const frame::SurfaceStatistics& surface : total.surfaces) {
    *proto.add_surfaces() = wire::ToProto(surface);
  }
  proto.set_ray_hit_block_count(cost.ray_hit_block_count);
  proto.set_network_bytes(cost.network_bytes);
  proto.set_png_bytes(cost.png_bytes);
  proto.set_truncated_pixel_count(cost.truncated_pixel_count);
  isoscope::v1::StepDurations& durations = *proto.mutable_durations();
  *durations.mutable_occluder_selection_duration() = wire::ToProto(cost.occluder_selection);
  *durations.mutable_occluder_rendering_duration() = wire::ToProto(cost.occluder_rendering);
  *durations.mutable_visibility_culling_duration() = wire::ToProto(cost.visibility_culling);
  *durations.mutable_composite_duration() = wire::ToProto(cost.composite);
  if (cost.encode.has_value()) {
    *durations.mutable_encode_duration() = wire::ToProto(*cost.encode);
  }
  proto.mutable_missing_shards()->Assign(cost.missing_shards.begin(), cost.missing_shards.end());
  if (cost.active_block_coverage.has_value()) {
    proto.set_active_block_coverage(*cost.active_block_coverage);
  }
  proto.set_band_count(cost.band_count);
  if (cost.unresolved_block_count.has_value()) {
    proto.set_unresolved_block_count(*cost.unresolved_block_count);
  }
  return proto;
}

}  // namespace isoscope::server
