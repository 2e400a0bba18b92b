#include "partition-agent/memory/agent_metrics.h"

#include <utility>

namespace isoscope::agent {
namespace {

using base::MetricFamily;
using base::MetricLabels;
using base::MetricSample;

template <typename Number>
MetricSample Value(Number value, MetricLabels labels = {}) {
  return MetricSample::Of(static_cast<double>(value), std::move(labels));
}
MetricSample Value(const base::Counter& counter, MetricLabels labels = {}) {
  return Value(counter.value(), std::move(labels));
}

struct FamilyList {
  void Counter(const char* name, const char* help, std::vector<MetricSample> samples) {
    Add(MetricFamily::Type::kCounter, name, help, std::move(samples));
  }
  void Gauge(const char* name, const char* help, std::vector<MetricSample> samples) {
    Add(MetricFamily::Type::kGauge, name, help, std::move(samples));
  }
  void Histogram(const char* name, const char* help, std::vector<MetricSample> samples) {
    Add(MetricFamily::Type::kHistogram, name, help, std::move(samples));
  }

  void Add(MetricFamily::Type type, const char* name, const char* help,
           std::vector<MetricSample> samples) {
    families.push_back({.name = name, .help = help, .type = type, .samples = std::move(samples)});
  }

  std::vector<MetricFamily> families;
};

void AddFrames(const AgentMetrics& metrics, const AgentGauges& gauges, FamilyList* list) {
  list->Counter("isoscope_agent_frames_total", "Parts of frames that ended, by outcome.",
                {Value(metrics.done_frames, {{"outcome", "done"}}),
                 Value(metrics.failed_frames, {{"outcome", "failed"}}),
                 Value(metrics.cancelled_frames, {{"outcome", "cancelled"}})});
  list->Counter("isoscope_agent_busy_seconds_total",
                "Work on frames that ended well: everything but waiting for the coordinator.",
                {Value(metrics.busy.seconds())});
  list->Histogram("isoscope_agent_step_duration_seconds",
                  "Time of each step of a frame, without waiting for the coordinator.",
                  {MetricSample::Of(metrics.select_occluders, {{"step", "select_occluders"}}),
                   MetricSample::Of(metrics.render_occluders, {{"step", "render_occluders"}}),
                   MetricSample::Of(metrics.render_visible, {{"step", "render_visible"}}),
                   MetricSample::Of(metrics.encode, {{"step", "encode"}})});
  list->Histogram("isoscope_agent_wait_seconds",
                  "Time that steps waited before they began: for a thread, and for memory.",
                  {MetricSample::Of(metrics.queue_wait, {{"for", "thread"}}),
                   MetricSample::Of(metrics.memory_wait, {{"for", "memory"}})});
  list->Gauge("isoscope_agent_frames_in_work", "Frames that have begun and not ended.",
              {Value(gauges.frames)});
  list->Gauge("isoscope_agent_limit_frames",
              "Most frames that may have begun (--max-concurrent-frames plus --max-queued-frames).",
              {Value(gauges.max_frames)});
}

void AddBlocks(const AgentMetrics& metrics, const AgentGauges& gauges, FamilyList* list) {
  list->Counter("isoscope_agent_triangles_total", "Triangles drawn for frames.",
                {Value(metrics.triangles)});
  list->Counter("isoscope_agent_blocks_total", "Blocks drawn for frames.",
                {Value(metrics.drawn_blocks)});
  list->Counter("isoscope_agent_reads_total",
                "Reads of blocks: stretches of up to 1 MiB of a shard.", {Value(metrics.reads)});
  list->Counter("isoscope_agent_read_bytes_total",
                "Bytes of blocks and index pages read from shards.", {Value(metrics.read_bytes)});
  list->Counter("isoscope_agent_read_wait_seconds_total",
                "Time of steps that had nothing to do but wait for reads.",
                {Value(metrics.read_wait.seconds())});
  std::vector<MetricSample> lookups;
  for (const auto& [cache, counts] :
       {std::pair("meshes", &metrics.mesh_lookups), std::pair("samples", &metrics.sample_lookups),
        std::pair("active_blocks", &metrics.active_lookups)}) {
    lookups.push_back(Value(counts->hits, {{"cache", cache}, {"result", "hit"}}));
    lookups.push_back(Value(counts->misses, {{"cache", cache}, {"result", "miss"}}));
  }
  list->Counter("isoscope_cache_lookups_total", "Looks into a cache, by result.",
                std::move(lookups));
  list->Gauge("isoscope_cache_bytes", "Memory of what a cache holds.",
              {Value(gauges.mesh_cache_bytes, {{"cache", "meshes"}}),
               Value(gauges.sample_cache_bytes, {{"cache", "samples"}}),
               Value(gauges.active_cache_bytes, {{"cache", "active_blocks"}})});
  list->Counter("isoscope_agent_steps_ahead_total",
                "Time steps that were read ahead of a frame, by whether a frame asked for them.",
                {Value(metrics.steps_ahead.used, {{"outcome", "used"}}),
                 Value(metrics.steps_ahead.wasted, {{"outcome", "wasted"}})});
  list->Gauge("isoscope_agent_shards", "Shards that the agent serves.",
              {Value(gauges.shard_count)});
  list->Gauge("isoscope_agent_opening_shards", "Shards that the agent is opening; 0: all are open.",
              {Value(gauges.opening_shard_count)});
  list->Gauge("isoscope_agent_damaged_shards", "Shards with files that could not be read.",
              {Value(gauges.damaged_shard_count)});
}

}  // namespace

AgentMetrics::AgentMetrics()
    : requests_({"DescribeShards", "RenderFrame", "ExtractSurface", "GetShardHistogram",
                 "GetActiveBox", "GetCellBox", "GetGradients", "GetDepthBounds",
                 "GetResolvedBlocks"}) {}

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
  FamilyList list{
      base::ProcessMetrics("isoscope-agent", static_cast<std::int64_t>(gauges.memory_limit_bytes))};
  list.Counter("isoscope_requests_total", "Calls that ended, by method and status code.",
               requests_.Counts());
  list.Histogram("isoscope_request_duration_seconds", "Time of calls, by method.",
                 requests_.Durations());
  list.Gauge("isoscope_certificate_days_left",
             "Days until the own certificate expires; 0 if it can't be read, infinity without one.",
             {Value(gauges.certificate_days_left)});
  list.Counter(
      "isoscope_reload_failures_total",
      "Files that were wrong, or could not be read, after a change; what was read before holds.",
      {Value(gauges.certificate_failures, {{"file", "certificate"}})});
  AddFrames(*this, gauges, &list);
  AddBlocks(*this, gauges, &list);
  return std::move(list.families);
}

}  // namespace isoscope::agent
