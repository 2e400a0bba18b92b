// A frame, with agents 0 and 1, all on the calling thread:
//
//   coordinator  asks agent 0 | asks agent 1 |  reduces  | orders 0 | orders 1 | ...
//   agents            works        works                   works      works
//
// server::RunFrame is the coordinator, IsolatedLink an agent: it computes each step inside the call
// that requests it, and its answer waits in the coordinator's queue. The frame's wall time minus
// the agents' busy times is the coordinator's own work, other_ms.
//
// Agents that alternate at each step find the processor's caches full of the others' data. So each
// agent's share is repeated without interruption, with the same messages of the coordinator
// (AgentOrders) and an empty block cache. busy_ms is the time of the repetition.

#include "bench/isolated_cluster.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"

#include "core/base/check.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/extract/block_extractor.h"
#include "core/store/shard_reader.h"
#include "core/view/view.h"
#include "core/volume/block_samples.h"
#include "core/volume/inside_rule.h"
#include "partition-agent/cache/block_cache.h"
#include "partition-agent/frame/frame_pipeline.h"
#include "partition-agent/supply/block_reads.h"
#include "partition-agent/supply/surface_blocks.h"
#include "server/frame/agent_link.h"
#include "server/frame/frame_coordinator.h"

namespace isoscope::bench {
namespace {

constexpr std::size_t kCacheBytes = std::size_t{1} << 30;

// The coordinator's messages to one agent in a frame: with them, the agent's share can be repeated.
struct AgentOrders {
  std::vector<volume::BlockId> occluding;
  std::vector<volume::BlockId> visible;
  std::string open_pixels;
};

void Append(const std::vector<volume::BlockId>& from, std::vector<volume::BlockId>* to) {
  to->insert(to->end(), from.begin(), from.end());
}

void SortUnique(std::vector<volume::BlockId>* blocks) {
  std::sort(blocks->begin(), blocks->end());
  blocks->erase(std::unique(blocks->begin(), blocks->end()), blocks->end());
}

// An agent that computes each step on the requesting thread, before that call returns. Its answer
// waits in the coordinator's queue until all others have been asked.
class IsolatedLink final : public server::AgentLink {
 public:
  // Adds the hits of its rays to `ray_hits`.
  IsolatedLink(const agent::FrameTask& task, std::vector<volume::BlockId>* ray_hits,
               AgentOrders* orders, agent::BlockCache* cache, server::AgentListener* listener)
      : task_(task),
        identity_{absl::StrCat("isolated agent ", task.agent_index), {task.agent_index}},
        ray_hits_(ray_hits),
        orders_(orders),
        cache_(cache),
        listener_(listener) {}
  ~IsolatedLink() override { End(absl::CancelledError("the frame was abandoned")); }

  // Steps 0 and 1, or the whole frame.
  void Begin(std::shared_ptr<const agent::Shard> shard, render::Renderer* renderer,
             base::TaskArena* arena, const base::Cancellation* cancellation) {
    absl::StatusOr<std::unique_ptr<agent::FramePipeline>> pipeline = agent::FramePipeline::Make(
        {std::move(shard)}, task_, {.renderer = renderer, .arena = arena, .cache = cache_},
        cancellation);
    if (!pipeline.ok()) {
      End(pipeline.status());
      return;
    }
    pipeline_ = *std::move(pipeline);
    if (task_.spec.culling == frame::Culling::kNone) {
      SendLast(pipeline_->RenderAll());
      return;
    }
    absl::StatusOr<agent::RaySelection> selection = pipeline_->SelectOccluders();
    if (!selection.ok()) {
      End(selection.status());
      return;
    }
    Append(selection->hits, ray_hits_);
    listener_->OnRayHits(std::move(selection->hits), std::move(selection->active));
  }

