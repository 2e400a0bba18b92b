// The coordinator's call to an agent for a surface, and to the replicas that take over.

#ifndef ISOSCOPE_SERVER_FRAME_SURFACE_STREAM_H_
#define ISOSCOPE_SERVER_FRAME_SURFACE_STREAM_H_

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include <grpcpp/client_context.h>
#include <grpcpp/support/sync_stream.h>

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/trace_context.h"
#include "core/mesh/block_mesh.h"
#include "core/mesh/surface_merger.h"
#include "core/solid/surface_sums.h"
#include "core/volume/block_layout.h"
#include "isoscope/internal/v1/partition_agent_service.grpc.pb.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "server/cluster/frame_part.h"

namespace isoscope::server {

// INVALID_ARGUMENT if the block or a vertex is not of the volume, or arrays do not fit together.
absl::Status UnpackBlock(const isoscope::internal::v1::BlockSurface& proto,
                         const volume::BlockLayout& layout, mesh::BlockMesh* block);
// INVALID_ARGUMENT if the sums are malformed.
absl::StatusOr<solid::SurfaceSums> UnpackSums(const isoscope::internal::v1::SurfaceSums& proto);

// The surface of one part's blocks, pulled message by message. Between pulls gRPC's flow control
// stops the agent. If an agent fails, or sends nothing for long, the next replica continues after
// the last block. Cancel is thread-safe, the other functions are for one thread.
class SurfaceStream final : public mesh::SurfaceSource {
 public:
  // request:     its shard_indices are set to the part's
  // max_silence: limit for an agent that owes a message
  SurfaceStream(FramePart part, const volume::BlockLayout& layout,
                isoscope::internal::v1::ExtractSurfaceRequest request, base::MonotonicTime deadline,
                absl::Duration max_silence, const base::TraceContext& identity);
  // Cancels the call if it has not ended.
  ~SurfaceStream() override;
  SurfaceStream(const SurfaceStream&) = delete;
  SurfaceStream& operator=(const SurfaceStream&) = delete;

  // Blocks, for max_silence at most. Errors name the last agent; INTERNAL if it sent a malformed
  // block, DEADLINE_EXCEEDED if it sent nothing.
  absl::StatusOr<bool> Next(mesh::BlockMesh* block) override;
  // The sums over its part of the surface, once Next has returned false; not set if it has none.
  [[nodiscard]] const std::optional<solid::SurfaceSums>& sums() const { return sums_; }
  void Cancel() ABSL_LOCKS_EXCLUDED(mutex_);

  // The agents that failed so far; part_index is 0.
  [[nodiscard]] const std::vector<AgentFailure>& failures() const { return failures_; }

 private:
  struct Call;

  // Asks the replica at replica_.
  void Open() ABSL_LOCKS_EXCLUDED(mutex_);
  // Reads message_. False at the end of the stream. DEADLINE_EXCEEDED if the agent was silent.
  absl::StatusOr<bool> ReadMessage();
  // Takes the sums of message_. INTERNAL if they are malformed.
  absl::Status TakeSums();
  // Records the failure. OK if another replica was asked; else its error, with the agent's name.
  // After Cancel it records nothing, and returns CANCELLED.
  absl::Status Fail(absl::Status status, bool was_silent = false);

  const FramePart part_;
  const volume::BlockLayout layout_;
  isoscope::internal::v1::ExtractSurfaceRequest request_;
  const base::MonotonicTime deadline_;
  const absl::Duration max_silence_;
  const base::TraceContext identity_;
  std::size_t replica_ = 0;
  std::vector<AgentFailure> failures_;
  isoscope::internal::v1::ExtractSurfaceResponse message_;
  int next_block_ = 0;               // index in message_
  std::int64_t last_block_id_ = -1;  // the last one that Next gave
  std::optional<solid::SurfaceSums> sums_;
  std::atomic<bool> was_cancelled_{false};
  bool has_ended_ = false;
  base::Mutex mutex_;  // Cancel may run during Open
  std::unique_ptr<Call> call_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_SURFACE_STREAM_H_
