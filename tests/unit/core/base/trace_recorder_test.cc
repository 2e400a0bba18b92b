#include "core/base/trace_recorder.h"

#include <chrono>
#include <cstddef>
#include <string>
#include <thread>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::base {
namespace {

using ::testing::StartsWith;

TraceTime At(int microseconds) { return TraceTime() + std::chrono::microseconds(microseconds); }

TEST(TraceRecorderTest, ScopesNestOnTheirThreadInTheOrderOfTheirBeginnings) {
  TraceRecorder recorder;
  {
    const TraceScope outer(&recorder, "outer");
    { const TraceScope first(&recorder, "first"); }
    const TraceScope second(&recorder, "second");
  }
  const RecordedTrace trace = recorder.Get();
  ASSERT_EQ(trace.tracks.size(), 1u);
  EXPECT_THAT(trace.tracks[0].name, StartsWith("worker "));
  const std::vector<RecordedSpan>& spans = trace.tracks[0].spans;
  ASSERT_EQ(spans.size(), 3u);
  EXPECT_STREQ(spans[0].name, "outer");
  EXPECT_STREQ(spans[1].name, "first");
  EXPECT_STREQ(spans[2].name, "second");
  EXPECT_LE(spans[0].begin, spans[1].begin);
  EXPECT_LE(spans[1].end, spans[2].begin);
  EXPECT_LE(spans[2].end, spans[0].end);
  EXPECT_EQ(trace.dropped_span_count, 0);
}

TEST(TraceRecorderTest, OfSpansThatBeginTogetherTheLongerOneComesFirst) {
  TraceRecorder recorder;
  recorder.AddTo("queue", "short", At(5), At(6));
  recorder.AddTo("queue", "long", At(5), At(9));
  recorder.AddTo("queue", "early", At(1), At(2));
  const std::vector<RecordedTrack> tracks = recorder.Get().tracks;
  ASSERT_EQ(tracks.size(), 1u);
  EXPECT_EQ(tracks[0].name, "queue");
  EXPECT_STREQ(tracks[0].spans[0].name, "early");
  EXPECT_STREQ(tracks[0].spans[1].name, "long");
  EXPECT_STREQ(tracks[0].spans[2].name, "short");
}

TEST(TraceRecorderTest, AThreadHasATrackOfItsOwnAndTheNameThatItWasGiven) {
  TraceRecorder recorder;
  recorder.NameThisThread("frame");
  recorder.Add("here", At(0), At(1));
  std::thread([&] { recorder.Add("there", At(0), At(1)); }).join();
  const std::vector<RecordedTrack> tracks = recorder.Get().tracks;
  ASSERT_EQ(tracks.size(), 2u);
  EXPECT_THAT(tracks[0].name, StartsWith("frame "));
  EXPECT_THAT(tracks[1].name, StartsWith("worker "));
  EXPECT_STREQ(tracks[1].spans[0].name, "there");
}

TEST(TraceRecorderTest, ATrackWithoutSpansIsLeftOut) {
  TraceRecorder recorder;
  recorder.NameThisThread("frame");
  EXPECT_TRUE(recorder.Get().tracks.empty());
}

TEST(TraceRecorderTest, SpansBeyondTheBoundAreDroppedAndCounted) {
  TraceRecorder recorder(/*max_spans=*/3);
  for (int i = 0; i < 10; ++i) {
    recorder.Add("span", At(i), At(i + 1));
  }
  const RecordedTrace trace = recorder.Get();
  ASSERT_EQ(trace.tracks.size(), 1u);
  EXPECT_EQ(trace.tracks[0].spans.size(), 3u);
  EXPECT_EQ(trace.dropped_span_count, 7);
}

TEST(TraceRecorderTest, ThreadsRecordSideBySide) {
  constexpr int kThreads = 8;
  constexpr int kSpans = 500;
  TraceRecorder recorder;
  std::vector<std::thread> threads;
  for (int i = 0; i < kThreads; ++i) {
    threads.emplace_back([&] {
      for (int k = 0; k < kSpans; ++k) {
        const TraceScope scope(&recorder, "work");
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  std::size_t count = 0;
  const RecordedTrace trace = recorder.Get();
  for (const RecordedTrack& track : trace.tracks) {
    count += track.spans.size();
    for (std::size_t i = 1; i < track.spans.size(); ++i) {
      ASSERT_LE(track.spans[i - 1].end, track.spans[i].begin);
    }
  }
  EXPECT_EQ(count, std::size_t{kThreads} * kSpans);
}

TEST(TraceRecorderTest, AnEndedScopeAddsNothingLaterAndNullRecordsNothing) {
  TraceRecorder recorder;
  {
    TraceScope scope(&recorder, "once");
    scope.End();
    scope.End();
    const TraceScope nothing(nullptr, "nothing");
  }
  ASSERT_EQ(recorder.Get().tracks.size(), 1u);
  EXPECT_EQ(recorder.Get().tracks[0].spans.size(), 1u);
}

}  // namespace
}  // namespace isoscope::base
