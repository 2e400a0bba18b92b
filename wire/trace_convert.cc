#include "wire/trace_convert.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"

#include "core/base/clock_alignment.h"
#include "wire/proto_convert.h"

namespace isoscope::wire {
namespace {

namespace v1 = isoscope::v1;
namespace internal = isoscope::internal::v1;

absl::Duration Since(base::TraceTime zero, base::TraceTime time) {
  return absl::FromChrono(time - zero);
}

void AddSpan(const char* name, absl::Duration begin, absl::Duration end, v1::TraceTrack* track) {
  v1::TraceSpan* const span = track->add_spans();
  span->set_name(name);
  *span->mutable_start_duration() = ToProto(begin);
  *span->mutable_span_duration() = ToProto(end - begin);
}

// Adds a track of the messages of one direction; `sent` and `received` have one size.
void AddNetwork(const char* track_name, const std::vector<absl::Duration>& sent,
                const std::vector<absl::Duration>& received, v1::ProcessTrace* trace) {
  v1::TraceTrack* const track = trace->add_tracks();
  track->set_name(track_name);
  absl::Duration last = -absl::InfiniteDuration();
  for (std::size_t i = 0; i < sent.size(); ++i) {
    const absl::Duration begin = std::max(sent[i], last);
    AddSpan("network", begin, std::max(received[i], begin), track);
    last = std::max(received[i], begin);
  }
}

}  // namespace

v1::ProcessTrace ToProto(const base::RecordedTrace& trace, base::TraceTime zero) {
  v1::ProcessTrace proto;
  for (const base::RecordedTrack& track : trace.tracks) {
    v1::TraceTrack* const out = proto.add_tracks();
    out->set_name(track.name);
    for (const base::RecordedSpan& span : track.spans) {
      AddSpan(span.name, Since(zero, span.begin), Since(zero, span.end), out);
    }
  }
  proto.set_dropped_span_count(trace.dropped_span_count);
  return proto;
}

internal::AgentTrace ToProto(const base::RecordedTrace& trace, const MessageTimes& times,
                             base::TraceTime zero) {
  internal::AgentTrace proto;
  *proto.mutable_spans() = ToProto(trace, zero);
  for (const base::TraceTime time : times.received) {
    *proto.add_receive_duration() = ToProto(Since(zero, time));
  }
  for (const base::TraceTime time : times.sent) {
    *proto.add_send_duration() = ToProto(Since(zero, time));
  }
  return proto;
}

v1::ProcessTrace AlignAgentTrace(internal::AgentTrace trace, const MessageTimes& times,
                                 base::TraceTime zero, const std::string& agent_address) {
  std::vector<absl::Duration> out_sent;
  std::vector<absl::Duration> out_received;
  std::vector<absl::Duration> in_sent;
  std::vector<absl::Duration> in_received;
  base::ClockAlignment alignment;
  const int out_count =
      std::min(static_cast<int>(times.sent.size()), trace.receive_duration_size());
  for (int i = 0; i < out_count; ++i) {
    out_sent.push_back(Since(zero, times.sent[static_cast<std::size_t>(i)]));
    out_received.push_back(DurationFromProto(trace.receive_duration(i)));
    alignment.AddSent(out_sent.back(), out_received.back());
  }
  const int in_count =
      std::min(static_cast<int>(times.received.size()), trace.send_duration_size());
  for (int i = 0; i < in_count; ++i) {
    in_sent.push_back(DurationFromProto(trace.send_duration(i)));
    in_received.push_back(Since(zero, times.received[static_cast<std::size_t>(i)]));
    alignment.AddReceived(in_sent.back(), in_received.back());
  }
  const absl::Duration offset = alignment.offset();
  for (absl::Duration& time : out_received) {
    time += offset;
  }
  for (absl::Duration& time : in_sent) {
    time += offset;
  }
  v1::ProcessTrace aligned = std::move(*trace.mutable_spans());
  aligned.set_name(absl::StrCat("agent ", agent_address));
  for (v1::TraceTrack& track : *aligned.mutable_tracks()) {
    for (v1::TraceSpan& span : *track.mutable_spans()) {
      *span.mutable_start_duration() = ToProto(DurationFromProto(span.start_duration()) + offset);
    }
  }
  AddNetwork("network out", out_sent, out_received, &aligned);
  AddNetwork("network in", in_sent, in_received, &aligned);
  if (alignment.error() < absl::InfiniteDuration()) {
    *aligned.mutable_clock_error_duration() = ToProto(alignment.error());
  }
  return aligned;
}

void KeepFirstSpans(std::size_t max_spans, v1::ProcessTrace* trace) {
  std::vector<absl::Duration> starts;
  for (const v1::TraceTrack& track : trace->tracks()) {
    for (const v1::TraceSpan& span : track.spans()) {
      starts.push_back(DurationFromProto(span.start_duration()));
    }
  }
  if (starts.size() <= max_spans) {
    return;
  }
  std::nth_element(starts.begin(), starts.begin() + static_cast<std::ptrdiff_t>(max_spans),
                   starts.end());
  const absl::Duration first_dropped = starts[max_spans];
  std::int64_t dropped = 0;
  for (v1::TraceTrack& track : *trace->mutable_tracks()) {
    auto& spans = *track.mutable_spans();
    const auto end = std::remove_if(spans.begin(), spans.end(), [&](const v1::TraceSpan& span) {
      return DurationFromProto(span.start_duration()) >= first_dropped;
    });
    dropped += spans.end() - end;
    spans.erase(end, spans.end());
  }
  trace->set_dropped_span_count(trace->dropped_span_count() + dropped);
}

}  // namespace isoscope::wire
