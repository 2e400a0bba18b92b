// A frame on an agent (RenderFrameCall), phase by event:
//
//   phase                 event           action                               next phase
//   kExpectBegin          begin           admits the frame, schedules Begin    kSelecting
//   kSelecting            steps 0, 1 end  sends ray_hits                       kExpectOccluders
//                         CULLING_NONE    Begin draws all active blocks        kRenderingRest
//   kExpectOccluders      occluders       schedules RenderOccluders            kRenderingOccluders
//   kRenderingOccluders   step 2 ends     sends bands, occluders_done          kExpectVisibleBlocks
//   kExpectVisibleBlocks  visible_blocks  schedules RenderVisible              kRenderingRest
//   kRenderingRest        step 3 ends     sends bands, frame_done, ends OK     kEnded
//   any but kEnded        error, cancel   stops the step, ends with the error  kEnded
//
// A message in any other phase is INVALID_ARGUMENT. So is the end of the coordinator's messages
// before kRenderingRest; after that it means nothing.
//
// gRPC calls the reactions (OnReadDone, OnCancel, ...) on its threads; they only check and hand
// over. A step runs on frame_executor_, and a frame has at most one step there. mutex_ guards the
// phase. A step enters kExpect... before it sends its answer, because the coordinator may reply at
// once.
//
// ExtractSurfaceCall has one task, on extraction_executor_: it extracts batch by batch and sends
// messages of about 256 KiB. Both calls wait while kMaxQueuedBytes wait for the network.

#include "partition-agent/partition_agent_service_impl.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"
#include "core/base/log.h"
#include "core/base/memory_info.h"
#include "core/base/metrics.h"
#include "core/base/mutex.h"
#include "core/base/no_memory.h"
#include "core/base/retry_delay.h"
#include "core/base/status_macros.h"
#include "core/base/task_arena.h"
#include "core/base/trace_context.h"
#include "core/base/trace_recorder.h"
#include "core/base/units.h"
#include "core/base/version.h"
#include "core/render/cpu_renderer.h"
#include "core/rpc/channel.h"
#include "core/rpc/frame_convert.h"
#include "core/rpc/grpc_status.h"
#include "core/rpc/histogram_convert.h"
#include "core/rpc/known_fields.h"
#include "core/rpc/pick_convert.h"
#include "core/rpc/proto_convert.h"
#include "core/rpc/request_context.h"
#include "core/rpc/trace_convert.h"
#include "core/rpc/unary_call.h"
#include "core/rpc/unary_checksum.h"
#include "core/rpc/write_queue.h"
#include "partition-agent/frame_pipeline.h"
#include "partition-agent/frame_task.h"
#include "partition-agent/point_gradients.h"
#include "partition-agent/shard_histogram.h"
#include "partition-agent/surface_extraction.h"
#include "proto/message_checksum.h"

