// Uses gRPC's blocking reader. Next takes the blocks of a message one by one and checks each. It
// reads the next message only on demand. Blocks come in ascending order, so a replica that takes
// over is read up to the last block that was given.

#include "server/frame/surface_stream.h"

#include <cstring>
#include <utility>

#include "absl/strings/str_cat.h"
#include <grpcpp/channel.h>

#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "proto/message_checksum.h"
#include "rpc/grpc_status.h"
#include "rpc/read_timeout.h"
#include "rpc/request_context.h"
#include "server/frame/agent_call.h"

namespace isoscope::server {
namespace {

namespace internal = isoscope::internal::v1;

// ExtractSurfaceRequest.answer_form: vertices have copy numbers, and triangles are cut.
constexpr int kAnswerForm = 2;

// Fills `values` from little-endian bytes. False if their size is not a multiple of a value's.
template <typename T>
bool Unpack(const std::string& bytes, std::vector<T>* values) {
  if (bytes.size() % sizeof(T) != 0) {
    return false;
  }
  values->resize(bytes.size() / sizeof(T));
  if (!bytes.empty()) {
    std::memcpy(values->data(), bytes.data(), bytes.size());
  }
  return true;
}

}  // namespace

absl::Status UnpackBlock(const internal::BlockSurface& proto, const volume::BlockLayout& layout,
                         mesh::BlockMesh* block) {
  if (proto.block_id() < 0 || proto.block_id() >= layout.block_count()) {
    return absl::InvalidArgumentError(absl::StrCat(
        "block_id is ", proto.block_id(), ": must lie in [0, ", layout.block_count(), ")"));
  }
  block->block_id = static_cast<volume::BlockId>(proto.block_id());
  if (!Unpack(proto.positions(), &block->positions) || !Unpack(proto.normals(), &block->normals) ||
      !Unpack(proto.copies(), &block->copies) || !Unpack(proto.triangles(), &block->indices) ||
      block->normals.size() != block->positions.size() ||
      (!block->copies.empty() && block->copies.size() != block->positions.size()) ||
      block->indices.size() % 3 != 0) {
    return absl::InvalidArgumentError(absl::StrCat(
        "block ", proto.block_id(), " has ", proto.positions().size(), " bytes of positions, ",
        proto.normals().size(), " of normals, ", proto.copies().size(), " of copy numbers, ",
        proto.triangles().size(), " of triangles: they do not fit together"));
  }
  for (const std::uint32_t index : block->indices) {
    if (index >= block->positions.size()) {
      return absl::InvalidArgumentError(absl::StrCat("block ", proto.block_id(),
                                                     " has a triangle of vertex ", index, " of ",
                                                     block->positions.size()));
    }
  }
  for (const math::Vec3f& position : block->positions) {
    for (int axis = 0; axis < 3; ++axis) {
      const auto last = static_cast<float>(layout.sample_dims()[axis] - 1);
      if (!(position[axis] >= 0 && position[axis] <= last)) {
        return absl::InvalidArgumentError(
            absl::StrCat("block ", proto.block_id(), " has a vertex at ", position[axis],
                         " on axis ", axis, ": must lie in [0, ", last, "]"));
      }
    }
  }
  return absl::OkStatus();
}

absl::StatusOr<solid::SurfaceSums> UnpackSums(const internal::SurfaceSums& proto) {
  solid::SurfaceSums sums;
  ISOSCOPE_ASSIGN_OR_RETURN(sums.area, math::ExactSum::Decode(proto.area()));
  ISOSCOPE_ASSIGN_OR_RETURN(sums.volume, math::ExactSum::Decode(proto.volume()));
  sums.triangle_count = proto.triangle_count();
  sums.open_side_count = proto.open_edge_count();
  if (sums.triangle_count < 0 || sums.open_side_count < 0) {
    return absl::InvalidArgumentError(absl::StrCat("sums of ", sums.triangle_count,
                                                   " triangles and ", sums.open_side_count,
                                                   " open edges: must be at least 0"));
  }
  return sums;
}

struct SurfaceStream::Call {
  std::unique_ptr<internal::PartitionAgentService::Stub> stub;
  grpc::ClientContext context;
  std::unique_ptr<grpc::ClientReader<internal::ExtractSurfaceResponse>> reader;
};

SurfaceStream::SurfaceStream(FramePart part, const volume::BlockLayout& layout,
                             internal::ExtractSurfaceRequest request, base::MonotonicTime deadline,
                             absl::Duration max_silence, const base::TraceContext& identity)
    : part_(std::move(part)),
      layout_(layout),
      request_(std::move(request)),
      deadline_(deadline),
      max_silence_(max_silence),
      identity_(identity) {
  request_.set_answer_form(kAnswerForm);
  request_.clear_shard_indices();
  for (const int index : part_.shard_indices) {
    request_.add_shard_indices(index);
  }
  Open();
}

void SurfaceStream::Open() {
  auto call = std::make_unique<Call>();
  const ServingAgent& agent = part_.replicas[replica_];
  call->stub = internal::PartitionAgentService::NewStub(
      agent.export_channel != nullptr ? agent.export_channel : agent.channel);
  SetDeadline(deadline_, &call->context);
  rpc::SetTraceparent(identity_, &call->context);
  call->reader = call->stub->ExtractSurface(&call->context, request_);
  message_.Clear();
  next_block_ = 0;
  has_ended_ = false;
  sums_.reset();
  const base::MutexLock lock(&mutex_);
  call_ = std::move(call);
  if (was_cancelled_.load()) {
    call_->context.TryCancel();
  }
}

SurfaceStream::~SurfaceStream() {
  if (!has_ended_) {
    call_->context.TryCancel();
    call_->reader->Finish();
  }
}

void SurfaceStream::Cancel() {
  was_cancelled_.store(true);
  const base::MutexLock lock(&mutex_);
  call_->context.TryCancel();
}

absl::StatusOr<bool> SurfaceStream::ReadMessage() {
  message_.Clear();
  rpc::ReadTimeout timeout(&call_->context, max_silence_);
  const bool has_message = call_->reader->Read(&message_);
  if (timeout.Stop()) {
    message_.Clear();
    return absl::DeadlineExceededError(
        absl::StrCat("sent nothing for ", absl::FormatDuration(max_silence_)));
  }
  return has_message;
}

absl::Status SurfaceStream::Fail(absl::Status status, bool was_silent) {
  if (was_cancelled_.load()) {  // by the export: no failure of the agent
    return absl::CancelledError("the export was cancelled");
  }
  failures_.push_back({.part_index = 0,
                       .agent = part_.On(replica_).identity(),
                       .stage = PartStage::kExtracting,
                       .status = std::move(status)});
  const AgentFailure& failure = failures_.back();
  const bool is_repeatable = !absl::IsCancelled(failure.status) &&
                             (was_silent || !absl::IsDeadlineExceeded(failure.status));
  if (!is_repeatable || replica_ + 1 == part_.replicas.size()) {
    return failure.ToStatus();
  }
  if (!has_ended_) {
    call_->context.TryCancel();
    call_->reader->Finish();
  }
  ++replica_;
  Open();
  return absl::OkStatus();
}

absl::Status SurfaceStream::TakeSums() {
  const absl::StatusOr<solid::SurfaceSums> sums = UnpackSums(message_.sums());
  if (!sums.ok()) {
    return absl::InternalError(absl::StrCat("sent malformed sums: ", sums.status().message()));
  }
  sums_ = *sums;
  return absl::OkStatus();
}

absl::StatusOr<bool> SurfaceStream::Next(mesh::BlockMesh* block) {
  while (true) {
    if (next_block_ == message_.blocks_size()) {
      if (has_ended_) {
        return false;
      }
      next_block_ = 0;
      const absl::StatusOr<bool> has_message = ReadMessage();
      if (!has_message.ok()) {
        ISOSCOPE_RETURN_IF_ERROR(Fail(has_message.status(), /*was_silent=*/true));
        continue;
      }
      if (*has_message) {
        absl::Status status = proto::CheckIntact(message_);
        if (status.ok() && message_.has_sums()) {
          status = TakeSums();
        }
        if (!status.ok()) {
          ISOSCOPE_RETURN_IF_ERROR(Fail(status));
        }
        continue;
      }
      message_.Clear();
      has_ended_ = true;
      const grpc::Status status = call_->reader->Finish();
      if (!status.ok()) {
        ISOSCOPE_RETURN_IF_ERROR(
            Fail(CallStatus(rpc::ToAbslStatus(status), was_cancelled_.load())));
      }
      continue;
    }
    const absl::Status status = UnpackBlock(message_.blocks(next_block_++), layout_, block);
    if (!status.ok()) {
      ISOSCOPE_RETURN_IF_ERROR(
          Fail(absl::InternalError(absl::StrCat("sent a malformed block: ", status.message()))));
    } else if (replica_ == 0 || static_cast<std::int64_t>(block->block_id) > last_block_id_) {
      last_block_id_ = static_cast<std::int64_t>(block->block_id);
      return true;
    }
  }
}

}  // namespace isoscope::server
