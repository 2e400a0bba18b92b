// Answers the messages of one frame on an agent, step by step: it checks them, reserves memory, and
// encodes pixels; FramePipeline computes. No gRPC.

#ifndef ISOSCOPE_PARTITION_AGENT_FRAME_ANSWERER_H_
#define ISOSCOPE_PARTITION_AGENT_FRAME_ANSWERER_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/memory_budget.h"
#include "core/base/task_arena.h"
#include "core/volume/block_set.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "partition-agent/agent_context.h"
#include "partition-agent/frame/frame_pipeline.h"
#include "partition-agent/frame/frame_task.h"
#include "partition-agent/frame_trace.h"
#include "partition-agent/memory/frames_in_work.h"

namespace isoscope::agent {

// One frame. For one thread at a time; the steps come in the order of FramePipeline's. Each returns
// the message that ends it, with as many bands as fit. Earlier bands go to `send`. Errors:
// INVALID_ARGUMENT if a message is malformed; the error of `send`; errors of FramePipeline and
// AgentMemory::ReserveStep. May throw std::bad_alloc. Blocks.
class FrameAnswerer {
 public:
  using Response = isoscope::internal::v1::RenderFrameResponse;
  using Send = std::function<absl::Status(Response)>;

  // The arguments outlive it.
  FrameAnswerer(AgentContext* agent, const base::Cancellation* cancellation, FrameTrace* trace,
                Send send)
      : agent_(*agent), cancellation_(*cancellation), trace_(*trace), send_(std::move(send)) {}

  // Adopts the frame's task.
  absl::Status Begin(const isoscope::internal::v1::BeginFrame& begin);
  // Returns true if one step, RenderAll, is the whole frame.
  [[nodiscard]] bool draws_all() const { return task_.spec.culling == frame::Culling::kNone; }

  absl::StatusOr<Response> SelectOccluders();
  absl::StatusOr<Response> RenderOccluders(const isoscope::internal::v1::Occluders& occluders);
  absl::StatusOr<Response> RenderVisible(const isoscope::internal::v1::VisibleBlocks& visible);
  absl::StatusOr<Response> RenderAll();

  [[nodiscard]] const frame::AgentStatistics& statistics() const { return pipeline_->statistics(); }
  // Frees the frame's layers for the next frame.
  void Release() {
    pipeline_.reset();
    in_work_.reset();
  }

 private:
  // The volumes that colour surfaces, by surface; one without shards shows no other field.
  absl::StatusOr<std::vector<LevelShards>> FindColors(
      const isoscope::internal::v1::BeginFrame& begin) const;
  void EnterOneThread(std::optional<base::OneThreadScope>* scope) const;
  [[nodiscard]] view::Viewport DrawnViewport() const;
  [[nodiscard]] int DrawnLayers() const;
  absl::Status CheckRoom();
  absl::StatusOr<base::MemoryBudget::Reservation> ReserveMemory();
  absl::StatusOr<Response> Draw(base::DurationHistogram* duration,
                                absl::FunctionRef<absl::StatusOr<image::FrameImage>()> draw);
  absl::Status AddPixels(image::FrameImage image, base::MemoryBudget::Reservation reserved,
                         Response* last);
  absl::StatusOr<Response> WithStatistics(absl::StatusOr<Response> last) const;

  AgentContext& agent_;
  const base::Cancellation& cancellation_;
  const FrameTrace& trace_;
  const Send send_;
  FrameTask task_;
  std::vector<int> shard_indices_;
  std::int64_t block_count_ = 0;
  std::int64_t mailbox_ = 0;  // 0: pixels leave as bands
  std::optional<FramesInWork::Frame> in_work_;
  std::string look_;        // PlayAhead::NoteFrame
  volume::BlockSet drawn_;  // by step 2
  std::unique_ptr<FramePipeline> pipeline_;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_FRAME_ANSWERER_H_
