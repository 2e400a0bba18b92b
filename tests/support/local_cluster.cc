#include "tests/support/local_cluster.h"

#include <optional>
#include <thread>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"

#include "core/base/monotonic_time.h"
#include "core/base/random.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/io/file.h"
#include "core/render/cpu_renderer.h"
#include "core/store/shard_reader.h"
#include "core/volume/volume_level.h"
#include "partition-agent/frame/frame_pipeline.h"
#include "server/frame/agent_link.h"
#include "tests/support/only_arena.h"

namespace isoscope::testing {
namespace {

// Two batches of OpenGL. Each costs a read-back.
constexpr std::size_t kLeastBatchBytes = std::size_t{1} << 17;
constexpr std::size_t kMostBatchBytes = std::size_t{1} << 28;
constexpr std::size_t kActiveBlocksBytes = std::size_t{16} << 20;

struct VisibleBlocks {
  std::vector<volume::BlockId> blocks;
  std::string open_pixels;
};

// Passes a number of events on; then the agent is lost.
class LossyListener final : public server::AgentListener {
 public:
  LossyListener(std::uint64_t event_count, server::AgentListener* listener)
      : left_(event_count), listener_(listener) {}

  void OnRayHits(std::vector<volume::BlockId> hits, std::vector<volume::BlockId> active) override {
    if (MayPass()) {
      listener_->OnRayHits(std::move(hits), std::move(active));
    }
  }
  void OnPixels(std::vector<std::string> bands) override {
    if (left_ == 1 && bands.size() > 1) {
      bands.resize(bands.size() / 2);  // in the middle of a step
    }
    if (MayPass()) {
      listener_->OnPixels(std::move(bands));
    }
  }
  void OnDrawnPixels(image::DrawnPixels pixels) override {
    if (MayPass()) {
      listener_->OnDrawnPixels(std::move(pixels));
    }
  }
  void OnOccludersDone() override {
    if (MayPass()) {
      listener_->OnOccludersDone();
    }
  }
  void OnFrameDone(frame::AgentStatistics statistics) override {
    if (MayPass()) {
      listener_->OnFrameDone(std::move(statistics));
    }
  }
  void OnEnd(absl::Status status) override {
    if (!is_lost_) {
      listener_->OnEnd(std::move(status));
    }
  }

 private:
  bool MayPass() {
    if (left_ > 0) {
      --left_;
      return true;
    }
    if (!std::exchange(is_lost_, true)) {
      listener_->OnEnd(absl::UnavailableError("the test has lost it"));
    }
    return false;
  }

  std::uint64_t left_;
  server::AgentListener* const listener_;
  bool is_lost_ = false;
};

class LocalAgentLink final : public server::AgentLink {
 public:
  // Makes a link to an agent that is lost after some events.
  LocalAgentLink(std::shared_ptr<const agent::Shard> shard, std::vector<agent::Shards> colors,
                 const agent::FrameTask& task, const agent::AgentResources& resources,
                 bool one_thread_a_step, base::MonotonicTime deadline,
                 std::unique_ptr<LossyListener> lossy)
      : LocalAgentLink(std::move(shard), std::move(colors), task, resources, one_thread_a_step,
                       deadline, lossy.get()) {
    lossy_ = std::move(lossy);
  }
  LocalAgentLink(std::shared_ptr<const agent::Shard> shard, std::vector<agent::Shards> colors,
                 const agent::FrameTask& task, const agent::AgentResources& resources,
                 bool one_thread_a_step, base::MonotonicTime deadline,
                 server::AgentListener* listener)
      : shard_(std::move(shard)),
        colors_(std::move(colors)),
        task_(task),
        identity_{absl::StrCat("local agent ", task.agent_index), {shard_->reader->shard_index()}},
        resources_(resources),
        one_thread_a_step_(one_thread_a_step),
        cancellation_(deadline),
        listener_(listener),
        thread_([this] { listener_->OnEnd(Run()); }) {}

  ~LocalAgentLink() override {
    Cancel();
    thread_.join();
  }

