#include "web-gateway/gateway_metrics.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"

namespace isoscope::gateway {
namespace {

using base::MetricFamily;
using base::MetricLabels;
using base::MetricSample;

MetricSample Value(double value, MetricLabels labels = {}) {
  return MetricSample::Of(value, std::move(labels));
}

MetricFamily Of(MetricFamily::Type type, const char* name, const char* help,
                std::vector<MetricSample> samples) {
  return {.name = name, .help = help, .type = type, .samples = std::move(samples)};
}

}  // namespace

void GatewayMetrics::CountRequest(int status, absl::Duration duration) {
  const int index = std::clamp(status - kLeastStatus, 0, static_cast<int>(kStatusCount) - 1);
  by_status_[static_cast<std::size_t>(index)].Add();
  duration_.Observe(duration);
}

std::vector<MetricFamily> GatewayMetrics::Collect(const GatewayGauges& gauges) const {
  using Type = MetricFamily::Type;
  std::vector<MetricFamily> families =
      base::ProcessMetrics("isoscope-gateway", /*memory_limit_bytes=*/0);
  std::vector<MetricSample> requests;
  for (std::size_t i = 0; i < kStatusCount; ++i) {
    const std::int64_t count = by_status_[i].value();
    const int status = kLeastStatus + static_cast<int>(i);
    // A series that begins with its first event would hide that event from `rate`.
    if (count > 0 || status == 200 || status == 429 || status == 503) {
      requests.push_back(Value(static_cast<double>(count), {{"status", absl::StrCat(status)}}));
    }
  }
  families.push_back(Of(Type::kCounter, "isoscope_http_requests_total",
                        "Requests that were answered, by status of HTTP.", std::move(requests)));
  families.push_back(Of(Type::kHistogram, "isoscope_http_request_duration_seconds",
                        "Time from a request to the beginning of its answer.",
                        {MetricSample::Of(duration_)}));
  families.push_back(Of(Type::kGauge, "isoscope_http_connections",
                        "Open connections, WebSockets included.", {Value(gauges.connections)}));
  families.push_back(Of(Type::kGauge, "isoscope_http_limit_connections",
                        "Most connections (--max-connections).", {Value(gauges.max_connections)}));
  families.push_back(Of(Type::kCounter, "isoscope_http_refused_connections_total",
                        "Connections and requests that were refused because too many were at work.",
                        {Value(static_cast<double>(refused.value()))}));
  families.push_back(Of(Type::kCounter, "isoscope_http_dropped_connections_total",
                        "Connections without a request that were dropped, to make room for others.",
                        {Value(static_cast<double>(gauges.dropped_connections))}));
  families.push_back(Of(Type::kGauge, "isoscope_pictures_in_work",
                        "Pictures, picks, meshes and films in work.", {Value(gauges.pictures)}));
  families.push_back(Of(Type::kGauge, "isoscope_limit_pictures",
                        "Most pictures, picks, meshes and films in work (--max-pictures).",
                        {Value(gauges.max_pictures)}));
  families.push_back(Of(Type::kGauge, "isoscope_certificate_days_left",
                        "Days until the own certificate expires; 0 if it can't be read, infinity "
                        "without one.",
                        {Value(gauges.certificate_days_left)}));
  families.push_back(
      Of(Type::kCounter, "isoscope_reload_failures_total",
         "Files that were wrong, or could not be read, after a change; what was read before holds.",
         {Value(static_cast<double>(gauges.certificate_failures), {{"file", "certificate"}})}));
  families.push_back(
      Of(Type::kGauge, "isoscope_viewers", "Views that move: open WebSockets.", {Value(viewers)}));
  families.push_back(
      Of(Type::kCounter, "isoscope_viewer_frames_total",
         "Frames for viewers; a replaced one was never sent, because the viewer was "
         "slow and a newer one came.",
         {Value(static_cast<double>(sent_frames.value()), {{"outcome", "sent"}}),
          Value(static_cast<double>(replaced_frames.value()), {{"outcome", "replaced"}})}));
  return families;
}

}  // namespace isoscope::gateway