namespace isoscope::agent {
namespace {

namespace v1 = isoscope::internal::v1;

// Steps of a frame that run on the executor.
constexpr int kStepCount = 3;
// If this many bytes of pixels or surface wait for the network, the worker waits too.
constexpr std::size_t kMaxQueuedBytes = 8 * base::kMiB;
// A message has at most this many bytes of bands, or one band.
constexpr std::size_t kMaxBandsBytes = 1 * base::kMiB;
// A message of ExtractSurface is sent once it has this many bytes.
constexpr std::size_t kSurfaceMessageBytes = base::kMiB / 4;
// The longest time of a question about histograms or active blocks.
constexpr absl::Duration kMaxQueryDuration = absl::Minutes(1);

v1::DescribeShardsResponse Describe(const std::vector<std::shared_ptr<const Shard>>& shards,
                                    const render::Renderer& renderer) {
  v1::DescribeShardsResponse description;
  description.set_version(std::string(base::Version()));
  description.set_renderer(renderer.description());
  *description.mutable_picture_revision() = rpc::ToProto(renderer.picture_revision());
  std::vector<const store::ShardReader*> readers;
  readers.reserve(shards.size());
  for (const std::shared_ptr<const Shard>& shard : shards) {
    readers.push_back(shard->reader.get());
  }
  std::sort(readers.begin(), readers.end(),
            [](const store::ShardReader* a, const store::ShardReader* b) {
              return std::pair(a->manifest().name, a->shard_index()) <
                     std::pair(b->manifest().name, b->shard_index());
            });
  for (const store::ShardReader* reader : readers) {
    v1::ShardDescription* shard = description.add_shards();
    *shard->mutable_dataset() = rpc::ToProto(reader->manifest());
    shard->set_manifest_crc32c(reader->manifest_crc32c());
    shard->set_range_table_crc32c(reader->manifest().range_table_crc32c);
    shard->set_shard_index(reader->shard_index());
    shard->set_block_count(reader->block_count());
  }
  return description;
}

// The coordinator sets the ranges that clients leave out.
absl::Status CheckMapSteps(const frame::FrameSpec& spec) {
  if (!spec.sends_map_steps) {
    return absl::OkStatus();
  }
  if (!spec.sends_normals) {
    return absl::InvalidArgumentError(
        "begin.sends_map_steps is set: must be unset without begin.sends_normals");
  }
  for (std::size_t i = 0; i < spec.surfaces.size(); ++i) {
    if (spec.surfaces[i].shows_gradient() && !spec.surfaces[i].color_by->range.has_value()) {
      return absl::InvalidArgumentError(absl::StrCat("begin.request.surfaces[", i,
                                                     "].color_by.range is not set: required with "
                                                     "begin.sends_map_steps"));
    }
  }
  return absl::OkStatus();
}

absl::StatusOr<FrameTask> FrameTaskFromProto(const v1::BeginFrame& begin) {
  // This looks into the request, too: a field that this agent does not know may decide pixels.
  ISOSCOPE_RETURN_IF_ERROR(rpc::CheckKnownFields(begin));
  FrameTask task;
  task.frame_number = begin.frame_number();
  ISOSCOPE_ASSIGN_OR_RETURN(task.spec, rpc::FrameSpecFromProto(begin.request()));
  task.spec.sends_normals = begin.sends_normals();
  task.spec.sends_map_steps = begin.sends_map_steps();
  ISOSCOPE_RETURN_IF_ERROR(CheckMapSteps(task.spec));
  task.agent_index = begin.agent_index();
  task.agent_count = begin.agent_count();
  task.report_active_blocks = begin.report_active_blocks();
  if (task.agent_index < 0 || task.agent_index >= task.agent_count) {
    return absl::InvalidArgumentError(absl::StrCat("begin.agent_index is ", task.agent_index,
                                                   " of begin.agent_count ", task.agent_count,
                                                   ": must lie in [0, agent_count)"));
  }
  return task;
}

template <typename T>
std::string AsBytes(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

void AddBlock(const mesh::BlockMesh& mesh, v1::ExtractSurfaceResponse* response) {
  v1::BlockSurface* block = response->add_blocks();
  block->set_block_id(mesh.block_id);
  block->set_positions(AsBytes(mesh.positions));
  block->set_normals(AsBytes(mesh.normals));
  block->set_edge_keys(AsBytes(mesh.edge_keys));
  block->set_triangles(AsBytes(mesh.indices));
}

}  // namespace

// One frame. It owns itself until gRPC is done with it. A running step shares it.
class PartitionAgentServiceImpl::RenderFrameCall final
    : public grpc::ServerBidiReactor<v1::RenderFrameRequest, v1::RenderFrameResponse> {
 public:
  static RenderFrameCall* Start(PartitionAgentServiceImpl* service,
                                grpc::CallbackServerContext* context) {
    std::shared_ptr<RenderFrameCall> call(new RenderFrameCall(service, context));
    call->self_ = call;
    call->StartRead(&call->incoming_);
    return call.get();
  }

  ~RenderFrameCall() override {
    if (is_admitted_) {
      service_->frame_count_.fetch_sub(1);
    }
  }

  void OnReadDone(bool ok) override {
    if (!ok) {
      OnReadsEnded();
      return;
    }
    NoteReceived();
    v1::RenderFrameRequest message;
    message.Swap(&incoming_);
    absl::Status status = proto::CheckIntact(message);
    if (status.ok()) {
      status = Accept(std::move(message));
    }
    if (!status.ok()) {
      Fail(status);
      return;
    }
    StartRead(&incoming_);
  }

  void OnWriteDone(bool ok) override { outgoing_.OnWriteDone(ok); }

  void OnCancel() override {
    outgoing_.Close();
    Fail(absl::CancelledError("the coordinator cancelled the frame, or its deadline passed"));
  }

  void OnDone() override { const std::shared_ptr<RenderFrameCall> last_use = std::move(self_); }

 private:
  // In kExpect... the coordinator's message is due. In the others a step runs, until kEnded.
  enum class Phase {
    kExpectBegin,
    kSelecting,
    kExpectOccluders,
    kRenderingOccluders,
    kExpectVisibleBlocks,
    kRenderingRest,
    kEnded,
  };

  RenderFrameCall(PartitionAgentServiceImpl* service, grpc::CallbackServerContext* context)
      : service_(service),
        context_(context),
        identity_(rpc::AnswerTraceContext(context)),
        cancellation_(rpc::DeadlineOf(*context)),
        outgoing_(
            kMaxQueuedBytes,
            [this](const v1::RenderFrameResponse* message) { StartWrite(message); },
            [this](const absl::Status& status) {
              service_->metrics_.CountRequest(AgentMethod::kRenderFrame, status,
                                              absl::Now() - start_);
              Finish(rpc::ToGrpcStatus(status));
            }) {}

  // Begins a trace if this is the message that asks for one, and notes when it came.
  void NoteReceived() ABSL_LOCKS_EXCLUDED(mutex_) {
    const bool begins = incoming_.has_begin() && incoming_.begin().request().with_trace();
    const base::MutexLock lock(&mutex_);
    if (begins && phase_ == Phase::kExpectBegin) {
      trace_ = std::make_unique<base::TraceRecorder>(
          rpc::MaxSpansOfAgent(incoming_.begin().agent_count()));
      trace_zero_ = base::TraceClock::now();
    }
    if (trace_ != nullptr) {
      receive_times_.push_back(base::TraceClock::now());
    }
  }

  static const char* NameOf(Phase phase) {
    switch (phase) {
      case Phase::kExpectBegin:
        return "begin was expected";
      case Phase::kExpectOccluders:
        return "occluders was expected";
      case Phase::kExpectVisibleBlocks:
        return "visible_blocks was expected";
      case Phase::kSelecting:
      case Phase::kRenderingOccluders:
      case Phase::kRenderingRest:
      case Phase::kEnded:
        return "no message was expected before the agent's answer";
    }
    return "";
  }

  // Checks that the message is due, and hands it to the executor.
  absl::Status Accept(v1::RenderFrameRequest message) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    using Message = v1::RenderFrameRequest;
    if (phase_ == Phase::kExpectBegin && message.message_case() == Message::kBegin) {
      ISOSCOPE_RETURN_IF_ERROR(Admit());
      frame_number_ = message.begin().frame_number();
      phase_ = Phase::kSelecting;
      return Schedule([this, begin = std::move(*message.mutable_begin())] { return Begin(begin); });
    }
    if (phase_ == Phase::kExpectOccluders && message.message_case() == Message::kOccluders) {
      phase_ = Phase::kRenderingOccluders;
      return Schedule([this, occluders = std::move(*message.mutable_occluders())] {
        return RenderOccluders(occluders);
      });
    }
    if (phase_ == Phase::kExpectVisibleBlocks &&
        message.message_case() == Message::kVisibleBlocks) {
      phase_ = Phase::kRenderingRest;
      return Schedule([this, blocks = std::move(*message.mutable_visible_blocks())] {
        return RenderVisible(blocks);
      });
    }
    const google::protobuf::FieldDescriptor* field =
        Message::descriptor()->FindFieldByNumber(message.message_case());
    return absl::InvalidArgumentError(absl::StrCat(
        "message ", field == nullptr ? "(none)" : field->name(), ", but ", NameOf(phase_)));
  }