  void SendOccluders(const std::vector<volume::BlockId>& blocks) override {
    absl::MutexLock lock(&mutex_);
    occluders_ = blocks;
  }
  void SendVisibleBlocks(const std::vector<volume::BlockId>& blocks,
                         std::string open_pixels) override {
    absl::MutexLock lock(&mutex_);
    visible_ = {blocks, std::move(open_pixels)};
  }
  void Cancel() override {
    cancellation_.Cancel();
    absl::MutexLock lock(&mutex_);
    cancelled_ = true;
  }
  [[nodiscard]] const server::AgentIdentity& agent() const override { return identity_; }
  [[nodiscard]] std::int64_t network_bytes() const override { return 0; }

 private:
  absl::Status Run() {
    std::optional<base::OneThreadScope> alone;
    if (one_thread_a_step_) {
      alone.emplace();
    }
    ISOSCOPE_ASSIGN_OR_RETURN(
        const std::unique_ptr<agent::FramePipeline> pipeline,
        agent::FramePipeline::Make({shard_}, task_, resources_, &cancellation_, colors_));
    image::FrameImage image;
    if (task_.spec.culling == frame::Culling::kNone) {
      ISOSCOPE_ASSIGN_OR_RETURN(image, pipeline->RenderAll());
    } else {
      ISOSCOPE_ASSIGN_OR_RETURN(agent::RaySelection selection, pipeline->SelectOccluders());
      listener_->OnRayHits(std::move(selection.hits), std::move(selection.active));
      ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<volume::BlockId> occluders, Await(&occluders_));
      ISOSCOPE_ASSIGN_OR_RETURN(image, pipeline->RenderOccluders(occluders));
      SendPixels(std::move(image), pipeline.get());
      listener_->OnOccludersDone();
      ISOSCOPE_ASSIGN_OR_RETURN(const VisibleBlocks visible, Await(&visible_));
      ISOSCOPE_ASSIGN_OR_RETURN(image,
                                pipeline->RenderVisible(visible.blocks, visible.open_pixels));
    }
    SendPixels(std::move(image), pipeline.get());
    listener_->OnFrameDone(Statistics(pipeline->statistics()));
    return absl::OkStatus();
  }

  // Every other frame hands its pixels over as agents of the coordinator's process do.
  void SendPixels(image::FrameImage image, agent::FramePipeline* pipeline) {
    if (task_.frame_number % 2 == 0) {
      listener_->OnDrawnPixels(
          {.image = std::move(image), .layers = pipeline->TakeLayers(), .memory = nullptr});
    } else {
      listener_->OnPixels(pipeline->Encode(image));
    }
  }

  template <typename T>
  absl::StatusOr<T> Await(std::optional<T>* message) {
    absl::MutexLock lock(&mutex_);
    const auto arrived = [this, message]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
      return cancelled_ || message->has_value();
    };
    mutex_.Await(absl::Condition(&arrived));
    if (cancelled_) {
      return absl::CancelledError("cancelled by the coordinator");
    }
    return **message;
  }

  [[nodiscard]] frame::AgentStatistics Statistics(frame::AgentStatistics measured) const {
    measured.agent_address = identity_.address;
    measured.shard_indices = identity_.shard_indices;
    return measured;
  }

  std::unique_ptr<LossyListener> lossy_;
  const std::shared_ptr<const agent::Shard> shard_;
  const std::vector<agent::Shards> colors_;  // by surface
  const agent::FrameTask task_;
  const server::AgentIdentity identity_;
  const agent::AgentResources resources_;
  const bool one_thread_a_step_;
  base::Cancellation cancellation_;
  server::AgentListener* const listener_;
  absl::Mutex mutex_;
  std::optional<std::vector<volume::BlockId>> occluders_ ABSL_GUARDED_BY(mutex_);
  std::optional<VisibleBlocks> visible_ ABSL_GUARDED_BY(mutex_);
  bool cancelled_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;  // last: it uses all of the above
};

absl::StatusOr<agent::Shards> OpenShardsOf(const std::string& dataset_directory,
                                           const store::OpenSamples& open_samples = nullptr) {
  ISOSCOPE_ASSIGN_OR_RETURN(const store::DatasetDescription description,
                            store::OpenDataset(dataset_directory));
  agent::Shards shards;
  for (const std::string& directory : description.shard_directories) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        shards.emplace_back(),
        agent::OpenShardWithLevels(directory, io::OpenRandomAccessFile, open_samples));
  }
  return shards;
}

}  // namespace

