// The ticket of a frame: the stages of its work (server/call/call_work.h), with its log lines and
// counts, apart from its drawing.
//
// 1. TakePlace, on gRPC's thread, takes share and place. It refuses a frame that can never fit the
//    memory limit, or a message.
// 2. Schedule queues it for its turn. Run is the work on a frame thread. TakeMemory waits for the
//    memory of the frame.
// 3. At the end of Run the frame is counted and logged. It returns its place before the client gets
//    the answer, so that the client's next request finds it free. All memory but that of the
//    response is returned next, the rest when gRPC is done with the response.

#ifndef ISOSCOPE_SERVER_FRAME_FRAME_TICKET_H_
#define ISOSCOPE_SERVER_FRAME_FRAME_TICKET_H_

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"
#include "core/base/memory_budget.h"
#include "core/base/monotonic_time.h"
#include "core/base/printable.h"
#include "core/base/trace_context.h"
#include "core/base/trace_recorder.h"
#include "core/frame/frame_spec.h"
#include "server/access/access_control.h"
#include "server/admission/coordinator_memory.h"
#include "server/admission/frame_board.h"
#include "server/call/call_work.h"
#include "server/call/public_call.h"
#include "server/frame/coordinator_state.h"
#include "server/frame/render_statistics.h"

namespace isoscope::server {

// A frame apart from its content: caller, deadline and observers. All objects that it points to
// outlive the frame.
struct FrameIdentity {
  std::int64_t number = 0;
  const base::TraceContext* request = nullptr;
  const Caller* caller = nullptr;
  const base::Cancellation* cancellation = nullptr;
  std::atomic<FramePhase>* phase = nullptr;  // null: no observer
  base::TraceRecorder* trace = nullptr;      // null: no trace was asked for
  base::TraceTime trace_zero = {};           // of the axis
  // Gets the traces of the agents, in their order, if `trace` is set.
  std::vector<isoscope::v1::ProcessTrace>* agent_traces = nullptr;
};

// A call's request for a place: all but the pixels.
struct FrameClaim {
  const char* noun = "frame";      // in logs and messages: "frame" or "pick"
  base::ForeignText dataset = {};  // as the request names it
  bool has_trace = false;
  // True for a frame of an interactive stream in motion. It leaves room for the exact one after it,
  // and is logged only if it fails.
  bool is_moving = false;
  // True for a part of a frame that has taken its share of the caller's rate before.
  bool is_part = false;
  Delivery delivery = Delivery::kWhole;
  base::MonotonicTime client_deadline = base::MonotonicTime::InfiniteFuture();
  absl::Duration max_duration = absl::InfiniteDuration();
};

// Cancel is thread-safe. The other functions are for one thread at a time: TakePlace, then
// Schedule, and on the frame thread Run.
class FrameTicket {
 public:
  // The frame ends a tenth of the client's time, at most 200 ms, before `client_deadline`, so that
  // the client still receives the name of a late agent. It ends `max_duration` from now at the
  // latest. The state outlives the ticket.
  FrameTicket(CoordinatorState* state, const CallOrigin& origin, const FrameClaim& claim);

  // Takes a place for the frame; does not block. PERMISSION_DENIED and RESOURCE_EXHAUSTED as
  // IsosurfaceService says, INVALID_ARGUMENT if the answer can't fit one message.
  //
  // may_band: whether the frame may be drawn in bands
  absl::Status TakePlace(const frame::FrameSpec& spec, bool may_band = false);

  // Calls `work` on a frame thread when the turn of the frame has come. If the frame loses its
  // place before (admission.h), calls `work` at once on another thread: Run then returns the
  // reason. `work` owns the ticket. REQUIRES: the frame has a place.
  void Schedule(std::function<void()> work);
  void Cancel() { work_.Cancel(); }

  // Runs `work`, which sets `cost`, if the turn has come, and ends the frame. Returns the status of
  // `work`, the reason why the turn was lost, or RESOURCE_EXHAUSTED if memory runs out.
  absl::Status Run(const frame::FrameSpec& spec, const FrameCost& cost,
                   absl::FunctionRef<absl::Status()> work);
  // Call in Run: takes the memory of the frame. Blocks. Errors as CoordinatorMemory.
  absl::Status TakeMemory(const frame::FrameSpec& spec);
  // Returns the bands of the frame. Errors as CoordinatorMemory::PlanFrame.
  [[nodiscard]] absl::StatusOr<BandGrid> PlanFrame(const frame::FrameSpec& spec,
                                                   const FrameNeeds& needs) const {
    return state_.memory.PlanFrame(spec, wish(), needs);
  }
  // Returns the bands of another drawing of the frame, as CoordinatorMemory::PlanDrawing.
  [[nodiscard]] absl::StatusOr<BandGrid> PlanDrawing(const frame::FrameSpec& drawing,
                                                     const frame::FrameSpec& spec,
                                                     const FrameNeeds& needs) const {
    return state_.memory.PlanDrawing(drawing, spec, wish(), needs);
  }
  // Call in Run: the frame as agents and observers know it. Points into the ticket.
  [[nodiscard]] FrameIdentity Identity() const;
  // Call in Run: the frame is not drawn now, but in parts that have tickets of their own. If it ends
  // well, it is neither counted nor logged.
  void PutOff() { is_put_off_ = true; }
  // The dataset that was found; before that, the one that was asked for.
  void NoteDataset(const isoscope::v1::Dataset& dataset);
  [[nodiscard]] const CallDataset& dataset() const { return dataset_; }

  // Checks the bytes of picture and planes against the limit of one message.
  [[nodiscard]] absl::Status CheckAnswerBytes(std::size_t bytes) const;
  // Counts bytes of picture and planes that are sent.
  void CountAnswer(std::size_t bytes) const;

  // Returns all memory above that of an answer of `answer_bytes`, which is being sent. Call when
  // the images are gone.
  void KeepMemoryOfAnswer(std::size_t answer_bytes);
  // Transfers the memory of the frame, at most `bytes` of it, to the owner of an answer that
  // outlives the call; none if none was reserved. Call when the images are gone.
  std::optional<base::MemoryBudget::Reservation> ReleaseMemory(std::size_t bytes) {
    return work_.ReleaseMemory(bytes);
  }

  [[nodiscard]] const base::TraceContext& request() const { return origin_.request; }
  [[nodiscard]] const base::Cancellation& cancellation() const { return work_.cancellation(); }

 private:
  absl::Status TakePlaceUncounted(const frame::FrameSpec& spec);
  void BeginWork();
  // Logs and counts the frame, and returns its place.
  void EndWork(const frame::FrameSpec& spec, const absl::Status& status, const FrameCost& cost);
  // Counts a frame that ended, or that lost its place before its turn.
  void CountEnd(const absl::Status& status) const;
  void Log(const frame::FrameSpec& spec, const absl::Status& status, const FrameCost& cost) const;

  [[nodiscard]] FrameWish wish() const {
    return {.delivery = claim_.delivery, .has_trace = claim_.has_trace, .may_band = may_band_};
  }

  CoordinatorState& state_;
  const CallOrigin origin_;
  const FrameClaim claim_;
  const base::MonotonicTime start_ = base::MonotonicNow();
  bool may_band_ = false;
  CallWork work_;  // its memory is returned when gRPC is done with the response
  bool is_put_off_ = false;
  absl::Status lost_turn_;  // why the turn did not come
  std::optional<FrameBoard::Entry> on_board_;
  std::int64_t frame_number_ = 0;  // number of the frame; 0: its work has not begun
  CallDataset dataset_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_FRAME_TICKET_H_