  absl::Status Admit() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const int before = service_->frame_count_.fetch_add(1);
    is_admitted_ = true;
    if (before >= service_->max_frames_) {
      return base::WithRetryDelay(
          absl::ResourceExhaustedError(absl::StrCat(
              before,
              " frames are in work or wait, the most this agent takes (--max-concurrent-frames "
              "plus its queue): retry later")),
          rpc::UnaryTask::kBusyDelay);
    }
    return absl::OkStatus();
  }

  // Runs `step` on the executor, which always has room for one step of each admitted frame.
  template <typename Step>
  absl::Status Schedule(Step step) {
    const absl::Time scheduled = absl::Now();
    const base::TraceTime trace_scheduled =
        trace_ == nullptr ? base::TraceTime() : base::TraceClock::now();
    const bool is_scheduled = service_->frame_executor_.TrySchedule(
        [call = self_, scheduled, trace_scheduled, step = std::move(step)]() mutable {
          call->service_->metrics_.queue_wait.Observe(absl::Now() - scheduled);
          if (call->trace_ != nullptr) {
            call->trace_->NameThisThread("frame");
            call->trace_->AddTo("queue", "queue", trace_scheduled, base::TraceClock::now());
          }
          // Begin and Encode may throw, and so may protobuf; a message of the step is only
          // destroyed.
          const absl::Status status = base::OrNoMemory("a step of the frame", step);
          if (!status.ok()) {
            call->Fail(status);
          }
        });
    if (!is_scheduled) {
      return absl::UnavailableError("the agent is shutting down");
    }
    return absl::OkStatus();
  }

  void OnReadsEnded() ABSL_LOCKS_EXCLUDED(mutex_) {
    if (context_->IsCancelled()) {
      return;  // OnCancel ends the frame
    }
    {
      const base::MutexLock lock(&mutex_);
      if (phase_ == Phase::kRenderingRest || phase_ == Phase::kEnded) {
        return;
      }
    }
    Fail(absl::InvalidArgumentError("the coordinator ended its side before the frame was done"));
  }

