// A frame on an agent, as a reactor of gRPC (FrameStream):
//
//   event         action
//   Start         queues `begin`, starts the first read, holds the stream, starts the call
//   Send          queues a message; writes follow one another, one at a time
//   OnReadDone    hands the message to the listener and starts the next read; the first malformed
//                 message is kept as the error, and cancels the call
//   reads end     releases the hold, and drops messages that come later
//   OnDone        tells the listener how the call ended, then wakes WaitUntilEnded
//
// The hold is needed because writes start outside reactions: without it gRPC could finish the
// stream between two of them. OnDone is the last call. GrpcAgentLink cancels and waits for it
// before it destroys the stream.
//
// The status for the listener is the first of these that applies:
//
//   UNAVAILABLE    a message was damaged on its way
//   INTERNAL       a message is malformed
//   INTERNAL       the stream ended with OK before the frame was done
//   CallStatus     gRPC's status

#include "server/frame/agent_client.h"

#include <atomic>
#include <deque>
#include <iterator>
#include <optional>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>
#include <grpcpp/support/client_callback.h>

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "isoscope/internal/v1/partition_agent_service.grpc.pb.h"
#include "proto/message_checksum.h"
#include "rpc/grpc_status.h"
#include "rpc/request_context.h"
#include "server/frame/agent_call.h"
#include "wire/proto_convert.h"
#include "wire/trace_convert.h"

namespace isoscope::server {
namespace {

namespace internal = isoscope::internal::v1;

// The stream of one frame. Its owner waits until it has ended, and then destroys it. If a reaction
// dropped the last reference to a channel instead, gRPC would join the reaction's own thread.
class FrameStream final
    : public grpc::ClientBidiReactor<internal::RenderFrameRequest, internal::RenderFrameResponse> {
 public:
  FrameStream(const AgentAssignment& agent, std::int64_t block_count, base::MonotonicTime deadline,
              image::PixelMailboxes* mailboxes, const base::TraceContext& identity,
              const AgentTraceTarget& trace_target, AgentListener* listener)
      : agent_(agent.identity()),
        block_count_(block_count),
        mailbox_(mailboxes == nullptr ? nullptr : mailboxes->Open()),
        trace_target_(trace_target),
        listener_(listener),
        stub_(internal::PartitionAgentService::NewStub(agent.channel)) {
    SetDeadline(deadline, &context_);
    rpc::SetTraceparent(identity, &context_);
  }

  static void Start(FrameStream* stream, internal::BeginFrame begin) {
    stream->stub_->async()->RenderFrame(&stream->context_, stream);
    // The hold keeps the stream alive until reads have ended.
    stream->AddHold();
    if (stream->mailbox_ != nullptr) {
      begin.set_mailbox(stream->mailbox_->number());
    }
    internal::RenderFrameRequest request;
    *request.mutable_begin() = std::move(begin);
    stream->Send(std::move(request));
    stream->StartRead(&stream->incoming_);
    stream->StartCall();
  }

  void Send(internal::RenderFrameRequest request) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    if (reads_have_ended_) {
      return;  // OnEnd reports why
    }
    if (trace_target_.trace != nullptr) {
      sent_.push_back(base::TraceClock::now());
    }
    outgoing_.push_back(std::move(request));
    StartNextWrite();
  }

  void Cancel() {
    was_cancelled_.store(true);
    context_.TryCancel();
  }

  // Waits until OnEnd has returned.
  void WaitUntilEnded() ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    ended_.Await(&mutex_, [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return has_ended_; });
  }

  [[nodiscard]] const AgentIdentity& agent() const { return agent_; }
  [[nodiscard]] std::int64_t network_bytes() const {
    return mailbox_ == nullptr ? network_bytes_.load() : 0;
  }

  void OnReadDone(bool ok) override {
    if (!ok) {
      const base::MutexLock lock(&mutex_);
      reads_have_ended_ = true;
      RemoveHold();
      return;
    }
    if (trace_target_.trace != nullptr) {
      received_.push_back(base::TraceClock::now());
      TakeTrace();
    }
    network_bytes_.fetch_add(static_cast<std::int64_t>(incoming_.ByteSizeLong()));
    // After a malformed message only the end of the stream matters.
    if (message_error_.ok()) {
      message_error_ = Deliver(&incoming_);
      if (!message_error_.ok()) {
        context_.TryCancel();
      }
    }
    // The hold keeps the stream alive until then.
    listener_->WhenRoom([this] { StartRead(&incoming_); });
  }