volume::GridGeometry GridOfLevel(const volume::GridGeometry& whole, int level) {
  // Type and filter do not change the grid.
  return volume::LevelOf(whole, volume::ScalarType::kUint8, volume::LevelFilter::kMean, level).grid;
}

absl::StatusOr<std::unique_ptr<LocalCluster>> LocalCluster::Open(
    const std::string& dataset_directory, render::Renderer* renderer, const Limits& limits,
    std::size_t cache_bytes) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<LocalCluster> cluster,
                            OpenAsleep(dataset_directory, renderer));
  ISOSCOPE_RETURN_IF_ERROR(cluster->Wake(limits));
  cluster->ForgetAll(cache_bytes);
  return cluster;
}

absl::StatusOr<std::unique_ptr<LocalCluster>> LocalCluster::OpenAsleep(
    const std::string& dataset_directory, render::Renderer* renderer,
    const store::OpenSamples& open_samples) {
  auto cluster = std::make_unique<LocalCluster>();
  ISOSCOPE_ASSIGN_OR_RETURN(cluster->shards_, OpenShardsOf(dataset_directory, open_samples));
  cluster->given_renderer_ = renderer;
  cluster->ForgetAll(kAmpleCacheBytes);
  return cluster;
}

absl::StatusOr<std::unique_ptr<LocalCluster>> LocalCluster::OpenSeriesAsleep(
    const std::string& dataset_directory, render::Renderer* renderer, std::size_t open_volume_bytes,
    const store::OpenSamples& open_samples) {
  auto cluster = std::make_unique<LocalCluster>();
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::string> directories,
                            store::ShardDirectoriesOf(dataset_directory));
  const auto open_volumes = std::make_shared<agent::OpenVolumes>(open_volume_bytes);
  for (const std::string& directory : directories) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        cluster->series_.emplace_back(),
        agent::SeriesShard::Open(directory, open_volumes, store::OpenSeriesShard, open_samples));
  }
  cluster->given_renderer_ = renderer;
  cluster->ForgetAll(kAmpleCacheBytes);
  return cluster;
}

absl::Status LocalCluster::AddField(const std::string& field,
                                    const std::string& dataset_directory) {
  agent::Shards& shards = fields_[field];
  if (shards.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(shards, OpenShardsOf(dataset_directory));
  }
  return absl::OkStatus();
}

absl::Status LocalCluster::Wake(const Limits& limits) {
  Sleep();
  ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<base::TaskArena> arena,
                            MakeOnlyArena(limits.thread_count));
  WakeIn(std::move(arena), limits);
  return absl::OkStatus();
}

void LocalCluster::WakeIn(std::shared_ptr<base::TaskArena> arena, const Limits& limits) {
  Sleep();
  arena_ = std::move(arena);
  arena_->SetSharesThreads(limits.one_thread_a_step);
  limits_ = limits;
  if (given_renderer_ == nullptr ||
      given_renderer_->picture_revision().back_end == frame::BackEnd::kEgl) {
    cpu_renderer_ = render::MakeCpuRenderer({.max_kept_bytes = limits.kept_mesh_bytes(),
                                             .max_unused_bytes = limits.unused_image_bytes(),
                                             .arena = arena_});
  }
  renderer_ = given_renderer_ != nullptr ? given_renderer_ : cpu_renderer_.get();
  layers_ = std::make_unique<render::LayerRenderer>(limits.unused_layer_bytes());
  images_ = image::FrameImagePool::Make(limits.unused_image_bytes());
}

void LocalCluster::Sleep() {
  renderer_ = nullptr;
  cpu_renderer_.reset();
  arena_.reset();
}

void LocalCluster::ForgetAll(std::size_t cache_bytes) {
  cache_ = std::make_unique<agent::BlockCache>(cache_bytes);
  active_blocks_ = std::make_unique<server::ActiveBlocksCache>(kActiveBlocksBytes);
}

void LocalCluster::CullByTrees() {
  culls_by_trees_ = true;
  active_blocks_ = std::make_unique<server::ActiveBlocksCache>(kActiveBlocksBytes);
}