  // Ends the current step's phase. A step calls it before it sends its answer.
  void EnterPhase(Phase phase) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    if (phase_ != Phase::kEnded) {
      phase_ = phase;
    }
  }

  absl::Status Send(v1::RenderFrameResponse message) {
    const base::TraceScope trace(trace_.get(), "send");
    if (trace_ != nullptr && !message.has_frame_done()) {  // SendLast notes that one
      send_times_.push_back(base::TraceClock::now());
    }
    if (outgoing_.Push(std::move(message))) {
      return absl::OkStatus();
    }
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    return absl::CancelledError("the stream has ended");
  }

  // Returns the picture that a step draws. OpenGL draws a region into a picture of the whole.
  [[nodiscard]] view::Viewport DrawnViewport() const {
    const bool draws_whole =
        frame::DrawnBy(task_.spec, service_->renderer_->picture_revision().back_end) ==
        frame::BackEnd::kEgl;
    return draws_whole ? task_.spec.viewport : frame::ImageSizeOf(task_.spec);
  }
  [[nodiscard]] int DrawnLayers() const {
    return frame::HasLayers(task_.spec) ? task_.spec.max_layers : 0;
  }

  // Reserves the memory of one step: its image, and its bands until they are queued.
  absl::StatusOr<base::MemoryBudget::Reservation> ReserveMemory() {
    const base::TraceScope trace(trace_.get(), "memory");
    const base::ScopedObservation wait(&service_->metrics_.memory_wait);
    return service_->memory_->ReserveStep(DrawnViewport(), cancellation_, DrawnLayers());
  }

  // Enters `scope` if this step shall use one thread: others then use the rest, if they have room.
  void EnterOneThread(std::optional<base::OneThreadScope>* scope) const {
    if (service_->one_thread_a_step_ &&
        service_->memory_->RoomFor(DrawnViewport(), DrawnLayers()) >=
            static_cast<std::size_t>(service_->arena_->max_concurrency())) {
      scope->emplace();
    }
  }

  // Sends the pixels of a step: puts them into the mailbox, or sends the bands of the image, except
  // the last ones. Those go into `last`, the message that ends the step, because a message costs
  // more than its bytes.
  absl::Status SendPixels(image::FrameImage image, base::MemoryBudget::Reservation reserved,
                          v1::RenderFrameResponse* last) {
    if (mailbox_ > 0) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
      // It keeps its whole reservation: with more images under way each is colder. Of 256 agents a
      // frame took half as long again.
      const bool is_open = service_->mailboxes_->Put(
          mailbox_,
          {.image = std::move(image),
           .layers = pipeline_->TakeLayers(),
           .memory = std::make_shared<const base::MemoryBudget::Reservation>(std::move(reserved))});
      last->set_pixels_are_in_mailbox(true);
      return is_open ? absl::OkStatus() : absl::CancelledError("the coordinator has left");
    }
    v1::RenderFrameResponse message;
    std::size_t bytes = 0;
    base::ScopedObservation encode(&service_->metrics_.encode);
    std::vector<std::string> bands = pipeline_->Encode(image);
    encode.End();
    for (std::string& band : bands) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
      if (bytes > 0 && bytes + band.size() > kMaxBandsBytes) {
        ISOSCOPE_RETURN_IF_ERROR(Send(std::exchange(message, {})));
        bytes = 0;
      }
      bytes += band.size();
      message.add_bands(std::move(band));
    }
    last->mutable_bands()->Swap(message.mutable_bands());
    return absl::OkStatus();
  }

  // Steps 0 and 1. With CULLING_NONE: the whole frame.
  absl::Status Begin(const v1::BeginFrame& begin) {
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    ISOSCOPE_ASSIGN_OR_RETURN(std::vector<std::shared_ptr<const Shard>> shards,
                              service_->FindShards(begin.dataset_id(), begin.shard_indices()));
    ISOSCOPE_ASSIGN_OR_RETURN(task_, FrameTaskFromProto(begin));
    if (begin.mailbox() != 0 && service_->mailboxes_ == nullptr) {
      return absl::InvalidArgumentError(
          absl::StrCat("mailbox is ", begin.mailbox(),
                       ", but this agent shares no process with its coordinator"));
    }
    mailbox_ = begin.mailbox();
    std::optional<base::OneThreadScope> alone;
    EnterOneThread(&alone);
    shard_indices_.assign(begin.shard_indices().begin(), begin.shard_indices().end());
    block_count_ = shards.front()->reader->layout().block_count();
    ISOSCOPE_ASSIGN_OR_RETURN(
        pipeline_, FramePipeline::Make(std::move(shards), task_, service_->Resources(trace_.get()),
                                       &cancellation_));
    if (task_.spec.culling == frame::Culling::kNone) {
      EnterPhase(Phase::kRenderingRest);
      ISOSCOPE_ASSIGN_OR_RETURN(auto reserved, ReserveMemory());
      base::ScopedObservation render(&service_->metrics_.render_visible);
      ISOSCOPE_ASSIGN_OR_RETURN(image::FrameImage image, pipeline_->RenderAll());
      render.End();
      return SendLast(std::move(image), std::move(reserved));
    }
    base::ScopedObservation select(&service_->metrics_.select_occluders);
    ISOSCOPE_ASSIGN_OR_RETURN(const RaySelection selection, pipeline_->SelectOccluders());
    select.End();
    v1::RenderFrameResponse message;
    *message.mutable_ray_hits()->mutable_hits() = rpc::ToProto(selection.hits);
    *message.mutable_ray_hits()->mutable_active_blocks() = rpc::ToProto(selection.active);
    EnterPhase(Phase::kExpectOccluders);
    return Send(std::move(message));
  }

  // Step 2.
  absl::Status RenderOccluders(const v1::Occluders& occluders) {
    std::optional<base::OneThreadScope> alone;
    EnterOneThread(&alone);
    ISOSCOPE_ASSIGN_OR_RETURN(
        const std::vector<volume::BlockId> blocks,
        rpc::BlockListFromProto(occluders.blocks(), block_count_, "occluders.blocks"));
    ISOSCOPE_ASSIGN_OR_RETURN(auto reserved, ReserveMemory());
    base::ScopedObservation render(&service_->metrics_.render_occluders);
    ISOSCOPE_ASSIGN_OR_RETURN(image::FrameImage image, pipeline_->RenderOccluders(blocks));
    render.End();
    v1::RenderFrameResponse message;
    ISOSCOPE_RETURN_IF_ERROR(SendPixels(std::move(image), std::move(reserved), &message));
    message.mutable_occluders_done();
    EnterPhase(Phase::kExpectVisibleBlocks);
    return Send(std::move(message));
  }

  // Step 3.
  absl::Status RenderVisible(const v1::VisibleBlocks& visible) {
    std::optional<base::OneThreadScope> alone;
    EnterOneThread(&alone);
    ISOSCOPE_ASSIGN_OR_RETURN(
        const std::vector<volume::BlockId> blocks,
        rpc::BlockListFromProto(visible.blocks(), block_count_, "visible_blocks.blocks"));
    ISOSCOPE_ASSIGN_OR_RETURN(auto reserved, ReserveMemory());
    base::ScopedObservation render(&service_->metrics_.render_visible);
    ISOSCOPE_ASSIGN_OR_RETURN(image::FrameImage image,
                              pipeline_->RenderVisible(blocks, visible.open_pixels()));
    render.End();
    return SendLast(std::move(image), std::move(reserved));
  }

  // Sends the last pixels and the statistics, and ends the stream.
  absl::Status SendLast(image::FrameImage image, base::MemoryBudget::Reservation reserved) {
    v1::RenderFrameResponse message;
    ISOSCOPE_RETURN_IF_ERROR(SendPixels(std::move(image), std::move(reserved), &message));
    const frame::AgentStatistics& statistics = pipeline_->statistics();
    isoscope::v1::AgentStatistics* proto = message.mutable_frame_done()->mutable_statistics();
    *proto = rpc::ToProto(statistics);
    for (const int index : shard_indices_) {
      proto->add_shard_indices(index);
    }
    AddTrace(message.mutable_frame_done());
    ISOSCOPE_RETURN_IF_ERROR(Send(std::move(message)));
    EnterPhase(Phase::kEnded);
    outgoing_.Finish(absl::OkStatus());
    service_->metrics_.triangles.Add(statistics.triangle_count);
    service_->metrics_.drawn_blocks.Add(statistics.visible_block_count);
    service_->metrics_.CountFrame(absl::OkStatus(), statistics.busy_duration);
    base::LogDebug("frame_done", {{"request", identity_.request_id()},
                                  {"frame", frame_number_},
                                  {"duration_ms", base::LogMilliseconds(absl::Now() - start_)},
                                  {"busy_ms", base::LogMilliseconds(statistics.busy_duration)},
                                  {"active_blocks", statistics.active_block_count},
                                  {"visible_blocks", statistics.visible_block_count},
                                  {"triangles", statistics.triangle_count}});
    // Its layers serve the next frame, which may come before this call is gone.
    pipeline_.reset();
    return absl::OkStatus();
  }

  // Tells the times, if they were asked for. Nothing that follows is in them.
  void AddTrace(v1::FrameDone* done) ABSL_LOCKS_EXCLUDED(mutex_) {
    if (trace_ == nullptr) {
      return;
    }
    rpc::MessageTimes times;
    {
      const base::MutexLock lock(&mutex_);
      times.received = receive_times_;
    }
    const base::RecordedTrace recorded = trace_->Get();
    send_times_.push_back(base::TraceClock::now());
    times.sent = send_times_;
    *done->mutable_trace() = rpc::ToProto(recorded, times, trace_zero_);
  }

  // Ends the frame with an error. Only the first error counts.
  void Fail(const absl::Status& status) ABSL_LOCKS_EXCLUDED(mutex_) {
    std::int64_t frame_number = 0;
    bool is_admitted = false;
    {
      const base::MutexLock lock(&mutex_);
      if (phase_ == Phase::kEnded) {
        return;
      }
      phase_ = Phase::kEnded;
      frame_number = frame_number_;
      is_admitted = is_admitted_;
    }
    cancellation_.Cancel();  // a step may still run
    outgoing_.Finish(status);
    if (is_admitted) {
      service_->metrics_.CountFrame(status, absl::ZeroDuration());
    }
    base::LogWarning("frame_failed", {{"request", identity_.request_id()},
                                      {"frame", frame_number},
                                      {"duration_ms", base::LogMilliseconds(absl::Now() - start_)},
                                      {"status", status}});
  }

  PartitionAgentServiceImpl* const service_;
  grpc::CallbackServerContext* const context_;
  const base::TraceContext identity_;
  const absl::Time start_ = absl::Now();
  base::Cancellation cancellation_;
  rpc::WriteQueue<v1::RenderFrameResponse> outgoing_;
  v1::RenderFrameRequest incoming_;
  std::shared_ptr<RenderFrameCall> self_;  // reset by OnDone

  base::Mutex mutex_;
  Phase phase_ ABSL_GUARDED_BY(mutex_) = Phase::kExpectBegin;
  std::int64_t frame_number_ = 0;                                       // set before the first step
  bool is_admitted_ = false;                                            // set before the first step
  std::vector<base::TraceTime> receive_times_ ABSL_GUARDED_BY(mutex_);  // if there is a trace
  std::unique_ptr<base::TraceRecorder>
      trace_;                   // null: none is asked for; set with the first message
  base::TraceTime trace_zero_;  // the same

  // The steps use these, one after the other.
  FrameTask task_;
  std::vector<int> shard_indices_;
  std::int64_t block_count_ = 0;
  std::int64_t mailbox_ = 0;  // 0: pixels leave as bands
  std::unique_ptr<FramePipeline> pipeline_;
  std::vector<base::TraceTime> send_times_;  // if there is a trace
};

