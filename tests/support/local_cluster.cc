#include "tests/support/local_cluster.h"

#include <optional>
#include <thread>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/mutex.h"

#include "core/base/status_macros.h"
#include "core/composite/pixel_codec.h"
#include "core/store/shard_reader.h"
#include "core/visibility/occlusion_map.h"
#include "partition-agent/frame_pipeline.h"
#include "server/agent_link.h"

namespace isoscope::testing {
namespace {

class LocalAgentLink final : public server::AgentLink {
 public:
  LocalAgentLink(std::shared_ptr<const agent::Shard> shard, const agent::FrameRequest& request,
                 render::Renderer* renderer, tbb::task_arena* arena, absl::Time deadline,
                 server::AgentListener* listener)
      : shard_(std::move(shard)),
        request_(request),
        renderer_(renderer),
        arena_(arena),
        cancellation_(deadline),
        listener_(listener),
        thread_([this] { listener_->OnEnd(Run()); }) {}

  ~LocalAgentLink() override {
    Cancel();
    thread_.join();
  }

  void SendOccluders(const std::vector<volume::BlockId>& hits) override {
    absl::MutexLock lock(&mutex_);
    occluders_ = hits;
  }
  void SendOcclusionMap(const std::string& encoded) override {
    absl::MutexLock lock(&mutex_);
    map_ = encoded;
  }
  void Cancel() override {
    cancellation_.Cancel();
    absl::MutexLock lock(&mutex_);
    cancelled_ = true;
  }
  [[nodiscard]] std::string name() const override {
    return absl::StrCat("local agent ", request_.agent_index);
  }
  [[nodiscard]] std::int64_t network_bytes() const override { return 0; }

 private:
  absl::Status Run() {
    ISOSCOPE_ASSIGN_OR_RETURN(
        const std::unique_ptr<agent::FramePipeline> pipeline,
        agent::FramePipeline::Make({shard_}, request_, renderer_, arena_, &cancellation_));
    image::FrameImage image;
    if (request_.culling == visibility::Culling::kNone) {
      ISOSCOPE_ASSIGN_OR_RETURN(image, pipeline->RenderAll());
    } else {
      ISOSCOPE_ASSIGN_OR_RETURN(std::vector<volume::BlockId> hits, pipeline->SelectOccluders());
      listener_->OnRayHits(std::move(hits));
      ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<volume::BlockId> occluders, Await(&occluders_));
      ISOSCOPE_ASSIGN_OR_RETURN(image, pipeline->RenderOccluders(occluders));
      SendPixels(image);
      listener_->OnOccludersDone();
      ISOSCOPE_ASSIGN_OR_RETURN(const std::string encoded, Await(&map_));
      ISOSCOPE_ASSIGN_OR_RETURN(const visibility::OcclusionMap map,
                                visibility::OcclusionMap::Decode(encoded, request_.viewport));
      ISOSCOPE_ASSIGN_OR_RETURN(image, pipeline->RenderVisible(map));
    }
    SendPixels(image);
    listener_->OnFrameDone(Statistics(pipeline->statistics()));
    return absl::OkStatus();
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

  void SendPixels(const image::FrameImage& image) {
    for (std::string& band : composite::EncodePixels(image, nullptr)) {
      listener_->OnPixels(std::move(band));
    }
  }

  [[nodiscard]] server::AgentStatistics Statistics(const agent::AgentStatistics& from) const {
    return {.agent_address = name(),
            .shard_indices = {shard_->reader->shard_index()},
            .active_block_count = from.active_block_count,
            .occluding_block_count = from.occluding_block_count,
            .visible_block_count = from.visible_block_count,
            .triangle_count = from.triangle_count,
            .unique_vertex_count = from.unique_vertex_count,
            .read_bytes = from.read_bytes,
            .index_page_read_count = from.index_page_read_count,
            .extract_duration = from.extract_duration,
            .render_duration = from.render_duration,
            .busy_duration = from.busy_duration};
  }

  const std::shared_ptr<const agent::Shard> shard_;
  const agent::FrameRequest request_;
  render::Renderer* const renderer_;
  tbb::task_arena* const arena_;
  base::Cancellation cancellation_;
  server::AgentListener* const listener_;
  absl::Mutex mutex_;
  std::optional<std::vector<volume::BlockId>> occluders_ ABSL_GUARDED_BY(mutex_);
  std::optional<std::string> map_ ABSL_GUARDED_BY(mutex_);
  bool cancelled_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;  // last: it uses all of the above
};

}  // namespace

absl::StatusOr<std::unique_ptr<LocalCluster>> LocalCluster::Open(
    const std::string& dataset_directory, render::Renderer* renderer, int thread_count) {
  ISOSCOPE_ASSIGN_OR_RETURN(const store::DatasetDescription description,
                            store::OpenDataset(dataset_directory));
  auto cluster = std::make_unique<LocalCluster>();
  for (const std::string& directory : description.shard_directories) {
    ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<const agent::Shard> shard,
                              agent::OpenShard(directory));
    cluster->shards_.push_back(std::move(shard));
  }
  cluster->renderer_ = renderer;
  cluster->arena_ = std::make_unique<tbb::task_arena>(thread_count);
  return cluster;
}

absl::StatusOr<server::FrameResult> LocalCluster::Render(const agent::FrameRequest& request,
                                                         const base::Cancellation& cancellation) {
  ISOSCOPE_ASSIGN_OR_RETURN(
      const view::View view,
      view::View::Make(request.camera, request.viewport, manifest().geometry));
  const auto begin =
      [&](int agent_index,
          server::AgentListener* listener) -> absl::StatusOr<std::unique_ptr<server::AgentLink>> {
    agent::FrameRequest own = request;
    own.agent_index = agent_index;
    own.agent_count = static_cast<int>(shards_.size());
    return std::make_unique<LocalAgentLink>(shards_[static_cast<std::size_t>(agent_index)], own,
                                            renderer_, arena_.get(), cancellation.deadline(),
                                            listener);
  };
  return server::RunFrame(view, request.culling, static_cast<int>(shards_.size()), begin,
                          cancellation);
}

}  // namespace isoscope::testing
