// 1. Two threads share a stream. This one sends states at their rate, and rotates the camera each
//    time.
// 2. The reader acknowledges each frame after the pretended decoding. It looks up when the state
//    that the frame answers was sent: that is the frame's latency.
// 3. After the last state this thread waits for its exact frame, and compares it with
//    RenderIsosurface.
//
// Frames of the first second do not count: meshes are extracted, and the server adapts its sizes.

#include "bench/drag_bench.h"

#include <map>
#include <memory>
#include <optional>
#include <thread>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include <nlohmann/json.hpp>

#include "bench/sample_statistics.h"
#include "clients/cpp/connection/service_client.h"
#include "clients/cpp/request/json_text.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/cli/interrupt.h"
#include "isoscope/v1/interact_service.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "wire/proto_convert.h"

namespace isoscope::bench {
namespace {

namespace v1 = isoscope::v1;

constexpr absl::Duration kWarmUp = absl::Seconds(1);
constexpr absl::Duration kMaxDragWait = absl::Minutes(1);

class DragBench {
 public:
  DragBench(const DragBenchPlan& plan, const cli::Context& context)
      : plan_(plan), context_(context) {}

  absl::StatusOr<DragBenchResult> Run() {
    ISOSCOPE_ASSIGN_OR_RETURN(stage_, OpenStage(plan_.session, plan_.request, context_));
    result_.drawers = stage_.drawers;
    client::ServiceClient& client = stage_.session->client();
    ISOSCOPE_RETURN_IF_ERROR(client.RenderIsosurface(FrameOf(0), kMaxDragWait).status());
    stream_ = client.Interact();
    std::thread reader([this] { Read(); });
    const absl::Status dragged = Drag();
    if (!dragged.ok()) {
      stream_->Cancel();
    }
    stream_->CloseWrites();
    reader.join();
    const absl::Status status = stream_->Finish();
    ISOSCOPE_RETURN_IF_ERROR(dragged);
    ISOSCOPE_RETURN_IF_ERROR(status);
    return Compare(&client);
  }

 private:
  v1::RenderIsosurfaceRequest FrameOf(std::int64_t state) const {
    return stage_.scene.Frame(plan_.degrees_per_second / plan_.states_per_second,
                              static_cast<int>(state));
  }

  absl::Status Drag() ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MonotonicTime start = base::MonotonicNow();
    const base::MonotonicTime end = start + kWarmUp + plan_.duration;
    const absl::Duration step = absl::Seconds(1 / plan_.states_per_second);
    std::int64_t state = 0;
    for (base::MonotonicTime next = start; next < end; next += step) {
      absl::SleepFor(next - base::MonotonicNow());
      ISOSCOPE_RETURN_IF_ERROR(context_.interrupt->cancellation().Check());
      ISOSCOPE_RETURN_IF_ERROR(SendState(++state));
      if (base::MonotonicNow() - start >= kWarmUp) {
        StartCounting();
      }
    }
    {
      const base::MutexLock lock(&mutex_);
      is_counting_ = false;
      result_.drag_seconds = absl::ToDoubleSeconds(base::MonotonicNow() - counting_since_);
      last_state_ = state;
      last_sent_ = sent_[state];
    }
    const base::MutexLock lock(&mutex_);
    const bool came = exact_came_.AwaitUntil(
        &mutex_, base::MonotonicNow() + kMaxDragWait,
        [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return exact_.has_value() || is_over_; });
    return came && exact_.has_value()
               ? absl::OkStatus()
               : absl::DeadlineExceededError("the exact frame did not come within a minute");
  }

  void StartCounting() ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    if (!is_counting_) {
      is_counting_ = true;
      counting_since_ = base::MonotonicNow();
    }
  }

  absl::Status SendState(std::int64_t state) ABSL_LOCKS_EXCLUDED(mutex_) {
    v1::InteractRequest request;
    v1::ViewState& view = *request.mutable_view_state();
    view.set_sequence_number(state);
    *view.mutable_frame() = FrameOf(state);
    view.set_target_frames_per_second(plan_.target_frames_per_second);
    {
      const base::MutexLock lock(&mutex_);
      sent_[state] = base::MonotonicNow();
    }
    return stream_->Write(request) ? absl::OkStatus()
                                   : absl::UnavailableError("the stream has ended");
  }