  void OnWriteDone(bool ok) override {
    const base::MutexLock lock(&mutex_);
    is_writing_ = false;
    if (!ok) {
      outgoing_.clear();  // the stream is broken, so reads end, too
      return;
    }
    outgoing_.pop_front();
    StartNextWrite();
  }

  void OnDone(const grpc::Status& grpc_status) override {
    listener_->OnEnd(EndStatus(rpc::ToAbslStatus(grpc_status)));
    const base::MutexLock lock(&mutex_);
    has_ended_ = true;
    // It signals with the mutex held: the waiting thread may destroy this object as soon as it has
    // the mutex.
    ended_.SignalAll();
  }

 private:
  void StartNextWrite() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (is_writing_ || outgoing_.empty() || reads_have_ended_) {
      return;
    }
    is_writing_ = true;
    network_bytes_.fetch_add(static_cast<std::int64_t>(BytesWithoutTrace(outgoing_.front())));
    StartWrite(&outgoing_.front());
  }

  // Statistics as they are without a trace.
  static std::size_t BytesWithoutTrace(const internal::RenderFrameRequest& message) {
    if (!message.has_begin() || !message.begin().with_trace()) {
      return message.ByteSizeLong();
    }
    internal::RenderFrameRequest plain = message;
    plain.mutable_begin()->clear_with_trace();
    return plain.ByteSizeLong();
  }

  // Takes the agent's times out of the message.
  void TakeTrace() ABSL_LOCKS_EXCLUDED(mutex_) {
    if (!incoming_.has_frame_done() || !incoming_.frame_done().has_trace()) {
      return;
    }
    wire::MessageTimes times;
    times.received = received_;
    {
      const base::MutexLock lock(&mutex_);
      times.sent = sent_;
    }
    internal::AgentTrace trace = std::move(*incoming_.mutable_frame_done()->mutable_trace());
    wire::KeepFirstSpans(trace_target_.max_spans, trace.mutable_spans());
    *trace_target_.trace =
        wire::AlignAgentTrace(std::move(trace), times, trace_target_.zero, agent_.address);
    incoming_.mutable_frame_done()->clear_trace();
  }

  // Hands one message to the listener.
  absl::Status Deliver(internal::RenderFrameResponse* message) {
    ISOSCOPE_RETURN_IF_ERROR(proto::CheckIntact(*message));
    const bool has_bands = message->bands_size() > 0;
    if (has_bands) {
      listener_->OnPixels({std::make_move_iterator(message->mutable_bands()->begin()),
                           std::make_move_iterator(message->mutable_bands()->end())});
    }
    if (message->pixels_are_in_mailbox()) {
      std::optional<image::DrawnPixels> pixels;
      if (mailbox_ != nullptr) {
        pixels = mailbox_->Take();
      }
      if (!pixels) {
        return absl::InvalidArgumentError("pixels_are_in_mailbox, but there are none");
      }
      listener_->OnDrawnPixels(*std::move(pixels));
    }
    switch (message->message_case()) {
      case internal::RenderFrameResponse::kRayHits: {
        ISOSCOPE_ASSIGN_OR_RETURN(
            std::vector<volume::BlockId> hits,
            wire::BlockListFromProto(message->ray_hits().hits(), block_count_, "ray_hits.hits"));
        ISOSCOPE_ASSIGN_OR_RETURN(std::vector<volume::BlockId> active,
                                  wire::BlockListFromProto(message->ray_hits().active_blocks(),
                                                           block_count_, "ray_hits.active_blocks"));
        listener_->OnRayHits(std::move(hits), std::move(active));
        return absl::OkStatus();
      }
      case internal::RenderFrameResponse::kOccludersDone:
        listener_->OnOccludersDone();
        return absl::OkStatus();
      case internal::RenderFrameResponse::kFrameDone: {
        frame::AgentStatistics statistics =
            wire::AgentStatisticsFromProto(message->frame_done().statistics());
        statistics.agent_address = agent_.address;
        statistics.shard_indices = agent_.shard_indices;
        is_frame_done_ = true;
        listener_->OnFrameDone(std::move(statistics));
        return absl::OkStatus();
      }
      case internal::RenderFrameResponse::MESSAGE_NOT_SET:
        break;
    }
    return has_bands ? absl::OkStatus() : absl::InvalidArgumentError("an empty message");
  }

  absl::Status EndStatus(const absl::Status& status) const {
    if (absl::IsUnavailable(message_error_)) {  // damaged on its way
      return message_error_;
    }
    if (!message_error_.ok()) {
      return absl::InternalError(
          absl::StrCat("sent a malformed message: ", message_error_.message()));
    }
    if (status.ok() && !is_frame_done_) {
      return absl::InternalError("ended the stream before the frame was done");
    }
    return CallStatus(status, was_cancelled_.load());
  }

  const AgentIdentity agent_;
  const std::int64_t block_count_;
  const std::unique_ptr<image::PixelMailboxes::Mailbox> mailbox_;  // null: pixels come as bands
  const AgentTraceTarget trace_target_;
  AgentListener* const listener_;
  const std::unique_ptr<internal::PartitionAgentService::Stub> stub_;
  grpc::ClientContext context_;
  std::atomic<bool> was_cancelled_{false};
  std::atomic<std::int64_t> network_bytes_{0};

  // Only reads touch these, and they follow one another.
  internal::RenderFrameResponse incoming_;
  std::vector<base::TraceTime> received_;  // each message, if there is a trace
  absl::Status message_error_;
  bool is_frame_done_ = false;

  base::Mutex mutex_;
  base::CondVar ended_;
  std::deque<internal::RenderFrameRequest> outgoing_ ABSL_GUARDED_BY(mutex_);  // front: in flight
  std::vector<base::TraceTime> sent_ ABSL_GUARDED_BY(mutex_);  // each message, if there is a trace
  bool is_writing_ ABSL_GUARDED_BY(mutex_) = false;
  bool reads_have_ended_ ABSL_GUARDED_BY(mutex_) = false;
  bool has_ended_ ABSL_GUARDED_BY(mutex_) = false;
};