  void SendOccluders(const std::vector<volume::BlockId>& blocks) override {
    orders_->occluding = blocks;
    if (has_ended_) {
      return;
    }
    const absl::StatusOr<image::FrameImage> image = pipeline_->RenderOccluders(blocks);
    if (!image.ok()) {
      End(image.status());
      return;
    }
    SendPixels(*image);
    listener_->OnOccludersDone();
  }

  void SendVisibleBlocks(const std::vector<volume::BlockId>& blocks,
                         std::string open_pixels) override {
    if (!has_ended_) {
      SendLast(pipeline_->RenderVisible(blocks, open_pixels));
    }
    orders_->visible = blocks;
    orders_->open_pixels = std::move(open_pixels);
  }

  void Cancel() override { End(absl::CancelledError("cancelled by the coordinator")); }
  [[nodiscard]] const server::AgentIdentity& agent() const override { return identity_; }
  [[nodiscard]] std::int64_t network_bytes() const override { return network_bytes_; }

 private:
  void SendPixels(const image::FrameImage& image) {
    std::vector<std::string> bands = pipeline_->Encode(image);
    for (const std::string& band : bands) {
      network_bytes_ += static_cast<std::int64_t>(band.size());
    }
    listener_->OnPixels(std::move(bands));
  }

  void SendLast(const absl::StatusOr<image::FrameImage>& image) {
    if (!image.ok()) {
      End(image.status());
      return;
    }
    SendPixels(*image);
    frame::AgentStatistics statistics = pipeline_->statistics();
    statistics.shard_indices = identity_.shard_indices;
    listener_->OnFrameDone(std::move(statistics));
    End(absl::OkStatus());
  }

  void End(absl::Status status) {
    if (!std::exchange(has_ended_, true)) {
      listener_->OnEnd(std::move(status));
    }
  }

  const agent::FrameTask task_;
  const server::AgentIdentity identity_;
  std::vector<volume::BlockId>* const ray_hits_;
  AgentOrders* const orders_;
  agent::BlockCache* const cache_;
  server::AgentListener* const listener_;
  std::unique_ptr<agent::FramePipeline> pipeline_;
  std::int64_t network_bytes_ = 0;
  bool has_ended_ = false;
};

IsolatedFrame FrameOf(server::FrameResult result, std::vector<volume::BlockId> ray_hits,
                      const std::vector<AgentOrders>& orders, absl::Duration wall) {
  IsolatedFrame frame;
  frame.image = std::move(result.image);
  for (const frame::AgentStatistics& agent : result.agents) {
    frame.agents.push_back({.active_block_count = agent.active_block_count,
                            .drawn_block_count = agent.visible_block_count,
                            .triangle_count = agent.triangle_count});
    wall -= agent.busy_duration;
  }
  frame.other_ms = std::max(0.0, absl::ToDoubleMilliseconds(wall));
  for (const AgentOrders& agent_orders : orders) {
    Append(agent_orders.occluding, &frame.occluding);
    Append(agent_orders.visible, &frame.drawn);
  }
  Append(frame.occluding, &frame.drawn);
  for (auto* blocks : {&ray_hits, &frame.occluding, &frame.drawn}) {
    SortUnique(blocks);
  }
  frame.ray_hits = std::move(ray_hits);
  return frame;
}

// Times both steps of a frame, or the only one, without interruption by other agents.
absl::StatusOr<absl::Duration> TimeAlone(agent::FramePipeline* pipeline, frame::Culling culling,
                                         const AgentOrders& orders) {
  if (culling == frame::Culling::kNone) {
    ISOSCOPE_ASSIGN_OR_RETURN(const image::FrameImage image, pipeline->RenderAll());
    pipeline->Encode(image);
    return pipeline->statistics().busy_duration;
  }
  ISOSCOPE_RETURN_IF_ERROR(pipeline->SelectOccluders().status());
  {
    ISOSCOPE_ASSIGN_OR_RETURN(const image::FrameImage image,
                              pipeline->RenderOccluders(orders.occluding));
    pipeline->Encode(image);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const image::FrameImage image,
                            pipeline->RenderVisible(orders.visible, orders.open_pixels));
  pipeline->Encode(image);
  return pipeline->statistics().busy_duration;
}

}  // namespace

std::int64_t IsolatedFrame::active_block_count() const {
  std::int64_t sum = 0;
  for (const IsolatedAgent& agent : agents) {
    sum += agent.active_block_count;
  }
  return sum;
}

std::int64_t IsolatedFrame::drawn_block_count() const {
  std::int64_t sum = 0;
  for (const IsolatedAgent& agent : agents) {
    sum += agent.drawn_block_count;
  }
  return sum;
}

std::int64_t IsolatedFrame::triangle_count() const {
  std::int64_t sum = 0;
  for (const IsolatedAgent& agent : agents) {
    sum += agent.triangle_count;
  }
  return sum;
}

std::vector<double> IsolatedFrame::busy_ms() const {
  std::vector<double> busy;
  busy.reserve(agents.size());
  for (const IsolatedAgent& agent : agents) {
    busy.push_back(agent.busy_ms);
  }
  return busy;
}

absl::StatusOr<std::unique_ptr<IsolatedCluster>> IsolatedCluster::Open(
    const std::string& dataset_directory, render::Renderer* renderer) {
  ISOSCOPE_ASSIGN_OR_RETURN(const store::DatasetDescription dataset,
                            store::OpenDataset(dataset_directory));
  std::unique_ptr<IsolatedCluster> cluster(new IsolatedCluster());
  cluster->renderer_ = renderer;
  for (const std::string& directory : dataset.shard_directories) {
    ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<const agent::Shard> shard,
                              agent::OpenShard(directory));
    cluster->shards_.push_back(std::move(shard));
    cluster->mesh_memory_.push_back(base::MemoryPool::Make());
  }
  return cluster;
}

