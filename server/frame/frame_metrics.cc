#include "server/frame/frame_metrics.h"

#include <algorithm>
#include <cstdint>

namespace isoscope::server {
namespace {

using base::MetricFamily;
using base::MetricSample;

absl::string_view NameOfCaller(absl::string_view caller) {
  return caller.empty() ? "(no token)" : caller;
}

}  // namespace

void FrameMetrics::CountEnd(const absl::Status& status, absl::Duration duration, bool is_moving,
                            absl::string_view caller) {
  if (absl::IsCancelled(status)) {
    cancelled.Add();
    callers_.Add(NameOfCaller(caller), kCancelled);
    return;
  }
  (status.ok() ? done : failed).Add();
  (is_moving ? moving_ : exact_).Observe(duration);
  callers_.Add(NameOfCaller(caller), status.ok() ? kDone : kFailed);
}

void FrameMetrics::CountRefused(absl::string_view caller) {
  callers_.Add(NameOfCaller(caller), kRefused);
}

void FrameMetrics::CountSteps(const FrameCost& cost) {
  occluder_selection_.Observe(cost.occluder_selection);
  occluder_rendering_.Observe(cost.occluder_rendering);
  visibility_culling_.Observe(cost.visibility_culling);
  composite_.Observe(cost.composite);
  encode_.Observe(cost.encode.value_or(absl::ZeroDuration()));
  network_bytes.Add(cost.network_bytes);
}

void FrameMetrics::AppendMetrics(std::vector<MetricFamily>* families) const {
  using Type = MetricFamily::Type;
  families->push_back({.name = "isoscope_frames_total",
                       .help = "Frames and picks that ended, by outcome.",
                       .type = Type::kCounter,
                       .samples = {MetricSample::Of(done, {{"outcome", "done"}}),
                                   MetricSample::Of(failed, {{"outcome", "failed"}}),
                                   MetricSample::Of(cancelled, {{"outcome", "cancelled"}}),
                                   MetricSample::Of(refused, {{"outcome", "refused"}})}});
  families->push_back(
      {.name = "isoscope_frame_duration_seconds",
       .help = "Time from the arrival of a frame or a pick to its end, waiting included.",
       .type = Type::kHistogram,
       .samples = {MetricSample::Of(exact_, {{"kind", "exact"}}),
                   MetricSample::Of(moving_, {{"kind", "moving"}})}});
  families->push_back(
      {.name = "isoscope_frame_step_duration_seconds",
       .help = "Time of each step of frames that ended well.",
       .type = Type::kHistogram,
       .samples = {MetricSample::Of(occluder_selection_, {{"step", "occluder_selection"}}),
                   MetricSample::Of(occluder_rendering_, {{"step", "occluder_rendering"}}),
                   MetricSample::Of(visibility_culling_, {{"step", "visibility_culling"}}),
                   MetricSample::Of(composite_, {{"step", "composite"}}),
                   MetricSample::Of(encode_, {{"step", "encode"}})}});
  families->push_back(
      {.name = "isoscope_admission_wait_seconds",
       .help = "Time that frames waited before they began: for a thread, and for memory.",
       .type = Type::kHistogram,
       .samples = {MetricSample::Of(queue_wait, {{"for", "thread"}}),
                   MetricSample::Of(memory_wait, {{"for", "memory"}})}});
  const std::int64_t full = std::max(refused.value() - displaced.value(), std::int64_t{0});
  families->push_back(
      {.name = "isoscope_admission_refused_frames_total",
       .help = "Frames and picks that were not drawn, by reason.",
       .type = Type::kCounter,
       .samples = {MetricSample::Of(static_cast<double>(full), {{"reason", "queue_full"}}),
                   MetricSample::Of(displaced, {{"reason", "made_room"}}),
                   MetricSample::Of(expired, {{"reason", "deadline"}}),
                   MetricSample::Of(rate_limited, {{"reason", "token_rate"}}),
                   MetricSample::Of(too_large, {{"reason", "memory_limit"}})}});
  families->push_back({.name = "isoscope_response_bytes_total",
                       .help = "Bytes of pictures and planes of frames that ended well.",
                       .type = Type::kCounter,
                       .samples = {MetricSample::Of(response_bytes)}});
  families->push_back(
      {.name = "isoscope_agent_network_bytes_total",
       .help = "Bytes of messages between coordinator and agents for frames, both ways.",
       .type = Type::kCounter,
       .samples = {MetricSample::Of(network_bytes)}});
  families->push_back({.name = "isoscope_partial_frames_total",
                       .help = "Frames without some shards, as their request allowed.",
                       .type = Type::kCounter,
                       .samples = {MetricSample::Of(partial)}});
  families->push_back({.name = "isoscope_caller_frames_total",
                       .help = "Frames and picks by caller, the name of its token, and outcome.",
                       .type = Type::kCounter,
                       .samples = callers_.Samples()});
}

}  // namespace isoscope::server
