// One call for a frame or a pick, apart from how its answer is sent: from the request to the
// response.
//
// 1. Admit, on gRPC's thread, converts the request. An error that no state of the cluster could
//    change is answered at once. Then the limits of the caller's token are asked: a caller above
//    them must not take a place that another could have. Then the frame is counted, refused if too
//    many are in work or wait or if it can never fit the memory limit, and queued.
// 2. On a frame thread it waits for its memory, then FrameRunner finds the dataset, which may wait
//    for a probe of the agents, and makes camera, view and layout.
// 3. RunFrame does the work with the agents (frame_coordinator). If the cache knows which blocks
//    are active, agents need not report them; otherwise their report goes into the cache.
// 4. Picture and planes are encoded, in the arena. The frame gives its place to another one before
//    the client gets the answer, so that the client's next request finds it free. Its memory but
//    that of the response is given back at once, the rest when gRPC is done with the response.
//
// A picture with several samples, or with effects that look around, is drawn in a larger window
// (core/frame/drawn_window) and finished by picture_finish. Planes are those of one sample, so a
// frame with samples and planes is drawn twice. Normals travel in place of colours: a frame with a
// picture and normals is drawn twice, too. The picture of a frame with lights or a color_by is
// computed from normals (core/picture/deferred_shading).
//
// A trace (with_trace) has the times of all this: the coordinator's own from a recorder that the
// call passes down, the agents' from their streams. Its zero is the call's begin.
//
// A pick is a frame of the smallest region that holds its pixels. The agents then tell which shards
// hold the blocks that the pixels show, and the gradients there.

#ifndef ISOSCOPE_SERVER_FRAME_FRAME_CALL_H_
#define ISOSCOPE_SERVER_FRAME_FRAME_CALL_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"
#include "core/base/memory_budget.h"
#include "core/base/trace_context.h"
#include "core/base/trace_recorder.h"
#include "core/frame/drawn_window.h"
#include "core/frame/frame_spec.h"
#include "core/image/frame_image.h"
#include "core/image/layer_stack.h"
#include "core/rpc/pick_convert.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "server/access/access_control.h"
#include "server/admission/admission.h"
#include "server/admission/coordinator_memory.h"
#include "server/admission/frame_board.h"
#include "server/cluster/frame_part.h"
#include "server/frame/frame_runner.h"
#include "server/picture/depth_grid.h"
#include "server/picture/frame_output.h"

namespace isoscope::server {

// Who asks for a frame.
struct FrameOrigin {
  base::TraceContext request;
  std::string client;            // as gRPC names the peer
  std::string certificate = {};  // name in the peer's certificate; empty without one
};

// The reactor of a call owns it, and the thread that renders shares it. Cancel is thread-safe, the
// other functions are for one thread at a time: Admit or AdmitPick, then Schedule, and on the frame
// thread Render or Pick.
class FrameCall {
 public:
  // The frame ends a tenth of the client's time, at most 200 ms, before `client_deadline`, so that
  // the client still hears which agent is late; and `max_duration` from now at the latest. The
  // runner outlives the call.
  FrameCall(FrameRunner* runner, FrameOrigin origin,
            const isoscope::v1::RenderIsosurfaceRequest& request, Delivery delivery,
            absl::Time client_deadline, absl::Duration max_duration);

  // Whose frame it is; without this, that of a caller who may do everything. A moving frame is one
  // of many, and leaves room for the exact one after it. Call before Admit.
  void SetCaller(Caller caller, bool is_moving) {
    caller_ = std::move(caller);
    is_moving_ = is_moving;
  }

  // Takes a place for the frame. A request that can't be right in any state of the cluster does not
  // wait. Errors as IsosurfaceService says.
  absl::Status Admit();
  // The same for a pick, whose frame then replaces the request.
  absl::Status AdmitPick(const isoscope::v1::PickSurfaceRequest& pick);

  // Lets Render also make the depth grid of the picture, with this many points on its longer side.
  // A region that is drawn with a margin has none.
  void AskDepthGrid(int longer_side) { depth_grid_side_ = longer_side; }
  [[nodiscard]] const std::optional<DepthGrid>& depth_grid() const { return depth_grid_; }
  // Calls `done` on the frame thread once the agents have drawn a picture, before it is encoded.
  void OnPictureDrawn(std::function<void()> done) { picture_drawn_ = std::move(done); }
  // Logs only failures: for frames of which there are dozens a second.
  void LogFailuresOnly() { logs_success_ = false; }

  // Runs `work` on a frame thread when the turn of the frame has come. A frame that may not wait so
  // long (admission.h) runs it at once on another thread: Render or Pick then give the reason.
  // `work` owns the call. REQUIRES: the call was admitted.
  void Schedule(std::function<void()> work);
  void Cancel();

  [[nodiscard]] absl::Time start() const { return start_; }
  [[nodiscard]] FrameRunner* runner() const { return runner_; }
  [[nodiscard]] const base::TraceContext& identity() const { return origin_.request; }
  // Who asked for what. The dataset's id is known once Render or Pick has found it.
  [[nodiscard]] AuditRecord audit_record() const;