// In the whole frame agents alternate at each step, so that each finds the processor's caches full
// of the others' data. So each agent's part is timed once more, without interruption.
absl::StatusOr<IsolatedFrame> IsolatedCluster::Render(const frame::FrameSpec& spec,
                                                      const base::Cancellation& cancellation) {
  ISOSCOPE_ASSIGN_OR_RETURN(const view::View view,
                            view::View::Make(*spec.camera, spec.viewport, manifest().geometry));
  std::vector<volume::BlockId> ray_hits;
  std::vector<AgentOrders> orders(shards_.size());
  server::FrameSetup setup;
  setup.spec = &spec;
  setup.view = &view;
  setup.ties = frame::TieRuleOf(renderer_->picture_revision().back_end);
  setup.layout = &layout();
  setup.replica_counts.assign(shards_.size(), 1);
  setup.images = images_.get();
  setup.arena = &arena_;
  // One for each agent, as on its own machine.
  std::vector<std::unique_ptr<agent::BlockCache>> caches;
  const auto begin =
      [&](int part_index, int /*replica_index*/,
          server::AgentListener* listener) -> absl::StatusOr<std::unique_ptr<server::AgentLink>> {
    const auto i = static_cast<std::size_t>(part_index);
    caches.push_back(std::make_unique<agent::BlockCache>(kCacheBytes, mesh_memory_[i]));
    auto link = std::make_unique<IsolatedLink>(TaskOf(spec, i), &ray_hits, &orders[i],
                                               caches.back().get(), listener);
    link->Begin(shards_[i], renderer_, &arena_, &cancellation);
    return link;
  };
  const base::MonotonicTime start = base::MonotonicNow();
  // Runs inside the arena, so that no step finds a second thread.
  server::FrameOutcome outcome =
      base::RunIn(&arena_, [&] { return server::RunFrame(setup, begin, cancellation); });
  const absl::Duration wall = base::MonotonicNow() - start;
  ISOSCOPE_RETURN_IF_ERROR(outcome.status);
  IsolatedFrame frame = FrameOf(std::move(outcome.result), std::move(ray_hits), orders, wall);
  caches.clear();
  for (std::size_t i = 0; i < shards_.size(); ++i) {
    agent::BlockCache cache(kCacheBytes, mesh_memory_[i]);
    ISOSCOPE_ASSIGN_OR_RETURN(
        const std::unique_ptr<agent::FramePipeline> pipeline,
        agent::FramePipeline::Make({shards_[i]}, TaskOf(spec, i),
                                   {.renderer = renderer_, .arena = &arena_, .cache = &cache},
                                   &cancellation));
    ISOSCOPE_ASSIGN_OR_RETURN(const absl::Duration busy, base::RunIn(&arena_, [&] {
                                return TimeAlone(pipeline.get(), spec.culling, orders[i]);
                              }));
    ISOSCOPE_CHECK_EQ(pipeline->statistics().triangle_count, frame.agents[i].triangle_count);
    frame.agents[i].busy_ms = absl::ToDoubleMilliseconds(busy);
  }
  return frame;
}

