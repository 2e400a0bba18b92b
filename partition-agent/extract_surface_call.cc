// An export's stream. Its single task runs on the extraction executor: it extracts batch by batch
// and sends messages of about 256 KiB. Where batches give nothing to send for long, because the
// sums alone are wanted or blocks have few triangles, an empty message tells that it works, as it
// does while the task waits for others. A batch that hangs tells nothing, so that the coordinator
// asks a replica.

#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

#include "core/base/cancellation.h"
#include "core/base/log.h"
#include "core/base/monotonic_time.h"
#include "core/base/no_memory.h"
#include "core/base/retry_delay.h"
#include "core/base/status_macros.h"
#include "core/base/trace_context.h"
#include "core/volume/inside_rule.h"
#include "partition-agent/agent_streams.h"
#include "partition-agent/frame/surface_extraction.h"
#include "proto/message_checksum.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/request_context.h"
#include "rpc/signs_of_life.h"
#include "rpc/unary_call.h"
#include "rpc/write_queue.h"
#include "wire/frame_convert.h"
#include "wire/known_fields.h"

namespace isoscope::agent {
namespace {

namespace v1 = isoscope::internal::v1;

// A message is sent once it has this many bytes.
constexpr std::size_t kSurfaceMessageBytes = base::kMiB / 4;

template <typename T>
std::string AsBytes(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

void AddBlock(const mesh::BlockMesh& mesh, v1::ExtractSurfaceResponse* response) {
  v1::BlockSurface* block = response->add_blocks();
  block->set_block_id(mesh.block_id);
  block->set_positions(AsBytes(mesh.positions));
  block->set_normals(AsBytes(mesh.normals));
  block->set_copies(AsBytes(mesh.copies));
  block->set_triangles(AsBytes(mesh.indices));
}

void SetSums(const solid::SurfaceSums& sums, v1::SurfaceSums* proto) {
  proto->set_area(sums.area.Encode());
  proto->set_volume(sums.volume.Encode());
  proto->set_triangle_count(sums.triangle_count);
  proto->set_open_edge_count(sums.open_side_count);
}

// One export. It owns itself until gRPC is done with it. Its task shares it.
class ExtractSurfaceCall final : public SurfaceReactor {
 public:
  static ExtractSurfaceCall* Start(AgentContext* agent, grpc::CallbackServerContext* context,
                                   const v1::ExtractSurfaceRequest& request) {
    std::shared_ptr<ExtractSurfaceCall> call(new ExtractSurfaceCall(agent, context, request));
    call->self_ = call;
    if (const absl::Status status = agent->begun.CheckNotStopping(); !status.ok()) {
      call->outgoing_.Finish(status);
      return call.get();
    }
    if (!agent->extraction_executor.TrySchedule([call] { call->Run(); })) {
      call->outgoing_.Finish(base::WithRetryDelay(
          absl::ResourceExhaustedError(
              absl::StrCat(AgentContext::kMaxConcurrentExtractions, " extractions are in work and ",
                           AgentContext::kMaxQueuedExtractions,
                           " wait, the most this agent takes: retry later")),
          rpc::UnaryTask::kBusyDelay));
      return call.get();
    }
    call->signs_.Start(agent->options.sign_of_life_interval,
                       [call = call.get()] { call->PushSign(); });
    return call.get();
  }

  void OnWriteDone(bool ok) override { outgoing_.OnWriteDone(ok); }

  void OnCancel() override {
    cancellation_.Cancel();
    outgoing_.Close();
    outgoing_.Finish(absl::CancelledError("the coordinator cancelled the extraction"));
  }

  void OnDone() override {
    signs_.Stop();
    const std::shared_ptr<ExtractSurfaceCall> last_use = std::move(self_);
  }

 private:
  ExtractSurfaceCall(AgentContext* agent, grpc::CallbackServerContext* context,
                     const v1::ExtractSurfaceRequest& request)
      : agent_(*agent),
        request_(request),
        identity_(rpc::AnswerTraceContext(context)),
        cancellation_(rpc::DeadlineOf(*context)),
        outgoing_(
            kMaxQueuedBytes,
            [this](const v1::ExtractSurfaceResponse* message) { StartWrite(message); },
            [this](const absl::Status& status) {
              agent_.metrics.CountRequest(AgentMethod::kExtractSurface, status,
                                          base::MonotonicNow() - arrival_);
              Finish(rpc::ToGrpcStatus(status));
            }) {}

  void Run() {
    signs_.Stop();  // from here on a batch that ends tells it
    last_sent_ = base::MonotonicNow();
    const base::MonotonicTime start = base::MonotonicNow();
    const absl::Status status =
        agent_.damages.ForCaller(base::OrNoMemory("the surface", [this] { return Extract(); }));
    outgoing_.Finish(status);
    const bool is_expected = status.ok() || absl::IsCancelled(status);
    base::Log(is_expected ? base::LogLevel::kInfo : base::LogLevel::kWarning,
              status.ok()   ? "extraction_done"
              : is_expected ? "extraction_cancelled"
                            : "extraction_failed",
              {{"request", identity_.request_id()},
               {"dataset_id", request_.dataset_id()},
               {"surface", rule_.Text()},
               {"duration_ms", base::LogMilliseconds(base::MonotonicNow() - start)},
               {"triangles", triangle_count_},
               {"status", status}});
  }

  absl::Status Extract() {
    ISOSCOPE_RETURN_IF_ERROR(proto::CheckIntact(request_));
    ISOSCOPE_RETURN_IF_ERROR(wire::CheckKnownFields(request_));
    ISOSCOPE_ASSIGN_OR_RETURN(rule_,
                              wire::InsideRuleFromProto(request_.isovalue(), request_.labels(),
                                                        request_.smooth_labels(), /*path=*/""));
    ISOSCOPE_ASSIGN_OR_RETURN(const view::ClipRegion clip,
                              wire::ClipRegionFromProto(request_.clip(), "clip"));
    if (rule_.smooths && clip != view::ClipRegion()) {
      return absl::InvalidArgumentError(
          "smooth_labels is set beside clip: a smooth mesh can't be cut");
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const int level, wire::LevelFromProto(request_.level(), "level"));
    ISOSCOPE_ASSIGN_OR_RETURN(
        LevelShards found,
        agent_.shards.FindLevel(request_.dataset_id(), request_.shard_indices(), level));
    ISOSCOPE_ASSIGN_OR_RETURN(
        const std::unique_ptr<SurfaceExtraction> extraction,
        SurfaceExtraction::Make(std::move(found.shards),
                                frame::InStoredValues(rule_, found.value_scale),
                                {.clip = clip, .closes = request_.closes()},
                                agent_.Resources(/*trace=*/nullptr), &cancellation_));
    v1::ExtractSurfaceResponse message;
    std::size_t message_bytes = 0;
    std::vector<mesh::BlockMesh> meshes;
    while (true) {
      ISOSCOPE_ASSIGN_OR_RETURN(const bool has_batch, extraction->NextBatch(&meshes));
      if (!has_batch) {
        SetSums(extraction->sums(), message.mutable_sums());
        return Send(std::move(message));
      }
      for (const mesh::BlockMesh& mesh : meshes) {
        triangle_count_ += mesh.triangle_count();
        if (request_.without_blocks()) {
          continue;
        }
        if (message_bytes > 0 && message_bytes + mesh.size_bytes() > kSurfaceMessageBytes) {
          ISOSCOPE_RETURN_IF_ERROR(Send(std::exchange(message, {})));
          message_bytes = 0;
        }
        AddBlock(mesh, &message);
        message_bytes += mesh.size_bytes();
      }
      TellLife();
    }
  }

  // After each batch.
  void TellLife() {
    if (base::MonotonicNow() - last_sent_ >= agent_.options.sign_of_life_interval) {
      PushSign();
      last_sent_ = base::MonotonicNow();
    }
  }

  void PushSign() {
    outgoing_.PushIfIdle([] { return v1::ExtractSurfaceResponse(); });
  }

  absl::Status Send(v1::ExtractSurfaceResponse message) {
    last_sent_ = base::MonotonicNow();
    if (outgoing_.Push(std::move(message))) {
      return absl::OkStatus();
    }
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    return absl::CancelledError("the stream has ended");
  }

  AgentContext& agent_;
  const v1::ExtractSurfaceRequest request_;
  volume::InsideRule rule_;  // set by Extract
  const base::TraceContext identity_;
  const base::MonotonicTime arrival_ = base::MonotonicNow();
  base::Cancellation cancellation_;
  rpc::WriteQueue<v1::ExtractSurfaceResponse> outgoing_;
  rpc::SignsOfLife signs_;  // while the task waits
  std::int64_t triangle_count_ = 0;
  base::MonotonicTime last_sent_;             // of the task
  std::shared_ptr<ExtractSurfaceCall> self_;  // reset by OnDone
};

}  // namespace

SurfaceReactor* StartExtractSurface(AgentContext* agent, grpc::CallbackServerContext* context,
                                    const v1::ExtractSurfaceRequest& request) {
  return ExtractSurfaceCall::Start(agent, context, request);
}

}  // namespace isoscope::agent