// One ExtractSurface. It owns itself as a RenderFrameCall does.
class PartitionAgentServiceImpl::ExtractSurfaceCall final
    : public grpc::ServerWriteReactor<v1::ExtractSurfaceResponse> {
 public:
  static ExtractSurfaceCall* Start(PartitionAgentServiceImpl* service,
                                   grpc::CallbackServerContext* context,
                                   const v1::ExtractSurfaceRequest* request) {
    std::shared_ptr<ExtractSurfaceCall> call(new ExtractSurfaceCall(service, context, *request));
    call->self_ = call;
    const bool is_scheduled = service->extraction_executor_.TrySchedule([call] { call->Run(); });
    if (!is_scheduled) {
      call->outgoing_.Finish(base::WithRetryDelay(
          absl::ResourceExhaustedError(
              absl::StrCat(kMaxConcurrentExtractions, " extractions are in work and ",
                           kMaxQueuedExtractions, " wait, the most this agent takes: retry later")),
          rpc::UnaryTask::kBusyDelay));
    }
    return call.get();
  }

  void OnWriteDone(bool ok) override { outgoing_.OnWriteDone(ok); }

  void OnCancel() override {
    cancellation_.Cancel();
    outgoing_.Close();
    outgoing_.Finish(absl::CancelledError("the coordinator cancelled the extraction"));
  }

  void OnDone() override { const std::shared_ptr<ExtractSurfaceCall> last_use = std::move(self_); }

 private:
  ExtractSurfaceCall(PartitionAgentServiceImpl* service, grpc::CallbackServerContext* context,
                     const v1::ExtractSurfaceRequest& request)
      : service_(service),
        request_(request),
        identity_(rpc::AnswerTraceContext(context)),
        cancellation_(rpc::DeadlineOf(*context)),
        outgoing_(
            kMaxQueuedBytes,
            [this](const v1::ExtractSurfaceResponse* message) { StartWrite(message); },
            [this](const absl::Status& status) {
              service_->metrics_.CountRequest(AgentMethod::kExtractSurface, status,
                                              absl::Now() - arrival_);
              Finish(rpc::ToGrpcStatus(status));
            }) {}

  void Run() {
    const absl::Time start = absl::Now();
    const absl::Status status = base::OrNoMemory("the surface", [this] { return Extract(); });
    outgoing_.Finish(status);
    base::Log(status.ok() ? base::LogLevel::kInfo : base::LogLevel::kWarning,
              status.ok() ? "extraction_done" : "extraction_failed",
              {{"request", identity_.request_id()},
               {"dataset_id", request_.dataset_id()},
               {"isovalue", request_.isovalue()},
               {"duration_ms", base::LogMilliseconds(absl::Now() - start)},
               {"triangles", triangle_count_},
               {"status", status}});
  }

  absl::Status Extract() {
    ISOSCOPE_RETURN_IF_ERROR(proto::CheckIntact(request_));
    ISOSCOPE_RETURN_IF_ERROR(rpc::CheckKnownFields(request_));
    ISOSCOPE_RETURN_IF_ERROR(rpc::CheckFinite(request_.isovalue(), "isovalue"));
    ISOSCOPE_ASSIGN_OR_RETURN(const view::ClipRegion clip,
                              rpc::ClipRegionFromProto(request_.clip(), "clip"));
    ISOSCOPE_ASSIGN_OR_RETURN(
        std::vector<std::shared_ptr<const Shard>> shards,
        service_->FindShards(request_.dataset_id(), request_.shard_indices()));
    ISOSCOPE_ASSIGN_OR_RETURN(
        const std::unique_ptr<SurfaceExtraction> extraction,
        SurfaceExtraction::Make(std::move(shards), request_.isovalue(), clip,
                                service_->Resources(/*trace=*/nullptr), &cancellation_));
    v1::ExtractSurfaceResponse message;
    std::size_t message_bytes = 0;
    while (true) {
      ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<mesh::BlockMesh> meshes, extraction->NextBatch());
      if (meshes.empty()) {
        break;
      }
      for (const mesh::BlockMesh& mesh : meshes) {
        if (message_bytes > 0 && message_bytes + mesh.size_bytes() > kSurfaceMessageBytes) {
          ISOSCOPE_RETURN_IF_ERROR(Send(&message));
          message_bytes = 0;
        }
        AddBlock(mesh, &message);
        message_bytes += mesh.size_bytes();
        triangle_count_ += mesh.triangle_count();
      }
    }
    return message_bytes > 0 ? Send(&message) : absl::OkStatus();
  }

  absl::Status Send(v1::ExtractSurfaceResponse* message) {
    v1::ExtractSurfaceResponse full;
    full.Swap(message);
    if (outgoing_.Push(std::move(full))) {
      return absl::OkStatus();
    }
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    return absl::CancelledError("the stream has ended");
  }

  PartitionAgentServiceImpl* const service_;
  const v1::ExtractSurfaceRequest request_;
  const base::TraceContext identity_;
  const absl::Time arrival_ = absl::Now();
  base::Cancellation cancellation_;
  rpc::WriteQueue<v1::ExtractSurfaceResponse> outgoing_;
  std::int64_t triangle_count_ = 0;
  std::shared_ptr<ExtractSurfaceCall> self_;  // reset by OnDone
};

