// A coordinator and its agents in one process, without gRPC: agents are FramePipelines on threads
// of their own, joined to RunFrame by the same encodings as on the wire. For tests of the picture.

#ifndef ISOSCOPE_TESTS_SUPPORT_LOCAL_CLUSTER_H_
#define ISOSCOPE_TESTS_SUPPORT_LOCAL_CLUSTER_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include <oneapi/tbb/task_arena.h>

#include "core/base/cancellation.h"
#include "core/render/renderer.h"
#include "partition-agent/frame_request.h"
#include "partition-agent/shard.h"
#include "server/frame_coordinator.h"

namespace isoscope::testing {

// Thread-compatible.
class LocalCluster {
 public:
  // Opens the dataset directory; one agent for each shard. `renderer` must outlive it.
  static absl::StatusOr<std::unique_ptr<LocalCluster>> Open(const std::string& dataset_directory,
                                                            render::Renderer* renderer,
                                                            int thread_count);

  [[nodiscard]] const store::Manifest& manifest() const {
    return shards_.front()->reader->manifest();
  }
  [[nodiscard]] const std::vector<std::shared_ptr<const agent::Shard>>& shards() const {
    return shards_;
  }

  // Renders one frame through all steps. agent_index and agent_count of `request` are set here.
  absl::StatusOr<server::FrameResult> Render(const agent::FrameRequest& request,
                                             const base::Cancellation& cancellation);
  absl::StatusOr<server::FrameResult> Render(const agent::FrameRequest& request) {
    return Render(request, base::Cancellation());
  }

 private:
  std::vector<std::shared_ptr<const agent::Shard>> shards_;
  render::Renderer* renderer_ = nullptr;
  std::unique_ptr<tbb::task_arena> arena_;
};

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_LOCAL_CLUSTER_H_
