#include "wire/trace_convert.h"

#include <chrono>
#include <limits>
#include <string>

#include "absl/time/time.h"
#include "gtest/gtest.h"

#include "wire/proto_convert.h"

namespace isoscope::wire {
namespace {

namespace v1 = isoscope::v1;

base::TraceTime At(int milliseconds) {
  return base::TraceTime() + std::chrono::milliseconds(milliseconds);
}

absl::Duration StartOf(const v1::TraceSpan& span) {
  return DurationFromProto(span.start_duration());
}
absl::Duration EndOf(const v1::TraceSpan& span) {
  return StartOf(span) + DurationFromProto(span.span_duration());
}

const v1::TraceTrack& TrackOf(const v1::ProcessTrace& trace, const std::string& name) {
  for (const v1::TraceTrack& track : trace.tracks()) {
    if (track.name() == name) {
      return track;
    }
  }
  ADD_FAILURE() << "no track " << name;
  return v1::TraceTrack::default_instance();
}

// An agent that began at its own 100 ms and worked from 102 to 108 and from 115 to 118.
base::RecordedTrace Recorded() {
  base::RecordedTrace trace;
  trace.tracks.push_back({"frame 1", {{"draw", At(102), At(108)}, {"encode", At(115), At(118)}}});
  trace.dropped_span_count = 3;
  return trace;
}

TEST(TraceConvertTest, SpansAreDurationsSinceTheZeroOfTheAxis) {
  const v1::ProcessTrace proto = ToProto(Recorded(), At(100));
  ASSERT_EQ(proto.tracks_size(), 1);
  EXPECT_EQ(proto.tracks(0).name(), "frame 1");
  ASSERT_EQ(proto.tracks(0).spans_size(), 2);
  EXPECT_EQ(proto.tracks(0).spans(0).name(), "draw");
  EXPECT_EQ(StartOf(proto.tracks(0).spans(0)), absl::Milliseconds(2));
  EXPECT_EQ(EndOf(proto.tracks(0).spans(1)), absl::Milliseconds(18));
  EXPECT_EQ(proto.dropped_span_count(), 3);
}

TEST(TraceConvertTest, AnAgentsSpansMoveToTheCoordinatorsAxisByItsMessages) {
  const auto agent_trace =
      ToProto(Recorded(), {.sent = {At(109), At(119)}, .received = {At(100), At(112)}}, At(100));
  // The coordinator's clock says 5000 when the agent's says 0; messages take 1 ms each way.
  const v1::ProcessTrace aligned =
      AlignAgentTrace(agent_trace, {.sent = {At(5099), At(5111)}, .received = {At(5110), At(5120)}},
                      At(5000), "a:1");
  EXPECT_EQ(aligned.name(), "agent a:1");
  EXPECT_EQ(DurationFromProto(aligned.clock_error_duration()), absl::Milliseconds(1));
  const v1::TraceTrack& frame = TrackOf(aligned, "frame 1");
  EXPECT_EQ(StartOf(frame.spans(0)), absl::Milliseconds(102));
  EXPECT_EQ(EndOf(frame.spans(1)), absl::Milliseconds(118));
  const v1::TraceTrack& out = TrackOf(aligned, "network out");
  ASSERT_EQ(out.spans_size(), 2);
  EXPECT_EQ(StartOf(out.spans(0)), absl::Milliseconds(99));
  EXPECT_EQ(EndOf(out.spans(0)), absl::Milliseconds(100));
  const v1::TraceTrack& in = TrackOf(aligned, "network in");
  ASSERT_EQ(in.spans_size(), 2);
  EXPECT_EQ(StartOf(in.spans(1)), absl::Milliseconds(119));
  EXPECT_EQ(EndOf(in.spans(1)), absl::Milliseconds(120));
}

TEST(TraceConvertTest, OfTooManySpansTheLastOnesAreDroppedAndCounted) {
  base::RecordedTrace trace = Recorded();  // begins at 102 and 115, and has dropped 3
  trace.tracks.push_back({"worker 2", {{"read", At(101), At(103)}, {"read", At(120), At(121)}}});
  v1::ProcessTrace proto = ToProto(trace, At(100));
  KeepFirstSpans(4, &proto);
  EXPECT_EQ(proto.dropped_span_count(), 3);
  KeepFirstSpans(2, &proto);
  EXPECT_EQ(proto.dropped_span_count(), 5);
  ASSERT_EQ(TrackOf(proto, "frame 1").spans_size(), 1);
  EXPECT_EQ(TrackOf(proto, "frame 1").spans(0).name(), "draw");
  ASSERT_EQ(TrackOf(proto, "worker 2").spans_size(), 1);
  EXPECT_EQ(StartOf(TrackOf(proto, "worker 2").spans(0)), absl::Milliseconds(1));
  KeepFirstSpans(0, &proto);
  EXPECT_EQ(proto.dropped_span_count(), 7);
  EXPECT_EQ(proto.tracks_size(), 2) << "a track stays";
}

TEST(TraceConvertTest, ManyAgentsTogetherRecordAsManySpansAsFew) {
  EXPECT_EQ(MaxSpansOfAgent(1), base::TraceRecorder::kMaxSpans);
  for (const int agent_count : {2, 3, 16, 64, 256}) {
    EXPECT_LE(MaxSpansOfAgent(agent_count) * static_cast<std::size_t>(agent_count),
              2 * base::TraceRecorder::kMaxSpans);
  }
  for (const int nonsense : {-1, 0, std::numeric_limits<int>::max()}) {
    EXPECT_GE(MaxSpansOfAgent(nonsense), std::size_t{256});
  }
}

TEST(TraceConvertTest, MessagesThatOvertakeTheArrivalOfOthersDoNotOverlapOnTheirTrack) {
  const auto agent_trace = ToProto(base::RecordedTrace(),
                                   {.sent = {At(10), At(11), At(12)}, .received = {At(0)}}, At(0));
  const v1::ProcessTrace aligned = AlignAgentTrace(
      agent_trace, {.sent = {At(0)}, .received = {At(20), At(21), At(21)}}, At(0), "a:1");
  const v1::TraceTrack& in = TrackOf(aligned, "network in");
  ASSERT_EQ(in.spans_size(), 3);
  for (int i = 1; i < 3; ++i) {
    EXPECT_GE(StartOf(in.spans(i)), EndOf(in.spans(i - 1)));
    EXPECT_GE(EndOf(in.spans(i)), StartOf(in.spans(i)));
  }
}

TEST(TraceConvertTest, AnAgentThatTellsNonsenseIsAlignedByWhatFits) {
  isoscope::internal::v1::AgentTrace nonsense;
  for (int i = 0; i < 5; ++i) {
    nonsense.add_send_duration()->set_seconds(i % 2 == 0 ? 9'000'000'000'000'000 : -5);
    nonsense.add_receive_duration()->set_nanos(i % 2 == 0 ? -2'000'000'000 : 2'000'000'000);
  }
  v1::TraceTrack* const track = nonsense.mutable_spans()->add_tracks();
  track->add_spans()->mutable_start_duration()->set_seconds(-9'000'000'000'000'000);
  track->add_spans()->mutable_span_duration()->set_seconds(-1);
  const v1::ProcessTrace aligned =
      AlignAgentTrace(nonsense, {.sent = {At(1)}, .received = {At(2), At(3)}}, At(0), "a:1");
  EXPECT_EQ(aligned.tracks_size(), 3);
  EXPECT_EQ(TrackOf(aligned, "network out").spans_size(), 1);
  EXPECT_EQ(TrackOf(aligned, "network in").spans_size(), 2);

  const v1::ProcessTrace empty = AlignAgentTrace({}, {}, At(0), "a:1");
  EXPECT_FALSE(empty.has_clock_error_duration());
}

}  // namespace
}  // namespace isoscope::wire