absl::StatusOr<LocalCluster::Level> LocalCluster::LevelOf(const agent::Shards& shards, int level) {
  if (level == 0) {
    return Level{.shards = shards};
  }
  Level found;
  const auto position = static_cast<std::size_t>(level) - 1;
  for (const std::shared_ptr<const agent::Shard>& shard : shards) {
    if (position >= shard->levels.size() || shard->levels[position] == nullptr) {
      return absl::NotFoundError(
          absl::StrCat("'", shard->reader->directory(), "' has no level ", level));
    }
    found.shards.push_back(shard->levels[position]);
  }
  found.value_scale = shards.front()->reader->manifest().Level(level).value_scale;
  return found;
}

absl::StatusOr<LocalCluster::Level> LocalCluster::OpenVolume(const store::ScalarVolumeKey& key,
                                                             int level) const {
  Level found;
  for (const std::unique_ptr<agent::SeriesShard>& agent : series_) {
    const store::ScalarVolume* const volume = agent->served()->manifest.Find(key);
    if (volume == nullptr) {
      return absl::NotFoundError(store::ScalarVolumeDirectoryName(key));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(
        found.shards.emplace_back(),
        agent->OpenVolume(volume->dataset_id, agent::SeriesShard::Opening::kForFrame, level));
    found.value_scale = agent->ValueScaleOf(volume->dataset_id, level);
  }
  return found;
}

absl::StatusOr<server::FrameResult> LocalCluster::Render(const frame::FrameSpec& spec,
                                                         const base::Cancellation& cancellation) {
  std::vector<Level> colors(spec.surfaces.size());
  for (std::size_t i = 0; i < colors.size(); ++i) {
    if (spec.surfaces[i].shows_field()) {
      ISOSCOPE_ASSIGN_OR_RETURN(colors[i],
                                LevelOf(fields_.at(spec.surfaces[i].color_by->field), spec.level));
    }
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const Level drawn, LevelOf(shards_, spec.level));
  return RenderLevel(spec, manifest().geometry, drawn, colors, cancellation);
}

absl::StatusOr<server::FrameResult> LocalCluster::Render(const frame::FrameSpec& spec,
                                                         const store::ScalarVolumeKey& volume) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Level drawn, OpenVolume(volume, spec.level));
  std::vector<Level> colors(spec.surfaces.size());
  for (std::size_t i = 0; i < colors.size(); ++i) {
    if (spec.surfaces[i].shows_field()) {
      store::ScalarVolumeKey key = series_fields_.at(spec.surfaces[i].color_by->field);
      key.step = volume.step;
      ISOSCOPE_ASSIGN_OR_RETURN(colors[i], OpenVolume(key, spec.level));
    }
  }
  return RenderLevel(spec, series_.front()->served()->manifest.geometry, drawn, colors,
                     base::Cancellation());
}