agent::FrameTask IsolatedCluster::TaskOf(const frame::FrameSpec& spec,
                                         std::size_t agent_index) const {
  agent::FrameTask task;
  task.spec = spec;
  task.agent_index = static_cast<int>(agent_index);
  task.agent_count = static_cast<int>(shards_.size());
  return task;
}

absl::StatusOr<BlocksPicture> IsolatedCluster::DrawBlocks(
    const frame::FrameSpec& spec, const std::vector<volume::BlockId>& blocks,
    const base::Cancellation& cancellation) {
  agent::BlockCache cache(kCacheBytes);
  agent::FrameTask task;
  task.spec = spec;
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::unique_ptr<agent::FramePipeline> pipeline,
      agent::FramePipeline::Make(shards_, task,
                                 {.renderer = renderer_, .arena = &arena_, .cache = &cache},
                                 &cancellation));
  return base::RunIn(&arena_, [&]() -> absl::StatusOr<BlocksPicture> {
    // Finds the active blocks, which drawing needs; the hits of the rays are not used.
    ISOSCOPE_RETURN_IF_ERROR(pipeline->SelectOccluders().status());
    BlocksPicture picture;
    ISOSCOPE_ASSIGN_OR_RETURN(picture.image, pipeline->RenderOccluders(blocks));
    picture.triangle_count = pipeline->statistics().triangle_count;
    return picture;
  });
}

absl::StatusOr<std::vector<std::int64_t>> IsolatedCluster::TriangleCounts(
    double isovalue, const base::Cancellation& cancellation) {
  const volume::InsideRule rule = volume::InsideRule::OfIsovalue(isovalue);
  agent::IndexCost cost;
  ISOSCOPE_ASSIGN_OR_RETURN(
      const agent::SurfaceBlocks active,
      agent::SurfaceBlocks::Find(shards_, {rule}, /*cache=*/nullptr, cancellation, &cost));
  std::vector<agent::BlockToRead> blocks;
  for (const agent::ChosenMesh& chosen : active.ChooseAll()) {
    blocks.push_back({chosen.shard_index, chosen.ordinal});
  }
  std::sort(blocks.begin(), blocks.end());
  // Not the surface of exports, which lacks the triangles without an area.
  extract::BlockExtractor extractor(manifest().geometry, layout(), shards_.front()->shapes);
  std::vector<std::int64_t> counts;
  // The arena has one thread.
  ISOSCOPE_RETURN_IF_ERROR(agent::BlockReads(shards_, blocks)
                               .ForEach({.arena = &arena_}, cancellation,
                                        [&](std::size_t, const volume::BlockSamples& samples) {
                                          const std::int64_t count =
                                              extractor.Extract(samples, rule).triangle_count();
                                          if (count > 0) {
                                            counts.push_back(count);
                                          }
                                          return absl::OkStatus();
                                        }));
  return counts;
}

}  // namespace isoscope::bench
