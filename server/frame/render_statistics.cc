#include "server/frame/render_statistics.h"

#include <vector>

#include "wire/proto_convert.h"

namespace isoscope::server {

isoscope::v1::RenderStatistics StatisticsOf(const FrameResult& result) {
  isoscope::v1::RenderStatistics sum;
  std::vector<frame::SurfaceStatistics> surfaces;
  for (const frame::AgentStatistics& agent : result.agents) {
    sum.set_active_block_count(sum.active_block_count() + agent.active_block_count);
    sum.set_occluding_block_count(sum.occluding_block_count() + agent.occluding_block_count);
    sum.set_visible_block_count(sum.visible_block_count() + agent.visible_block_count);
    sum.set_triangle_count(sum.triangle_count() + agent.triangle_count);
    sum.set_unique_vertex_count(sum.unique_vertex_count() + agent.unique_vertex_count);
    sum.set_read_bytes(sum.read_bytes() + agent.read_bytes);
    *sum.add_agents() = wire::ToProto(agent);
    frame::AddTo(agent.surfaces, &surfaces);
  }
  for (const frame::SurfaceStatistics& surface : surfaces) {
    *sum.add_surfaces() = wire::ToProto(surface);
  }
  sum.set_ray_hit_block_count(result.ray_hit_block_count);
  sum.set_culled_block_count(sum.active_block_count() - sum.visible_block_count());
  sum.set_network_bytes(result.network_bytes);
  isoscope::v1::StepDurations* durations = sum.mutable_durations();
  *durations->mutable_occluder_selection_duration() =
      wire::ToProto(result.occluder_selection_duration);
  *durations->mutable_occluder_rendering_duration() =
      wire::ToProto(result.occluder_rendering_duration);
  *durations->mutable_visibility_culling_duration() =
      wire::ToProto(result.visibility_culling_duration);
  *durations->mutable_composite_duration() = wire::ToProto(result.composite_duration);
  return sum;
}

}  // namespace isoscope::server