PartitionAgentServiceImpl::PartitionAgentServiceImpl(const PartitionAgentServiceOptions& options)
    : shards_(options.shards),
      renderer_(options.renderer),
      cpu_renderer_(
          options.renderer->picture_revision().back_end == frame::BackEnd::kEgl
              ? render::MakeCpuRenderer({.max_kept_bytes = options.memory->kept_mesh_bytes(),
                                         .max_unused_bytes = 0,
                                         .arena = options.arena})
              : nullptr),
      arena_(options.arena),
      one_thread_a_step_(options.one_thread_a_step),
      memory_(options.memory),
      mailboxes_(options.mailboxes),
      max_frames_(options.max_concurrent_frames + options.max_queued_frames),
      description_(Describe(options.shards, *options.renderer)),
      // Refused frames never get here, so the steps of each frame fit: a step has sent its answer,
      // and the next one may be scheduled, before its task has ended.
      frame_executor_(options.frame_executor != nullptr
                          ? options.frame_executor
                          : std::make_shared<base::Executor>(
                                static_cast<std::size_t>(options.max_concurrent_frames),
                                static_cast<std::size_t>(max_frames_)),
                      static_cast<std::size_t>(kStepCount) * static_cast<std::size_t>(max_frames_)),
      extraction_executor_(kMaxConcurrentExtractions, kMaxQueuedExtractions),
      query_executor_(kMaxConcurrentQueries, kMaxQueuedQueries) {
  rpc::PrepareKnownFields(v1::RenderFrameRequest());
}