  // Renders the frame into `response`. Blocks. Errors as IsosurfaceService says.
  absl::Status Render(isoscope::v1::RenderIsosurfaceResponse* response);
  absl::Status Pick(isoscope::v1::PickSurfaceResponse* response);

  // Gives back all memory but that of an answer of so many bytes, which is on its way. Call after
  // ReleaseImages.
  void KeepMemoryOfAnswer(std::size_t answer_bytes);
  // Hands over the memory of the frame, but for all above `bytes`, to what keeps the answer longer
  // than the call lives; none if none was reserved. Call after ReleaseImages.
  std::optional<base::MemoryBudget::Reservation> TakeMemory(std::size_t bytes);

  // Clears the images for their pool, once the client has its answer.
  void ReleaseImages() {
    image_ = image::FrameImage();
    drawn_ = image::FrameImage();
    layers_ = image::LayerStack();
  }

 private:
  absl::Status TakePlace();
  // Takes what the caller's token limits. Errors as Caller.
  absl::Status TakeShare();
  // Returns `status`, once it is counted if it refuses the frame.
  [[nodiscard]] absl::Status CountRefusal(absl::Status status) const;
  // Ends the wait for a thread.
  void BeginWork();
  // Counts a frame that ended, or that lost its place before its turn.
  void CountEnd(const absl::Status& status) const;
  // Gives the place away, counts the frame and logs it.
  void EndWork(std::int64_t frame_number, const absl::Status& status,
               const isoscope::v1::RenderStatistics& statistics);
  void CountSteps(const isoscope::v1::RenderStatistics& statistics) const;
  void AddTrace(std::int64_t frame_number, base::TraceTime begin,
                isoscope::v1::RenderIsosurfaceResponse* response);
  [[nodiscard]] FrameIdentity IdentityOf(std::int64_t frame_number);
  absl::Status Reserve();
  absl::Status TryRender(std::int64_t frame_number,
                         isoscope::v1::RenderIsosurfaceResponse* response);
  absl::Status TryPick(std::int64_t frame_number, isoscope::v1::PickSurfaceResponse* response);
  void AddPoint(const rpc::PixelPosition& pixel, const FrameTarget& target,
                isoscope::v1::PickSurfaceResponse* response);
  absl::Status RenderOutput(std::int64_t frame_number, const FrameTarget& target,
                            FrameOutput* output, isoscope::v1::RenderStatistics* statistics);
  // Says which shards the frame lacks, if it does.
  absl::Status AddMissingShards(const FrameTarget& target,
                                isoscope::v1::RenderStatistics* statistics);
  absl::Status RenderPicture(std::int64_t frame_number, const FrameTarget& target,
                             FrameOutput* output, isoscope::v1::RenderStatistics* statistics);
  absl::Status RenderPlanes(std::int64_t frame_number, const FrameTarget& target,
                            FrameOutput* output, isoscope::v1::RenderStatistics* statistics);
  // What pixels are drawn for. Pictures have colours, or normals to shade; planes have normals if
  // they are asked for.
  enum class Content { kPicture, kPlanes };
  absl::StatusOr<FrameResult> Draw(std::int64_t frame_number, const FrameTarget& target,
                                   const frame::DrawnWindow& window, Content content);
  // Adds the shards and gradients of all points that were hit.
  absl::Status AskAgentsOfPoints(const FrameTarget& target,
                                 isoscope::v1::PickSurfaceResponse* response);
  void MoveInto(FrameOutput output, isoscope::v1::RenderIsosurfaceResponse* response) const;
  void Log(std::int64_t frame_number, const absl::Status& status,
           const isoscope::v1::RenderStatistics& statistics) const;

  FrameRunner* const runner_;
  const FrameOrigin origin_;
  isoscope::v1::RenderIsosurfaceRequest request_;  // FindTarget resolves its camera
  const Delivery delivery_;
  Caller caller_;
  bool is_moving_ = false;
  const absl::Time start_;
  base::Cancellation cancellation_;
  frame::FrameSpec spec_;
  std::vector<rpc::PixelPosition> pixels_;  // of a pick
  int depth_grid_side_ = 0;                 // 0: no grid
  std::optional<DepthGrid> depth_grid_;
  bool logs_success_ = true;
  std::function<void()> picture_drawn_;
  std::optional<CallerSlot> slot_;  // of the caller's frames
  std::optional<Admission::Place> place_;
  Admission::Ticket ticket_ = 0;  // of the place; 0: none
  absl::Status turn_;             // why the turn did not come
  std::optional<FrameBoard::Entry> on_board_;
  std::unique_ptr<base::TraceRecorder> trace_;  // null: none is asked for
  base::TraceTime trace_zero_;
  std::vector<isoscope::v1::ProcessTrace> agent_traces_;
  std::string dataset_name_;
  std::string dataset_id_;
  std::vector<FramePart> parts_;  // of the target, without those that were lost on the way
  image::FrameImage image_;
  image::FrameImage drawn_;   // if the picture is another one
  image::LayerStack layers_;  // of what was drawn
  // Given back when gRPC is done with the response.
  std::optional<base::MemoryBudget::Reservation> memory_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_FRAME_CALL_H_
