// An export opens a stream to each agent, for one surface after the other, and lets
// mesh::MergeSurface merge them, on an export thread. Its chunks wait in outgoing_. When 2 MiB wait
// for a slow client, the merge waits, and gRPC's flow control then stops the agents. OnCancel
// cancels the streams, which wakes the merge.
//
// From its admission to its end, an empty message now and then tells the client that the export
// goes on, while nothing else is on its way.
//
// EndEarly cancels them too, and sends the client the reason. An alarm calls it for a client that
// is too slow (pace_alarm), and the watch of a token that is withdrawn. Both ring a bell, and never
// own the call: their threads may outlive its service.

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"

#include "core/base/cancellation.h"
#include "core/base/log.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/mesh/surface_merger.h"
#include "core/mesh/world_placement.h"
#include "core/solid/surface_sums.h"
#include "rpc/signs_of_life.h"
#include "rpc/write_queue.h"
#include "server/admission/coordinator_memory.h"
#include "server/call/bell.h"
#include "server/call/call_work.h"
#include "server/call/public_call.h"
#include "server/cluster/served_levels.h"
#include "server/frame/frame_runner.h"
#include "server/frame/surface_stream.h"
#include "server/isosurface_service_impl.h"
#include "server/pace_alarm.h"
#include "wire/frame_convert.h"
#include "wire/proto_convert.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;

// If this many bytes of chunks wait for a slow client, the merge waits too.
constexpr std::size_t kMaxQueuedExportBytes = 2 * base::kMiB;
// A client must take a chunk of a mesh within this time.
constexpr absl::Duration kMaxChunkDuration = absl::Minutes(1);
// A client whose token was withdrawn must take the chunk on its way within this time.
constexpr absl::Duration kMaxLastWriteDuration = absl::Seconds(2);

std::int64_t BytesOf(const v1::ExportIsosurfaceResponse& message) {
  return static_cast<std::int64_t>(message.positions().size() + message.normals().size() +
                                   message.triangles().size());
}

// One surface, as it was sent.
struct ExportedSurface {
  std::int64_t vertex_count = 0;
  std::optional<solid::SurfaceSums> sums;  // none if an agent has none
};

}  // namespace