absl::StatusOr<server::FrameResult> LocalCluster::RenderLevel(
    const frame::FrameSpec& spec, const volume::GridGeometry& whole, const Level& drawn,
    const std::vector<Level>& colors, const base::Cancellation& cancellation) {
  const agent::Shards& shards = drawn.shards;
  const store::Manifest& manifest = shards.front()->reader->manifest();
  ISOSCOPE_ASSIGN_OR_RETURN(view::View view,
                            view::View::Make(*spec.camera, spec.viewport, whole, spec.region));
  frame::FrameSpec stored = spec;
  if (spec.level > 0) {
    ISOSCOPE_ASSIGN_OR_RETURN(view, view.OnGrid(GridOfLevel(whole, spec.level)));
    std::vector<double> color_scales;
    color_scales.reserve(colors.size());
    for (const Level& color : colors) {
      color_scales.push_back(color.value_scale);
    }
    stored = frame::InStoredValues(std::move(stored), drawn.value_scale, color_scales);
  }
  std::vector<std::vector<int>> shard_indices;
  for (const std::shared_ptr<const agent::Shard>& shard : shards) {
    shard_indices.push_back({shard->reader->shard_index()});
  }
  const std::string active_key = server::ActiveBlocksCache::KeyOf(
      manifest.dataset_id, spec.level, shard_indices, frame::RulesOf(spec));
  server::FrameSetup setup;
  setup.spec = &spec;
  setup.view = &view;
  setup.ties = frame::TieRuleOf(frame::DrawnBy(spec, renderer_->picture_revision().back_end));
  setup.layout = &shards.front()->reader->layout();
  setup.replica_counts.assign(shards.size(), loses_agents_ ? 2 : 1);
  setup.active = active_blocks_->Find(active_key);
  setup.images = images_.get();
  setup.arena = arena_.get();
  if (culls_by_trees_) {
    setup.max_dense_blocks = 0;
  }
  const std::int64_t frame_number = frame_count_.fetch_add(1) + 1;
  const auto begin =
      [&](int part_index, int replica_index,
          server::AgentListener* listener) -> absl::StatusOr<std::unique_ptr<server::AgentLink>> {
    agent::FrameTask own;
    own.spec = stored;
    if (spec.level > 0) {
      own.whole = whole;
    }
    own.frame_number = frame_number;
    own.agent_index = part_index;
    own.agent_count = static_cast<int>(shards.size());
    own.report_active_blocks = setup.active == nullptr;
    const agent::AgentResources resources{.renderer = renderer_,
                                          .layers = layers_.get(),
                                          .cpu_renderer = cpu_renderer_.get(),
                                          .arena = arena_.get(),
                                          .cache = cache_.get(),
                                          .max_read_bytes = limits_.read_bytes()};
    const auto part = static_cast<std::size_t>(part_index);
    const std::shared_ptr<const agent::Shard>& shard = shards[part];
    std::vector<agent::Shards> own_colors;
    for (const Level& color : colors) {
      own_colors.push_back(color.shards.empty() ? agent::Shards{}
                                                : agent::Shards{color.shards[part]});
    }
    if (loses_agents_ && replica_index == 0) {
      const auto draw = base::RandomBits(static_cast<std::uint64_t>(frame_number),
                                         static_cast<std::uint64_t>(part_index));
      // A part has five events, and more with several bands.
      return std::make_unique<LocalAgentLink>(shard, own_colors, own, resources,
                                              limits_.one_thread_a_step, cancellation.deadline(),
                                              std::make_unique<LossyListener>(draw % 7, listener));
    }
    return std::make_unique<LocalAgentLink>(shard, own_colors, own, resources,
                                            limits_.one_thread_a_step, cancellation.deadline(),
                                            listener);
  };
  server::FrameOutcome outcome = server::RunFrame(setup, begin, cancellation);
  ISOSCOPE_RETURN_IF_ERROR(outcome.status);
  if (setup.active == nullptr && outcome.result.active != nullptr) {
    active_blocks_->Insert(active_key, outcome.result.active);
  }
  return std::move(outcome.result);
}

absl::StatusOr<std::unique_ptr<render::Renderer>> MakeSharedRenderer(render::RendererKind kind,
                                                                     std::uint64_t seed) {
  if (kind == render::RendererKind::kCpu) {
    return nullptr;
  }
  Dice dice(seed);
  return render::MakeRenderer(
      {.kind = kind, .max_kept_mesh_bytes = dice.Size(kLeastBatchBytes, kMostBatchBytes)});
}

absl::StatusOr<LocalCluster*> LocalClusters::Wake(const std::string& dataset_directory) {
  if (awake_ != nullptr) {
    awake_->Sleep();
    awake_ = nullptr;
  }
  std::unique_ptr<LocalCluster>& cluster = clusters_[dataset_directory];
  if (cluster == nullptr) {
    ISOSCOPE_ASSIGN_OR_RETURN(cluster, LocalCluster::OpenAsleep(dataset_directory, renderer_));
  }
  Limits limits = DrawLimits(&dice_);
  if (wake_count_++ % kWakesOfArena == 0) {
    arena_.reset();
    ISOSCOPE_ASSIGN_OR_RETURN(arena_, MakeOnlyArena(limits.thread_count));
  }
  limits.thread_count = arena_->max_concurrency();
  cluster->WakeIn(arena_, limits);
  awake_ = cluster.get();
  return awake_;
}

}  // namespace isoscope::testing
