// 1. One whole frame warms the page cache. Then a new cluster renders a cold frame, and a few more;
//    their median is the time of a following one. A frame is cancelled at a random share of its
//    kind's time.
// 2. The cluster is restarted before every frames_per_start-th frame, which is therefore cold.
// 3. A thread requests a frame. This thread sleeps until the moment and cancels. Then it checks the
//    agents every 50 us until none has a frame in work, and for 5 ms more: the frame may still be
//    on its way to one of them. The requesting thread takes the time of the answer.
//
// A frame that was complete before its moment does not count; another replaces it, up to ten
// attempts for each cancelled frame.
//
// Example: cold frames take 200 ms, following ones 40 ms. A following frame with the random number
// 0.25 is cancelled 10 ms after its request. The seed determines the moments; the machine
// determines which frames were complete.

#include "bench/cancel_bench.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <thread>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include <nlohmann/json.hpp>

#include "bench/sample_statistics.h"
#include "clients/cpp/connection/service_client.h"
#include "clients/cpp/request/json_text.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/cli/interrupt.h"
#include "core/cli/progress_line.h"
#include "core/cli/table.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::bench {
namespace {

using Json = nlohmann::ordered_json;

constexpr absl::Duration kPollInterval = absl::Microseconds(50);
// A cancelled frame may still be on its way from the coordinator to an agent. So agents count as
// idle when none has had a frame for this long.
constexpr absl::Duration kQuiet = absl::Milliseconds(5);
constexpr absl::Duration kMaxCancelWait = absl::Minutes(1);
constexpr int kFollowingFrameCount = 3;  // the time of a following frame is their median
// Frames that are complete before their moment don't count. At most this many are requested for
// each frame to cancel.
constexpr int kMaxAttemptsPerCancel = 10;

class CancelBench {
 public:
  CancelBench(const CancelBenchPlan& plan, const cli::Context& context)
      : plan_(plan), context_(context), random_(plan.seed) {}

  absl::StatusOr<CancelBenchResult> Run() {
    ISOSCOPE_RETURN_IF_ERROR(MeasureWholeFrames());
    cli::ProgressLine line(context_.err, context_.err_is_terminal);
    const int max_attempts = plan_.cancel_count * kMaxAttemptsPerCancel;
    for (int i = 0; static_cast<int>(result_.frames.size()) < plan_.cancel_count; ++i) {
      if (i == max_attempts) {
        return absl::FailedPreconditionError(absl::StrCat(
            "of ", i, " frames only ", result_.frames.size(),
            " were not complete before they were to be cancelled; take a larger volume"));
      }
      ISOSCOPE_RETURN_IF_ERROR(context_.interrupt->cancellation().Check());
      const bool is_cold = i % plan_.frames_per_start == 0;
      if (is_cold) {
        ISOSCOPE_RETURN_IF_ERROR(StartCluster());
      }
      line.Update(absl::StrFormat("cancelled %d of %d", result_.frames.size(), plan_.cancel_count));
      ISOSCOPE_RETURN_IF_ERROR(CancelOne(is_cold));
    }
    return std::move(result_);
  }

 private:
  absl::Status StartCluster() {
    cluster_.reset();
    ISOSCOPE_ASSIGN_OR_RETURN(cluster_, cli::EmbeddedCluster::Start(plan_.cluster));
    client::ServiceClient client(cluster_->Channel(), "", context_.interrupt, "");
    ISOSCOPE_ASSIGN_OR_RETURN(scene_, FindScene(plan_.request, /*dataset=*/"", &client));
    return absl::OkStatus();
  }

  isoscope::v1::RenderIsosurfaceRequest NextRequest() {
    return scene_.Frame(plan_.orbit_degrees, next_frame_++);
  }

  absl::StatusOr<double> RenderWholeFrame() {
    client::ServiceClient client(cluster_->Channel(), "", context_.interrupt, "");
    const base::MonotonicTime start = base::MonotonicNow();
    ISOSCOPE_RETURN_IF_ERROR(
        client.RenderIsosurface(NextRequest(), absl::InfiniteDuration()).status());
    return absl::ToDoubleMilliseconds(base::MonotonicNow() - start);
  }

  absl::Status MeasureWholeFrames() {
    ISOSCOPE_RETURN_IF_ERROR(StartCluster());
    // Not counted: it brings the files into the page cache.
    ISOSCOPE_RETURN_IF_ERROR(RenderWholeFrame().status());
    ISOSCOPE_RETURN_IF_ERROR(StartCluster());
    result_.drawers = {cluster_->shard_count(), cluster_->renderer_description()};
    ISOSCOPE_ASSIGN_OR_RETURN(result_.cold_ms, RenderWholeFrame());
    std::vector<double> following_ms;
    for (int i = 0; i < kFollowingFrameCount; ++i) {
      ISOSCOPE_ASSIGN_OR_RETURN(const double frame_ms, RenderWholeFrame());
      following_ms.push_back(frame_ms);
    }
    result_.following_ms = Median(std::move(following_ms));
    return absl::OkStatus();
  }

  // Returns a number in [0, 1), the same for the same seed everywhere.
  double RandomShare() {
    constexpr int kMantissaBits = 53;
    return std::ldexp(static_cast<double>(random_() >> (64 - kMantissaBits)), -kMantissaBits);
  }