PartitionAgentServiceImpl::~PartitionAgentServiceImpl() = default;

AgentGauges PartitionAgentServiceImpl::gauges() const {
  return {.frames = frame_count_.load(),
          .max_frames = max_frames_,
          .shard_count = shards_.size(),
          .mesh_cache_bytes = memory_->cache()->mesh_bytes(),
          .sample_cache_bytes = memory_->cache()->sample_bytes(),
          .active_cache_bytes = memory_->cache()->active_bytes(),
          .memory_limit_bytes = memory_->limit_bytes()};
}

isoscope::v1::AgentLoad PartitionAgentServiceImpl::Load() const {
  isoscope::v1::AgentLoad load;
  *load.mutable_up_duration() = rpc::ToProto(absl::Now() - start_);
  load.set_working_frame_count(frame_count_.load());
  load.set_done_frame_count(metrics_.done_frames.value());
  load.set_failed_frame_count(metrics_.failed_frames.value() + metrics_.cancelled_frames.value());
  load.set_read_bytes(metrics_.read_bytes.value());
  load.set_triangle_count(metrics_.triangles.value());
  *load.mutable_busy_duration() = rpc::ToProto(absl::Nanoseconds(metrics_.busy.value()));
  load.set_resident_bytes(static_cast<std::int64_t>(base::ResidentBytes()));
  load.set_memory_limit_bytes(static_cast<std::int64_t>(memory_->limit_bytes()));
  return load;
}

rpc::OnCallEnd PartitionAgentServiceImpl::UnaryEnd(AgentMethod method,
                                                   const google::protobuf::Message* request,
                                                   const google::protobuf::Message* response,
                                                   grpc::CallbackServerContext* context) {
  return [=, this](const absl::Status& status, absl::Duration duration,
                   const base::TraceContext& /*identity*/) {
    metrics_.CountRequest(method, status, duration);
    rpc::AnswerChecksum(*request, status, *response, context);
  };
}

AgentResources PartitionAgentServiceImpl::Resources(base::TraceRecorder* trace) {
  return {.renderer = renderer_.get(),
          .layers = memory_->layers(),
          .cpu_renderer = cpu_renderer_.get(),
          .arena = arena_.get(),
          .cache = memory_->cache(),
          .max_read_bytes = memory_->read_bytes(),
          .trace = trace,
          .metrics = &metrics_};
}

grpc::ServerUnaryReactor* PartitionAgentServiceImpl::DescribeShards(
    grpc::CallbackServerContext* context, const v1::DescribeShardsRequest* request,
    v1::DescribeShardsResponse* response) {
  return rpc::AnswerUnary(
      context, *request,
      [&] {
        *response = description_;
        *response->mutable_load() = Load();
        response->set_is_draining(is_draining_.load());
        return absl::OkStatus();
      },
      UnaryEnd(AgentMethod::kDescribeShards, request, response, context));
}

grpc::ServerBidiReactor<v1::RenderFrameRequest, v1::RenderFrameResponse>*
PartitionAgentServiceImpl::RenderFrame(grpc::CallbackServerContext* context) {
  return RenderFrameCall::Start(this, context);
}

grpc::ServerWriteReactor<v1::ExtractSurfaceResponse>* PartitionAgentServiceImpl::ExtractSurface(
    grpc::CallbackServerContext* context, const v1::ExtractSurfaceRequest* request) {
  return ExtractSurfaceCall::Start(this, context, request);
}

grpc::ServerUnaryReactor* PartitionAgentServiceImpl::GetShardHistogram(
    grpc::CallbackServerContext* context, const v1::GetShardHistogramRequest* request,
    v1::GetShardHistogramResponse* response) {
  return rpc::UnaryTask::Start(
      context, *request, &query_executor_, kMaxQueryDuration,
      [this, request, response](const base::Cancellation& /*cancellation*/,
                                const base::TraceContext& /*identity*/) -> absl::Status {
        ISOSCOPE_ASSIGN_OR_RETURN(const rpc::HistogramQuery query,
                                  rpc::HistogramQueryFromProto(*request));
        ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::shared_ptr<const Shard>> shards,
                                  FindShards(request->dataset_id(), request->shard_indices()));
        ISOSCOPE_ASSIGN_OR_RETURN(
            const volume::HistogramPart part,
            HistogramOfShards(shards, query.max_bin_count, query.value_range));
        *response = rpc::ToProto(part);
        return absl::OkStatus();
      },
      UnaryEnd(AgentMethod::kGetShardHistogram, request, response, context));
}

