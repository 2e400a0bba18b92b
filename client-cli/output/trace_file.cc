#include "client-cli/output/trace_file.h"

#include <algorithm>
#include <cstdint>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include <nlohmann/json.hpp>

#include "wire/proto_convert.h"

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;
using Json = nlohmann::ordered_json;

// Whole nanoseconds, so that a span that ends with another still does after rounding.
double Microseconds(absl::Duration duration) {
  return static_cast<double>(absl::ToInt64Nanoseconds(duration)) / 1000.0;
}

Json Metadata(const char* name, int process, int thread, Json args) {
  return {
      {"ph", "M"}, {"name", name}, {"pid", process}, {"tid", thread}, {"args", std::move(args)}};
}

Json Span(const std::string& name, int process, int thread, absl::Duration start,
          absl::Duration length) {
  return {{"ph", "X"},
          {"name", name},
          {"cat", "isoscope"},
          {"pid", process},
          {"tid", thread},
          {"ts", Microseconds(start)},
          {"dur", Microseconds(length)}};
}

void NameProcess(const std::string& name, int process, Json* events) {
  events->push_back(Metadata("process_name", process, 0, {{"name", name}}));
  events->push_back(Metadata("process_sort_index", process, 0, {{"sort_index", process}}));
}

absl::Duration EndOf(const v1::ProcessTrace& process) {
  absl::Duration end;
  for (const v1::TraceTrack& track : process.tracks()) {
    for (const v1::TraceSpan& span : track.spans()) {
      end = std::max(end, wire::DurationFromProto(span.start_duration()) +
                              wire::DurationFromProto(span.span_duration()));
    }
  }
  return end;
}

void AddProcess(const v1::ProcessTrace& trace, int process, absl::Duration zero, Json* events) {
  NameProcess(trace.name(), process, events);
  std::vector<std::string> labels;
  const absl::Duration error = wire::DurationFromProto(trace.clock_error_duration());
  if (error > absl::ZeroDuration()) {
    labels.push_back(absl::StrFormat("clock +- %.0f us", absl::ToDoubleMicroseconds(error)));
  }
  if (trace.dropped_span_count() > 0) {
    labels.push_back(absl::StrCat(trace.dropped_span_count(), " spans dropped"));
  }
  if (!labels.empty()) {
    events->push_back(
        Metadata("process_labels", process, 0, {{"labels", absl::StrJoin(labels, ", ")}}));
  }
  for (int i = 0; i < trace.tracks_size(); ++i) {
    const v1::TraceTrack& track = trace.tracks(i);
    const int thread = i + 1;
    events->push_back(Metadata("thread_name", process, thread, {{"name", track.name()}}));
    events->push_back(Metadata("thread_sort_index", process, thread, {{"sort_index", thread}}));
    for (const v1::TraceSpan& span : track.spans()) {
      events->push_back(Span(span.name(), process, thread,
                             zero + wire::DurationFromProto(span.start_duration()),
                             wire::DurationFromProto(span.span_duration())));
    }
  }
}

}  // namespace

std::string TraceToJson(const v1::FrameTrace& trace, absl::Duration client_duration) {
  const absl::Duration server_duration =
      trace.processes().empty() ? absl::ZeroDuration() : EndOf(trace.processes(0));
  const absl::Duration zero = std::max(client_duration - server_duration, absl::ZeroDuration()) / 2;
  Json events = Json::array();
  constexpr int kClient = 1;
  NameProcess("client", kClient, &events);
  events.push_back(Metadata(
      "process_labels", kClient, 0,
      {{"labels", absl::StrFormat("clock +- %.0f us", absl::ToDoubleMicroseconds(zero))}}));
  events.push_back(Metadata("thread_name", kClient, 1, {{"name", "request"}}));
  events.push_back(Span("request", kClient, 1, absl::ZeroDuration(), client_duration));
  for (int i = 0; i < trace.processes_size(); ++i) {
    AddProcess(trace.processes(i), kClient + 1 + i, zero, &events);
  }
  const Json file = {
      {"displayTimeUnit", "ms"},
      {"otherData", {{"request_id", trace.request_id()}, {"frame_number", trace.frame_number()}}},
      {"traceEvents", std::move(events)}};
  return file.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
}

}  // namespace isoscope::cli