class IsosurfaceServiceImpl::ExportCall final
    : public grpc::ServerWriteReactor<v1::ExportIsosurfaceResponse>,
      public std::enable_shared_from_this<ExportCall> {
 public:
  ExportCall(const IsosurfaceServiceOptions& options, Admission* exports,
             grpc::CallbackServerContext* context, const v1::ExportIsosurfaceRequest& request)
      : options_(options),
        state_(*options.state),
        request_(request),
        call_(&options.state->calls, RequestMethod::kExportIsosurface, context, request.dataset()),
        work_(exports, call_.deadline()),
        outgoing_(
            kMaxQueuedExportBytes,
            [this](const v1::ExportIsosurfaceResponse* message) { StartWrite(message); },
            [this](const absl::Status& status) { End(status); }) {}

  // REQUIRES: a shared_ptr owns the call.
  void Start() {
    self_ = shared_from_this();
    const absl::Status admitted = Admit();
    if (!admitted.ok()) {
      outgoing_.Finish(admitted);
      return;
    }
    withdrawal_.Hang([this] { EndWithdrawn(); });
    watch_.emplace(call_.caller().WhenWithdrawn(withdrawal_.Rope()));
    signs_.Start(options_.sign_of_life_interval,
                 [this] { outgoing_.PushIfIdle([this] { return BeginMessage(); }); });
    work_.Schedule([self = shared_from_this()](const absl::Status& turn) { self->Run(turn); });
  }

  void OnWriteDone(bool ok) override {
    call_.timeout().Pause();
    pace_.OnWriteDone();
    call_.unsent().Add(-in_flight_unsent_bytes_.exchange(0));
    outgoing_.OnWriteDone(ok);
  }

  void OnCancel() override {
    outgoing_.Close();
    work_.Cancel();
    outgoing_.Finish(absl::CancelledError("the client cancelled the export"));
  }

  void OnDone() override {
    call_.timeout().Stop();
    signs_.Stop();
    pace_.Stop();
    withdrawal_.Silence();
    const std::shared_ptr<ExportCall> last_use = std::move(self_);
  }

 private:
  absl::Status Admit() {
    ISOSCOPE_RETURN_IF_ERROR(call_.Identify());
    ISOSCOPE_ASSIGN_OR_RETURN(spec_, wire::ExportSpecFromProto(request_));
    ISOSCOPE_RETURN_IF_ERROR(work_.TakeUse(call_.caller(), CallerUse::kExport));
    ISOSCOPE_RETURN_IF_ERROR(work_.TakeRate(/*is_moving=*/false));
    return work_.TakePlace(call_.caller().QueueKey(call_.origin().client));
  }

  // `turn`: the reason if the turn of the export did not come.
  void Run(const absl::Status& turn) ABSL_LOCKS_EXCLUDED(end_mutex_) {
    const base::MonotonicTime start = base::MonotonicNow();
    if (turn.ok()) {
      pace_.Start(options_.export_limits, [this] { JudgePace(); });
    }
    absl::Status status = turn.ok() ? Export() : turn;
    {
      const base::MutexLock lock(&end_mutex_);
      if (!end_.ok()) {
        status = end_;
      }
    }
    work_.ShrinkMemory(CoordinatorMemory::kExportAnswerBytes);
    work_.GiveBackPlace();
    outgoing_.Finish(status);
    const bool is_expected = status.ok() || absl::IsCancelled(status);
    base::Log(is_expected ? base::LogLevel::kInfo : base::LogLevel::kWarning,
              status.ok()   ? "export_done"
              : is_expected ? "export_cancelled"
                            : "export_failed",
              {{"request", call_.request().request_id()},
               {"dataset", request_.dataset()},
               {"surfaces", frame::TextOf(spec_.rules)},
               {"duration_ms", base::LogMilliseconds(base::MonotonicNow() - start)},
               {"bytes", sent_bytes_.load()},
               {"caller", call_.caller().name()},
               {"peer", call_.origin().client},
               {"status", status}});
  }

  absl::Status Export() {
    const base::Cancellation& cancellation = work_.cancellation();
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    ISOSCOPE_ASSIGN_OR_RETURN(
        const std::shared_ptr<const DatasetState> found,
        state_.registry->FindComplete(request_.dataset(), cancellation, call_.caller()));
    call_.NoteDataset({.name = found->dataset.name(), .id = found->dataset.dataset_id()});
    ISOSCOPE_RETURN_IF_ERROR(CheckDatasetId(found->dataset, request_.dataset_id()));
    std::vector<frame::Surface> no_surfaces;  // colours decide no mesh
    ISOSCOPE_ASSIGN_OR_RETURN(
        const SelectedVolume selected,
        SelectVolume(found, request_.has_selection() ? &request_.selection() : nullptr,
                     &no_surfaces));
    const v1::Dataset& dataset = selected.dataset->dataset;
    ISOSCOPE_ASSIGN_OR_RETURN(const volume::GridGeometry whole,
                              wire::GeometryFromProto(dataset.geometry(), "dataset.geometry"));
    ISOSCOPE_ASSIGN_OR_RETURN(const ServedLevel* const level,
                              ChooseLevel(selected.dataset->levels, dataset, whole, spec_.rules,
                                          {.level = spec_.level}, /*pixels_per_unit=*/0));
    const volume::GridGeometry geometry = GridOfLevel(whole, spec_.level);
    ISOSCOPE_ASSIGN_OR_RETURN(const volume::BlockLayout layout, LayoutOf(dataset, geometry));
    const std::vector<ReplicaSet>& sets =
        level == nullptr ? selected.dataset->replica_sets : level->replica_sets;
    const auto parts_of_level = [&] { return state_.replicas.Choose(sets, dataset.dataset_id()); };

    ISOSCOPE_RETURN_IF_ERROR(
        work_.KeepMemory(state_.memory.ReserveExport(parts_of_level().size(), cancellation)));
    const mesh::WorldPlacement placement(geometry);
    const mesh::SurfaceGrid grid{.geometry = geometry,
                                 .layout = layout,
                                 .has_origin = spec_.with_origin && placement.has_origin()};
    if (grid.has_origin) {
      const base::MutexLock lock(&begun_mutex_);
      *begun_.mutable_origin() = wire::ToProto(placement.origin());
    }
    std::int64_t vertex_count = 0;
    for (std::size_t i = 0; i < spec_.rules.size(); ++i) {
      {
        const base::MutexLock lock(&begun_mutex_);
        begun_.set_surface_index(static_cast<std::int32_t>(i));
      }
      ISOSCOPE_ASSIGN_OR_RETURN(const ExportedSurface surface,
                                ExportOne(dataset, parts_of_level(), grid, i, vertex_count));
      vertex_count += surface.vertex_count;
      if (spec_.with_measures) {
        ISOSCOPE_RETURN_IF_ERROR(SendMeasures(surface));
      }
    }
    return absl::OkStatus();
  }

  // Sends one surface, but for its measures.
  absl::StatusOr<ExportedSurface> ExportOne(const v1::Dataset& dataset,
                                            std::vector<FramePart> parts,
                                            const mesh::SurfaceGrid& grid,
                                            std::size_t surface_index, std::int64_t first_vertex) {
    isoscope::internal::v1::ExtractSurfaceRequest request;
    request.set_dataset_id(dataset.dataset_id());
    request.set_level(spec_.level);
    const volume::InsideRule& rule = spec_.rules[surface_index];
    request.set_isovalue(rule.isovalue);
    request.mutable_labels()->Assign(rule.labels.begin(), rule.labels.end());
    request.set_smooth_labels(rule.smooths);
    if (request_.has_clip()) {
      *request.mutable_clip() = request_.clip();
    }
    request.set_closes(spec_.closes);
    request.set_without_blocks(spec_.without_mesh);
    std::vector<std::unique_ptr<SurfaceStream>> streams;
    std::vector<mesh::SurfaceSource*> sources;
    for (FramePart& part : parts) {
      streams.push_back(std::make_unique<SurfaceStream>(
          std::move(part), grid.layout, request, work_.cancellation().deadline(),
          options_.max_agent_silence, call_.request()));
      sources.push_back(streams.back().get());
    }
    absl::StatusOr<std::int64_t> vertex_count = [&] {
      const base::Cancellation::Callback stop(work_.cancellation(), [&streams] {
        for (const std::unique_ptr<SurfaceStream>& stream : streams) {
          stream->Cancel();
        }
      });
      return mesh::MergeSurface(grid, sources, first_vertex,
                                [&](mesh::SurfaceChunk chunk) { return Send(std::move(chunk)); });
    }();
    std::vector<AgentFailure> failures;
    std::vector<std::optional<solid::SurfaceSums>> sums;
    for (const std::unique_ptr<SurfaceStream>& stream : streams) {
      sums.push_back(stream->sums());
      failures.insert(failures.end(), stream->failures().begin(), stream->failures().end());
    }
    state_.ReportFailures(call_.request(), /*frame_number=*/0, failures);
    ISOSCOPE_RETURN_IF_ERROR(vertex_count.status());
    return ExportedSurface{.vertex_count = *vertex_count, .sums = solid::TotalOf(sums)};
  }

  absl::Status SendMeasures(const ExportedSurface& surface) {
    if (!surface.sums.has_value()) {
      return absl::InternalError("an agent sent no sums of its part of the surface");
    }
    v1::ExportIsosurfaceResponse message = BeginMessage();
    v1::SurfaceMeasures* const measures = message.mutable_measures();
    measures->set_area(surface.sums->area.Value());
    if (surface.sums->open_side_count == 0) {
      measures->set_volume(surface.sums->volume.Value());
    }
    measures->set_triangle_count(surface.sums->triangle_count);
    measures->set_open_edge_count(surface.sums->open_side_count);
    return Push(std::move(message));
  }

  absl::Status Send(mesh::SurfaceChunk chunk) {
    ISOSCOPE_RETURN_IF_ERROR(work_.cancellation().Check());
    sent_bytes_ += chunk.size_bytes();
    call_.caller().CountBytes(chunk.size_bytes());
    v1::ExportIsosurfaceResponse message = BeginMessage();
    message.set_positions(std::move(chunk.positions));
    message.set_normals(std::move(chunk.normals));
    message.set_triangles(std::move(chunk.triangles));
    return Push(std::move(message));
  }

  // Makes the common part of all messages of a surface. Alone it is a sign of life.
  v1::ExportIsosurfaceResponse BeginMessage() const ABSL_LOCKS_EXCLUDED(begun_mutex_) {
    const base::MutexLock lock(&begun_mutex_);
    return begun_;
  }

  absl::Status Push(v1::ExportIsosurfaceResponse message) {
    call_.unsent().Add(BytesOf(message));  // if it is never written, the call subtracts it
    if (outgoing_.Push(std::move(message))) {
      return absl::OkStatus();
    }
    ISOSCOPE_RETURN_IF_ERROR(work_.cancellation().Check());
    return absl::CancelledError("the stream has ended");
  }

  void StartWrite(const v1::ExportIsosurfaceResponse* message) {
    call_.timeout().Start(kMaxChunkDuration);
    in_flight_unsent_bytes_ = BytesOf(*message);
    pace_.OnWriteBegun(message->ByteSizeLong());
    ServerWriteReactor::StartWrite(message);
  }

  void End(const absl::Status& status) {
    work_.GiveBackShare();  // before the client receives the end, and may start another export
    Finish(call_.End(status));
  }

  // Ends the export after the chunk that is on its way, with a reason for the client.
  void EndEarly(CutReason reason, const absl::Status& status)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(end_mutex_) {
    if (!end_.ok()) {
      return;
    }
    end_ = status;
    call_.CountCut(reason);
    outgoing_.Finish(status);  // first: the errors of the stopped streams say less
    work_.Cancel();
  }

  void EndWithdrawn() ABSL_LOCKS_EXCLUDED(end_mutex_) {
    const base::MutexLock lock(&end_mutex_);
    EndEarly(CutReason::kTokenWithdrawn, WithdrawnError());
    call_.timeout().Start(kMaxLastWriteDuration);
  }

  void JudgePace() ABSL_LOCKS_EXCLUDED(end_mutex_) {
    const base::MutexLock lock(&end_mutex_);
    const ExportPace::Verdict verdict = pace_.Judge();
    if (verdict == ExportPace::Verdict::kGoesOn) {
      return;
    }
    const ExportLimits& limits = options_.export_limits;
    const std::string so_far =
        absl::StrCat("the export ended after ", sent_bytes_.load(), " bytes: ");
    if (verdict == ExportPace::Verdict::kTooSlow) {
      EndEarly(CutReason::kTooSlow,
               absl::DeadlineExceededError(absl::StrCat(
                   so_far, "its client took less than ", limits.least_bytes_per_second,
                   " bytes a second: read chunks as they come, or ask for a clip region")));
    } else {
      EndEarly(CutReason::kTooLong,
               absl::DeadlineExceededError(absl::StrCat(
                   so_far, "it took ", absl::FormatDuration(limits.max_duration),
                   ", the most that one may: ask for a clip region, or raise the coordinator's "
                   "--max-export-seconds")));
    }
  }

  const IsosurfaceServiceOptions& options_;
  CoordinatorState& state_;
  const v1::ExportIsosurfaceRequest request_;
  PublicCall call_;
  // Its memory is kept until the client has the last chunk: many slow clients hold as many queues.
  CallWork work_;
  Bell withdrawal_;
  std::optional<WithdrawalWatch> watch_;
  wire::ExportSpec spec_;  // set before Run
  mutable base::Mutex begun_mutex_;
  v1::ExportIsosurfaceResponse begun_ ABSL_GUARDED_BY(begun_mutex_);  // its surface, and its origin
  std::atomic<std::int64_t> in_flight_unsent_bytes_{0};
  PaceAlarm pace_;
  rpc::SignsOfLife signs_;
  rpc::WriteQueue<v1::ExportIsosurfaceResponse> outgoing_;
  std::atomic<std::size_t> sent_bytes_{0};
  base::Mutex end_mutex_;  // held while an alarm or a watch ends the export; locked after a bell
  absl::Status end_ ABSL_GUARDED_BY(end_mutex_);  // why it was ended early
  std::shared_ptr<ExportCall> self_;              // reset by OnDone
};

grpc::ServerWriteReactor<v1::ExportIsosurfaceResponse>* IsosurfaceServiceImpl::ExportIsosurface(
    grpc::CallbackServerContext* context, const v1::ExportIsosurfaceRequest* request) {
  const auto call = std::make_shared<ExportCall>(options_, &exports_, context, *request);
  call->Start();
  return call.get();
}

}  // namespace isoscope::server