grpc::ServerUnaryReactor* PartitionAgentServiceImpl::GetActiveBox(
    grpc::CallbackServerContext* context, const v1::GetActiveBoxRequest* request,
    v1::GetActiveBoxResponse* response) {
  return rpc::UnaryTask::Start(
      context, *request, &query_executor_, kMaxQueryDuration,
      [this, request, response](const base::Cancellation& /*cancellation*/,
                                const base::TraceContext& /*identity*/) -> absl::Status {
        if (request->isovalues().empty()) {
          return absl::InvalidArgumentError("isovalues is empty: must name at least one");
        }
        for (const double isovalue : request->isovalues()) {
          ISOSCOPE_RETURN_IF_ERROR(rpc::CheckFinite(isovalue, "isovalues"));
        }
        ISOSCOPE_ASSIGN_OR_RETURN(const view::ClipRegion clip,
                                  rpc::ClipRegionFromProto(request->clip(), "clip"));
        ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const Shard> shard,
                                  FindAnyShard(request->dataset_id()));
        const ActiveBox box =
            ActiveBoxOf(shard->reader->layout(), shard->reader->ranges(),
                        {request->isovalues().begin(), request->isovalues().end()},
                        view::Clipper(clip, shard->reader->manifest().geometry));
        *response = rpc::ToProto(box.block_count, box.cells);
        return absl::OkStatus();
      },
      UnaryEnd(AgentMethod::kGetActiveBox, request, response, context));
}

grpc::ServerUnaryReactor* PartitionAgentServiceImpl::GetGradients(
    grpc::CallbackServerContext* context, const v1::GetGradientsRequest* request,
    v1::GetGradientsResponse* response) {
  return rpc::UnaryTask::Start(
      context, *request, &query_executor_, kMaxQueryDuration,
      [this, request, response](const base::Cancellation& cancellation,
                                const base::TraceContext& /*identity*/) -> absl::Status {
        ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<math::Vec3d> points,
                                  rpc::PickedPointsFromProto(*request));
        ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::shared_ptr<const Shard>> shards,
                                  FindShards(request->dataset_id(), request->shard_indices()));
        ISOSCOPE_ASSIGN_OR_RETURN(
            const std::vector<std::optional<volume::BlockId>> block_ids,
            rpc::PickedBlocksFromProto(*request, shards.front()->reader->layout().block_count()));
        ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<PointGradient> gradients,
                                  GradientsAt(shards, points, cancellation));
        for (const PointGradient& gradient : gradients) {
          v1::PointGradient* const out = response->add_gradients();
          out->set_point_index(static_cast<std::int32_t>(gradient.point_index));
          *out->mutable_gradient() = rpc::ToProto(gradient.gradient);
        }
        for (const PointShard& shard : ShardsOf(shards, block_ids)) {
          v1::PointShard* const out = response->add_shards();
          out->set_point_index(static_cast<std::int32_t>(shard.point_index));
          out->set_shard_index(shard.shard_index);
        }
        return absl::OkStatus();
      },
      UnaryEnd(AgentMethod::kGetGradients, request, response, context));
}

absl::StatusOr<std::shared_ptr<const Shard>> PartitionAgentServiceImpl::FindAnyShard(
    const std::string& dataset_id) const {
  for (const std::shared_ptr<const Shard>& shard : shards_) {
    if (shard->reader->manifest().dataset_id == dataset_id) {
      return shard;
    }
  }
  return absl::FailedPreconditionError(
      absl::StrCat("dataset id ", dataset_id, " is not served by this agent (any more)"));
}

absl::StatusOr<std::vector<std::shared_ptr<const Shard>>> PartitionAgentServiceImpl::FindShards(
    const std::string& dataset_id,
    const google::protobuf::RepeatedField<std::int32_t>& shard_indices) const {
  std::vector<std::shared_ptr<const Shard>> of_dataset;
  std::vector<int> served;
  for (const std::shared_ptr<const Shard>& shard : shards_) {
    if (shard->reader->manifest().dataset_id == dataset_id) {
      of_dataset.push_back(shard);
      served.push_back(shard->reader->shard_index());
    }
  }
  if (of_dataset.empty()) {
    return absl::FailedPreconditionError(
        absl::StrCat("dataset id ", dataset_id, " is not served by this agent (any more)"));
  }
  const int shard_count = static_cast<int>(of_dataset.front()->reader->manifest().shards.size());
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::vector<int> wanted,
      rpc::ShardIndicesFromProto(shard_indices, shard_count, "shard_indices"));
  std::vector<std::shared_ptr<const Shard>> found;
  for (const int index : wanted) {
    const auto position = std::find(served.begin(), served.end(), index);
    if (position == served.end()) {
      std::sort(served.begin(), served.end());
      return absl::FailedPreconditionError(absl::StrCat(
          "shard ", index, " of dataset \"", of_dataset.front()->reader->manifest().name,
          "\" is not served by this agent (any more); it serves ", absl::StrJoin(served, ", ")));
    }
    found.push_back(of_dataset[static_cast<std::size_t>(position - served.begin())]);
  }
  return found;
}

}  // namespace isoscope::agent
