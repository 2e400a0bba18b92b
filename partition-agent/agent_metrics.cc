#include "partition-agent/agent_metrics.h"

#include <cstdint>
#include <utility>

namespace isoscope::agent {
namespace {

using base::MetricFamily;
using base::MetricLabels;
using base::MetricSample;

MetricSample Value(double value, MetricLabels labels = {}) {
  return MetricSample::Of(value, std::move(labels));
}

MetricSample Value(const base::Counter& counter, MetricLabels labels = {}) {
  return MetricSample::Of(static_cast<double>(counter.value()), std::move(labels));
}

MetricFamily Of(MetricFamily::Type type, const char* name, const char* help,
                std::vector<MetricSample> samples) {
  return {.name = name, .help = help, .type = type, .samples = std::move(samples)};
}

void AppendFrames(const AgentMetrics& metrics, const AgentGauges& gauges,
                  std::vector<MetricFamily>* families) {
  using Type = MetricFamily::Type;
  families->push_back(Of(Type::kCounter, "isoscope_agent_frames_total",
                         "Parts of frames that ended, by outcome.",
                         {Value(metrics.done_frames, {{"outcome", "done"}}),
                          Value(metrics.failed_frames, {{"outcome", "failed"}}),
                          Value(metrics.cancelled_frames, {{"outcome", "cancelled"}})}));
  families->push_back(Of(Type::kCounter, "isoscope_agent_busy_seconds_total",
                         "Work on frames that ended well: everything but waiting for the "
                         "coordinator.",
                         {Value(metrics.busy.seconds())}));
  families->push_back(
      Of(Type::kHistogram, "isoscope_agent_step_duration_seconds",
         "Time of each step of a frame, without waiting for the coordinator.",
         {MetricSample::Of(metrics.select_occluders, {{"step", "select_occluders"}}),
          MetricSample::Of(metrics.render_occluders, {{"step", "render_occluders"}}),
          MetricSample::Of(metrics.render_visible, {{"step", "render_visible"}}),
          MetricSample::Of(metrics.encode, {{"step", "encode"}})}));
  families->push_back(Of(Type::kHistogram, "isoscope_agent_wait_seconds",
                         "Time that steps waited before they began: for a thread, and for memory.",
                         {MetricSample::Of(metrics.queue_wait, {{"for", "thread"}}),
                          MetricSample::Of(metrics.memory_wait, {{"for", "memory"}})}));
  families->push_back(Of(Type::kGauge, "isoscope_agent_frames_in_work",
                         "Frames that have begun and not ended.",
                         {Value(static_cast<double>(gauges.frames))}));
  families->push_back(Of(Type::kGauge, "isoscope_agent_limit_frames",
                         "Most frames that may have begun (--max-concurrent-frames plus "
                         "--max-queued-frames).",
                         {Value(static_cast<double>(gauges.max_frames))}));
}

void AppendBlocks(const AgentMetrics& metrics, const AgentGauges& gauges,
                  std::vector<MetricFamily>* families) {
  using Type = MetricFamily::Type;
  families->push_back(Of(Type::kCounter, "isoscope_agent_triangles_total",
                         "Triangles drawn for frames.", {Value(metrics.triangles)}));
  families->push_back(Of(Type::kCounter, "isoscope_agent_blocks_total", "Blocks drawn for frames.",
                         {Value(metrics.drawn_blocks)}));
  families->push_back(Of(Type::kCounter, "isoscope_agent_reads_total",
                         "Reads of blocks: stretches of up to 1 MiB of a shard.",
                         {Value(metrics.reads)}));
  families->push_back(Of(Type::kCounter, "isoscope_agent_read_bytes_total",
                         "Bytes of blocks and index pages read from shards.",
                         {Value(metrics.read_bytes)}));
  families->push_back(Of(Type::kCounter, "isoscope_agent_read_wait_seconds_total",
                         "Time of steps that had nothing to do but wait for reads.",
                         {Value(metrics.read_wait.seconds())}));
  const auto lookup = [](const base::Counter& counter, const char* cache, const char* result) {
    return Value(counter, {{"cache", cache}, {"result", result}});
  };
  families->push_back(
      Of(Type::kCounter, "isoscope_cache_lookups_total", "Looks into a cache, by result.",
         {lookup(metrics.mesh_hits, "meshes", "hit"), lookup(metrics.mesh_misses, "meshes", "miss"),
          lookup(metrics.sample_hits, "samples", "hit"),
          lookup(metrics.sample_misses, "samples", "miss"),
          lookup(metrics.active_hits, "active_blocks", "hit"),
          lookup(metrics.active_misses, "active_blocks", "miss")}));
  families->push_back(
      Of(Type::kGauge, "isoscope_cache_bytes", "Memory of what a cache holds.",
         {Value(static_cast<double>(gauges.mesh_cache_bytes), {{"cache", "meshes"}}),
          Value(static_cast<double>(gauges.sample_cache_bytes), {{"cache", "samples"}}),
          Value(static_cast<double>(gauges.active_cache_bytes), {{"cache", "active_blocks"}})}));
  families->push_back(Of(Type::kGauge, "isoscope_agent_shards", "Shards that the agent serves.",
                         {Value(static_cast<double>(gauges.shard_count))}));
}

}  // namespace

AgentMetrics::AgentMetrics()
    : requests_({"DescribeShards", "RenderFrame", "ExtractSurface", "GetShardHistogram",
                 "GetActiveBox", "GetGradients"}) {}

void AgentMetrics::CountRequest(AgentMethod method, const absl::Status& status,
                                absl::Duration duration) {
  requests_.Count(static_cast<std::size_t>(method), status.code(), duration);
}

void AgentMetrics::CountFrame(const absl::Status& status, absl::Duration busy_duration) {
  if (status.ok()) {
    done_frames.Add();
    busy.Add(busy_duration);
  } else {
    (absl::IsCancelled(status) ? cancelled_frames : failed_frames).Add();
  }
}

std::vector<MetricFamily> AgentMetrics::Collect(const AgentGauges& gauges) const {
  using Type = MetricFamily::Type;
  std::vector<MetricFamily> families =
      base::ProcessMetrics("isoscope-agent", static_cast<std::int64_t>(gauges.memory_limit_bytes));
  families.push_back(Of(Type::kCounter, "isoscope_requests_total",
                        "Calls that ended, by method and status code.", requests_.Counts()));
  families.push_back(Of(Type::kHistogram, "isoscope_request_duration_seconds",
                        "Time of calls, by method.", requests_.Durations()));
  families.push_back(Of(Type::kGauge, "isoscope_certificate_days_left",
                        "Days until the own certificate expires; 0 if it can't be read, infinity "
                        "without one.",
                        {Value(gauges.certificate_days_left)}));
  families.push_back(
      Of(Type::kCounter, "isoscope_reload_failures_total",
         "Files that were wrong, or could not be read, after a change; what was read before holds.",
         {MetricSample::Of(static_cast<double>(gauges.certificate_failures),
                           {{"file", "certificate"}})}));
  AppendFrames(*this, gauges, &families);
  AppendBlocks(*this, gauges, &families);
  return families;
}

}  // namespace isoscope::agent