  // Requests a frame, cancels it and waits until the agents are idle.
  absl::Status CancelOne(bool is_cold) {
    CancelledFrame frame{.is_cold = is_cold};
    const double expected_ms = is_cold ? result_.cold_ms : result_.following_ms;
    cli::Interrupt cancel;
    client::ServiceClient client(cluster_->Channel(), "", &cancel, "");
    const isoscope::v1::RenderIsosurfaceRequest request = NextRequest();
    absl::Status status;
    base::MonotonicTime answered_at;
    const base::MonotonicTime start = base::MonotonicNow();
    std::thread caller([&] {
      status = client.RenderIsosurface(request, absl::InfiniteDuration()).status();
      answered_at = base::MonotonicNow();
    });
    absl::SleepFor(absl::Milliseconds(RandomShare() * expected_ms));
    const base::MonotonicTime cancelled_at = base::MonotonicNow();
    cancel.Trigger();
    const absl::StatusOr<base::MonotonicTime> idle_at = WaitUntilIdle(cancelled_at);
    caller.join();
    ISOSCOPE_RETURN_IF_ERROR(idle_at.status());
    if (status.ok()) {
      ++result_.complete_count;
      return absl::OkStatus();
    }
    if (!absl::IsCancelled(status)) {
      return status;
    }
    frame.moment_ms = absl::ToDoubleMilliseconds(cancelled_at - start);
    frame.answer_ms = absl::ToDoubleMilliseconds(answered_at - cancelled_at);
    frame.idle_ms = absl::ToDoubleMilliseconds(*idle_at - cancelled_at);
    result_.frames.push_back(frame);
    return absl::OkStatus();
  }

  // Returns when the agents became idle for good; `since` if they were idle all the time.
  [[nodiscard]] absl::StatusOr<base::MonotonicTime> WaitUntilIdle(base::MonotonicTime since) const {
    base::MonotonicTime idle_at = since;
    bool was_busy = false;
    for (base::MonotonicTime now = base::MonotonicNow(); now - idle_at < kQuiet || was_busy;
         now = base::MonotonicNow()) {
      const bool is_busy = cluster_->frames_in_work() > 0;
      if (was_busy && !is_busy) {
        idle_at = now;
      }
      was_busy = is_busy;
      if (is_busy && now - since > kMaxCancelWait) {
        return absl::DeadlineExceededError(
            absl::StrCat("agents still had ", cluster_->frames_in_work(), " frames in work ",
                         absl::FormatDuration(kMaxCancelWait), " after the frame was cancelled"));
      }
      absl::SleepFor(kPollInterval);
    }
    return idle_at;
  }

  const CancelBenchPlan& plan_;
  const cli::Context& context_;
  std::mt19937_64 random_;
  std::unique_ptr<cli::EmbeddedCluster> cluster_;
  Scene scene_;
  int next_frame_ = 0;
  CancelBenchResult result_;
};

// Returns one figure of the frames that `is_wanted` accepts.
std::vector<double> Select(const std::vector<CancelledFrame>& frames,
                           double CancelledFrame::*figure,
                           const std::function<bool(const CancelledFrame&)>& is_wanted) {
  std::vector<double> values;
  for (const CancelledFrame& frame : frames) {
    if (is_wanted(frame)) {
      values.push_back(frame.*figure);
    }
  }
  return values;
}

std::string TwoDecimals(double milliseconds) { return absl::StrFormat("%.2f", milliseconds); }

}  // namespace

absl::StatusOr<CancelBenchResult> RunCancelBench(const CancelBenchPlan& plan,
                                                 const cli::Context& context) {
  return CancelBench(plan, context).Run();
}

std::string DescribeCancelBench(const CancelBenchResult& result) {
  cli::Table table(
      {"frames", "cancels", "idle ms, median", "p99", "max", "answer ms, median", "p99", "max"});
  const std::pair<const char*, std::function<bool(const CancelledFrame&)>> rows[] = {
      {"cold", [](const CancelledFrame& frame) { return frame.is_cold; }},
      {"following", [](const CancelledFrame& frame) { return !frame.is_cold; }},
      {"all", [](const CancelledFrame&) { return true; }}};
  for (const auto& [name, is_wanted] : rows) {
    std::vector<std::string> cells{name};
    for (double CancelledFrame::*const figure :
         {&CancelledFrame::idle_ms, &CancelledFrame::answer_ms}) {
      const std::vector<double> values = Select(result.frames, figure, is_wanted);
      if (cells.size() == 1) {
        cells.push_back(absl::StrCat(values.size()));
      }
      for (const double value : {Median(values), Percentile(values, 0.99), Percentile(values, 1)}) {
        cells.push_back(values.empty() ? "-" : TwoDecimals(value));
      }
    }
    table.AddRow(std::move(cells));
  }
  return table.ToString();
}

std::string CancelBenchJson(const Occasion& occasion, const CancelBenchPlan& plan,
                            const CancelBenchResult& result) {
  const std::vector<double> idle_ms =
      Select(result.frames, &CancelledFrame::idle_ms, [](const CancelledFrame&) { return true; });
  Json json = JsonHead(occasion);
  json["volume"] = occasion.volume;
  json["isovalue"] = plan.request.isovalue.value_or(0);
  AddFrame(plan.request, result.drawers, &json);
  json["seed"] = plan.seed;
  json["cold_ms"] = Rounded(result.cold_ms);
  json["following_ms"] = Rounded(result.following_ms);
  json["complete_count"] = result.complete_count;
  json["idle_ms"] = {{"median", Rounded(Median(idle_ms))},
                     {"p99", Rounded(Percentile(idle_ms, 0.99))},
                     {"max", Rounded(Percentile(idle_ms, 1))}};
  json["frames"] = Json::array();
  for (const CancelledFrame& frame : result.frames) {
    json["frames"].push_back({{"cold", frame.is_cold},
                              {"moment_ms", Rounded(frame.moment_ms)},
                              {"answer_ms", Rounded(frame.answer_ms)},
                              {"idle_ms", Rounded(frame.idle_ms)}});
  }
  return client::JsonText(json);
}

}  // namespace isoscope::bench
