#include "partition-agent/agent_context.h"

#include <cstddef>
#include <utility>

#include "core/render/cpu_renderer.h"

namespace isoscope::agent {
namespace {

// Steps of one frame on the executor at a time. A step sends its answer, and the next one may be
// scheduled, before the task of the first has ended. Refused frames never get there, so the steps
// of each admitted frame fit.
constexpr std::size_t kStepCount = 3;
// A coordinator in the same process finishes a picture after the agents' frames have ended. If no
// frame comes for this long, it has most likely done so.
constexpr absl::Duration kIdleOfCoordinator = absl::Milliseconds(20);

std::shared_ptr<base::Executor> FrameExecutorOf(const AgentServerOptions& options, int max_frames) {
  return options.frame_executor != nullptr
             ? options.frame_executor
             : std::make_shared<base::Executor>(
                   static_cast<std::size_t>(options.max_concurrent_frames),
                   static_cast<std::size_t>(max_frames));
}

}  // namespace

AgentContext::AgentContext(const AgentServerOptions& server_options)
    : options(server_options),
      damages(server_options.hides_paths),
      cpu_renderer(
          options.renderer->picture_revision().back_end == frame::BackEnd::kEgl
              ? render::MakeCpuRenderer({.max_kept_bytes = options.memory->kept_mesh_bytes(),
                                         .max_unused_bytes = 0,
                                         .arena = options.arena})
              : nullptr),
      max_frames(options.max_concurrent_frames + options.max_queued_frames),
      play(&shards, options.memory.get(), &metrics, Resources(nullptr),
           options.mailboxes != nullptr ? kIdleOfCoordinator : absl::ZeroDuration(),
           PlayAhead::ModeOfEnvironment()),
      frame_executor(FrameExecutorOf(options, max_frames),
                     kStepCount * static_cast<std::size_t>(max_frames)),
      extraction_executor(kMaxConcurrentExtractions, kMaxQueuedExtractions),
      query_executor(kMaxConcurrentQueries, kMaxQueuedQueries),
      label_executor(kMaxConcurrentLabelQueries, kMaxQueuedLabelQueries) {}

void AgentContext::Serve(Shards plain, SeriesShards series) {
  for (const std::shared_ptr<const Shard>& shard : plain) {
    damages.AddShard(shard->reader->directory(), shard->reader->manifest().name,
                     shard->reader->shard_index(), shard->reader->source_name());
  }
  for (const std::shared_ptr<SeriesShard>& shard : series) {
    damages.AddShard(shard->directory(), shard->served()->manifest.name, shard->shard_index(),
                     shard->source());
    shard->WhenOpened([this](const std::string& directory) { damages.Forget(directory); });
  }
  if (!series.empty()) {
    series_executor = std::make_unique<base::Executor>(1, kMaxQueuedDescriptions);
  }
  shards.Fill(std::move(plain), std::move(series));
}

AgentResources AgentContext::Resources(base::TraceRecorder* trace) {
  return {.renderer = options.renderer.get(),
          .layers = options.memory->layers(),
          .cpu_renderer = cpu_renderer.get(),
          .arena = options.arena.get(),
          .cache = options.memory->cache(),
          .max_read_bytes = options.memory->read_bytes(),
          .trace = trace,
          .metrics = &metrics,
          .frames = options.memory->frames()};
}

AgentGauges AgentContext::Gauges() const {
  const BlockCache& cache = *options.memory->cache();
  return {.frames = frame_count.load(),
          .max_frames = max_frames,
          .shard_count = shards.size(),
          .opening_shard_count = shards.is_filled() ? 0 : opening.progress().shard_count,
          .damaged_shard_count = damages.damages().size(),
          .mesh_cache_bytes = cache.mesh_bytes(),
          .sample_cache_bytes = cache.sample_bytes(),
          .active_cache_bytes = cache.active_bytes(),
          .memory_limit_bytes = options.memory->limit_bytes()};
}

}  // namespace isoscope::agent