  void Read() ABSL_LOCKS_EXCLUDED(mutex_) {
    v1::InteractResponse response;
    while (stream_->Read(&response)) {
      absl::SleepFor(plan_.decode);
      v1::InteractRequest shown;
      shown.mutable_frame_shown()->set_frame_number(response.frame_number());
      *shown.mutable_frame_shown()->mutable_decode_duration() = wire::ToProto(plan_.decode);
      stream_->Write(shown);  // if the stream has ended, the next read says so
      Note(response);
    }
    const base::MutexLock lock(&mutex_);
    is_over_ = true;
    exact_came_.SignalAll();
  }

  void Note(const v1::InteractResponse& response) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    const base::MonotonicTime now = base::MonotonicNow();
    if (response.is_exact() && response.sequence_number() == last_state_) {
      exact_ = response.frame();
      result_.exact_ms = absl::ToDoubleMilliseconds(now - last_sent_);
      exact_came_.SignalAll();
    } else if (response.has_frame() && !response.is_exact() && is_counting_) {
      ++result_.frame_count;
      result_.latencies_ms.push_back(
          absl::ToDoubleMilliseconds(now - sent_[response.sequence_number()]));
      result_.heights_px.push_back(response.frame().extent().height_px());
      result_.frame_bytes.push_back(static_cast<double>(response.frame().jpeg().size() +
                                                        response.depth_grid().depths().size()));
    }
  }

  absl::StatusOr<DragBenchResult> Compare(client::ServiceClient* client)
      ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    ISOSCOPE_ASSIGN_OR_RETURN(const v1::RenderIsosurfaceResponse rendered,
                              client->RenderIsosurface(FrameOf(last_state_), kMaxDragWait));
    result_.exact_is_that_of_render = exact_->png() == rendered.png();
    return std::move(result_);
  }

  const DragBenchPlan& plan_;
  const cli::Context& context_;
  Stage stage_;
  std::unique_ptr<client::InteractStream> stream_;

  base::Mutex mutex_;
  base::CondVar exact_came_;
  std::map<std::int64_t, base::MonotonicTime> sent_ ABSL_GUARDED_BY(mutex_);
  bool is_counting_ ABSL_GUARDED_BY(mutex_) = false;
  base::MonotonicTime counting_since_ ABSL_GUARDED_BY(mutex_);
  std::int64_t last_state_ ABSL_GUARDED_BY(mutex_) = 0;  // 0: still dragging
  base::MonotonicTime last_sent_ ABSL_GUARDED_BY(mutex_);
  std::optional<v1::RenderIsosurfaceResponse> exact_ ABSL_GUARDED_BY(mutex_);
  bool is_over_ ABSL_GUARDED_BY(mutex_) = false;
  DragBenchResult result_;  // the reader's while it runs, but for drag_seconds
};

double FramesPerSecond(const DragBenchResult& result) {
  return result.drag_seconds > 0 ? static_cast<double>(result.frame_count) / result.drag_seconds
                                 : 0;
}

}  // namespace

absl::StatusOr<DragBenchResult> RunDragBench(const DragBenchPlan& plan,
                                             const cli::Context& context) {
  return DragBench(plan, context).Run();
}

std::string DescribeDragBench(const DragBenchResult& result) {
  return absl::StrFormat(
      "%.1f frames a second (%d in %.1f s)\n"
      "state to frame: %.0f ms median, %.0f ms p95\n"
      "%.0f pixels high and %.0f KiB, median\n"
      "exact %.0f ms after the last state, %s\n",
      FramesPerSecond(result), result.frame_count, result.drag_seconds, Median(result.latencies_ms),
      Percentile(result.latencies_ms, 0.95), Median(result.heights_px),
      Median(result.frame_bytes) / 1024, result.exact_ms,
      result.exact_is_that_of_render ? "the bytes of RenderIsosurface"
                                     : "NOT the bytes of RenderIsosurface");
}

std::string DragBenchJson(const Occasion& occasion, const DragBenchPlan& plan,
                          const DragBenchResult& result) {
  nlohmann::ordered_json json = JsonHead(occasion);
  json["volume"] = occasion.volume;
  json["isovalue"] = plan.request.isovalue.value_or(0);
  AddFrame(plan.request, result.drawers, &json);
  json["frames_per_second"] = FramesPerSecond(result);
  json["latency_ms"] = {{"median", Median(result.latencies_ms)},
                        {"p95", Percentile(result.latencies_ms, 0.95)}};
  json["median_height_px"] = Median(result.heights_px);
  json["median_frame_bytes"] = Median(result.frame_bytes);
  json["exact_ms"] = result.exact_ms;
  return client::JsonText(json);
}

}  // namespace isoscope::bench