class GrpcAgentLink final : public AgentLink {
 public:
  explicit GrpcAgentLink(std::unique_ptr<FrameStream> stream) : stream_(std::move(stream)) {}
  ~GrpcAgentLink() override {
    stream_->Cancel();
    stream_->WaitUntilEnded();
  }

  void SendOccluders(const std::vector<volume::BlockId>& blocks) override {
    internal::RenderFrameRequest request;
    *request.mutable_occluders()->mutable_blocks() = wire::ToProto(blocks);
    stream_->Send(std::move(request));
  }
  void SendVisibleBlocks(const std::vector<volume::BlockId>& blocks,
                         std::string open_pixels) override {
    internal::RenderFrameRequest request;
    *request.mutable_visible_blocks()->mutable_blocks() = wire::ToProto(blocks);
    request.mutable_visible_blocks()->set_open_pixels(std::move(open_pixels));
    stream_->Send(std::move(request));
  }
  void Cancel() override { stream_->Cancel(); }
  [[nodiscard]] const AgentIdentity& agent() const override { return stream_->agent(); }
  [[nodiscard]] std::int64_t network_bytes() const override { return stream_->network_bytes(); }

 private:
  const std::unique_ptr<FrameStream> stream_;
};

}  // namespace

std::unique_ptr<AgentLink> BeginFrameOnAgent(const AgentAssignment& agent,
                                             internal::BeginFrame begin, std::int64_t block_count,
                                             base::MonotonicTime deadline,
                                             image::PixelMailboxes* mailboxes,
                                             const base::TraceContext& identity,
                                             const AgentTraceTarget& trace_target,
                                             AgentListener* listener) {
  begin.clear_shard_indices();
  for (const int index : agent.shard_indices) {
    begin.add_shard_indices(index);
  }
  auto stream = std::make_unique<FrameStream>(agent, block_count, deadline, mailboxes, identity,
                                              trace_target, listener);
  FrameStream::Start(stream.get(), std::move(begin));
  return std::make_unique<GrpcAgentLink>(std::move(stream));
}

}  // namespace isoscope::server
