// Callers who are slow, rude or many, against agents of a script: what one of them does must not
// stop the others.

#include <algorithm>
#include <atomic>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/synchronization/mutex.h"
#include "absl/synchronization/notification.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "core/base/retry_delay.h"
#include "isoscope/v1/trace.pb.h"
#include "rpc/grpc_time.h"
#include "tests/support/enough_time.h"
#include "tests/unit/server/fake_cluster.h"

namespace isoscope::server {
namespace {

namespace internal = isoscope::internal::v1;
namespace v1 = isoscope::v1;

using ::testing::AllOf;
using testing::FakeAgent;
using testing::FrameRequest;
using ::testing::HasSubstr;
using testing::HeldFrames;
using testing::IsOk;
using testing::kLimit;
using testing::MakeShard;
using testing::PlayEmptyFrame;
using testing::StatusIs;
using testing::TokenEntry;
using testing::WaitFor;

constexpr absl::StatusCode kRefused = absl::StatusCode::kResourceExhausted;

// The mesh of these blocks, 1.2 MiB each.
auto SendLargeSurface(std::int64_t first_block, std::int64_t end_block) {
  return [=](grpc::ServerContext*, FakeAgent::SurfaceWriter* writer) {
    return testing::WriteBlocks(first_block, end_block, /*triangles=*/100'000, writer);
  };
}

class RudeCallersTest : public testing::TwoAgentsTest {
 protected:
  RudeCallersTest() {
    first_.on_surface = SendLargeSurface(0, 4);
    second_.on_surface = SendLargeSurface(4, 8);
  }

  absl::Status RenderAs(const std::string& token,
                        const v1::RenderIsosurfaceRequest& request = FrameRequest()) {
    return Render(request, kLimit, token).status();
  }
  testing::Export ExportAs(const std::string& token) {
    return testing::Export(frames_.get(), token);
  }
  bool AwaitFrames(int working, int queued) {
    return WaitFor([&] {
      return Metric("isoscope_admission_frames", "working") == working &&
             Metric("isoscope_admission_frames", "queued") == queued;
    });
  }
};

// One interactive stream.
class Stream {
 public:
  Stream(const std::shared_ptr<grpc::Channel>& channel, const std::string& token)
      : stub_(v1::InteractService::NewStub(channel)) {
    context_.set_deadline(base::MonotonicNow() + 3 * kLimit);
    rpc::SendToken(token, &context_);
    stream_ = stub_->Interact(&context_);
  }
  ~Stream() {
    context_.TryCancel();
    if (!is_finished_) {
      Finish().IgnoreError();
    }
  }
  bool Send(const v1::RenderIsosurfaceRequest& frame, bool is_at_rest = true) {
    v1::InteractRequest request;
    request.mutable_view_state()->set_sequence_number(++sequence_);
    *request.mutable_view_state()->mutable_frame() = frame;
    request.mutable_view_state()->set_is_at_rest(is_at_rest);
    return stream_->Write(request);
  }
  bool Read(v1::InteractResponse* response) { return stream_->Read(response); }
  // Sends this state every `pause`, for a second and until there is an answer of that kind. Counts
  // those that come meanwhile.
  int CountFor(const v1::RenderIsosurfaceRequest& frame, absl::Duration pause,
               bool (v1::InteractResponse::*is_counted)() const) {
    std::atomic<int> count{0};
    std::thread reader([&] {
      v1::InteractResponse response;
      while (Read(&response)) {
        count += (response.*is_counted)() ? 1 : 0;
      }
    });
    const base::MonotonicTime begin = base::MonotonicNow();
    const auto goes_on = [&](absl::Duration time) {
      return time < absl::Seconds(1) || (count == 0 && time < kLimit);
    };
    while (goes_on(base::MonotonicNow() - begin) && Send(frame)) {
      absl::SleepFor(pause);
    }
    Cancel();
    reader.join();
    return count;
  }
  absl::Status Finish() {
    v1::InteractResponse response;
    while (stream_->Read(&response)) {
    }
    is_finished_ = true;
    return rpc::ToAbslStatus(stream_->Finish());
  }
  void Cancel() { context_.TryCancel(); }

 private:
  std::unique_ptr<v1::InteractService::Stub> stub_;
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::InteractRequest, v1::InteractResponse>> stream_;
  std::int64_t sequence_ = 0;
  bool is_finished_ = false;
};

// A state whose frame can't be shown: its output is no PNG.
v1::RenderIsosurfaceRequest InvalidState() {
  v1::RenderIsosurfaceRequest frame = FrameRequest();
  frame.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_JPEG);
  return frame;
}

// Symptom: an export reserved the memory of frames, and a client that took no chunk kept it.
TEST_F(RudeCallersTest, ASlowReaderOfAnExportDoesNotStopFrames) {
  options_.memory_limit_bytes = std::size_t{96} * 1024 * 1024;
  const Running running = Start();
  testing::Export slow = ExportAs("");
  ASSERT_TRUE(slow.Read());
  absl::SleepFor(absl::Milliseconds(200));  // until all that may wait for it does
  for (int i = 0; i < 3; ++i) {
    // Before the export ends for its reader's slowness (ExportLimits).
    EXPECT_THAT(Render(FrameRequest(1024, 1024), absl::Seconds(30)), IsOk()) << i;
  }
  EXPECT_TRUE(slow.Read()) << "the export goes on";
}

// Symptom: of 80 agents and 1 GiB an export took the memory of all frames. It streams from eight.
TEST_F(RudeCallersTest, ASlowReaderOfAnExportOfEightyAgentsLeavesFramesTheirMemory) {
  constexpr int kAgentCount = 80;
  constexpr int kBlockCount = 8;
  agents_.clear();
  for (int i = 0; i < kAgentCount; ++i) {
    AddAgent({MakeShard("head", i, kAgentCount)})->on_surface =
        SendLargeSurface(i, i < kBlockCount ? i + 1 : i);
  }
  options_.memory_limit_bytes = std::size_t{1024} * 1024 * 1024;
  const Running running = Start();
  testing::Export slow = ExportAs("");
  ASSERT_TRUE(slow.Read());
  EXPECT_GT(Metric("isoscope_export_memory_bytes"), 0);
  EXPECT_LE(Metric("isoscope_export_memory_bytes"), 128 * 1024 * 1024);
  EXPECT_EQ(Metric("isoscope_frame_memory_bytes"), 0);
  for (int i = 0; i < 3; ++i) {
    EXPECT_THAT(Render(FrameRequest(2048, 2048)), IsOk()) << i;
  }
  EXPECT_THAT(slow.Finish(), IsOk());
  EXPECT_TRUE(WaitFor([&] { return Metric("isoscope_export_memory_bytes") == 0; }));
}

// Symptom: traces were beside the memory limit, 32 768 spans of each agent.
TEST_F(RudeCallersTest, ATraceCountsAgainstTheMemoryLimit) {
  constexpr int kSpanCount = 40'000;
  internal::AgentTrace trace;
  v1::TraceTrack* const track = trace.mutable_spans()->add_tracks();
  track->set_name("worker");
  for (int i = 0; i < kSpanCount; ++i) {
    v1::TraceSpan* const span = track->add_spans();
    span->set_name("draw");
    span->mutable_start_duration()->set_nanos(1000 * i);
  }
  for (FakeAgent* agent : {&first_, &second_}) {
    agent->on_frame = [&trace](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
      return PlayEmptyFrame(stream, &trace);
    };
  }
  options_.memory_limit_bytes = std::size_t{96} * 1024 * 1024;
  const Running running = Start();
  v1::RenderIsosurfaceRequest request = FrameRequest(1200, 1200);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse untraced, Render(request));
  EXPECT_EQ(untraced.statistics().band_count(), 1);
  for (const bool is_large : {true, false}) {
    request = is_large ? FrameRequest(1200, 1200) : FrameRequest();
    request.set_with_trace(true);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response, Render(request));
    const auto band_count = static_cast<int>(response.statistics().band_count());
    EXPECT_EQ(band_count > 1, is_large) << "the trace takes a part of the memory for pixels";
    ASSERT_EQ(response.trace().processes_size(), 1 + 2 * band_count);
    int of_agents = 0;
    for (int i = 1; i < response.trace().processes_size(); ++i) {
      const v1::ProcessTrace& of_agent = response.trace().processes(i);
      const int kept = of_agent.tracks(0).spans_size();
      EXPECT_GT(kept, 0);
      EXPECT_EQ(kept + of_agent.dropped_span_count(), kSpanCount);
      of_agents += kept;
    }
    EXPECT_LT(of_agents, 12 * 1024 * 1024 / 320) << "an eighth of the limit, 320 bytes a span";
  }
}

// Symptom: the bytes of image, occlusion map and bands stayed reserved until the client had taken
// the last part.
TEST_F(RudeCallersTest, AFrameThatIsBeingSentReservesOnlyItsResponse) {
  const Running running = Start();
  grpc::ClientContext context;
  v1::RenderIsosurfaceStreamRequest request;
  *request.mutable_request() = FrameRequest(1024, 1024);
  request.mutable_request()->mutable_output()->set_image_format(
      v1::OutputOptions::IMAGE_FORMAT_RGBA8);
  const auto reader = frames_->RenderIsosurfaceStream(&context, request);
  v1::RenderIsosurfaceStreamResponse part;
  ASSERT_TRUE(reader->Read(&part));
  constexpr double kMostBytes = 8 * 1024 * 1024;  // the response has 4 MiB; the frame took 31
  EXPECT_TRUE(WaitFor([&] {
    const double bytes = Metric("isoscope_frame_memory_bytes");
    return bytes > 0 && bytes < kMostBytes;
  })) << Metric("isoscope_frame_memory_bytes");
  while (reader->Read(&part)) {
  }
  EXPECT_THAT(rpc::ToAbslStatus(reader->Finish()), IsOk());
}

// Symptom: a caller over its rate was admitted first, and pushed another's frame out of the line.
TEST_F(RudeCallersTest, ACallerOverItsRateTakesNobodysPlace) {
  HeldFrames held(&second_, /*is_holding=*/false);
  options_.max_concurrent_frames = 1;
  options_.max_queued_frames = 2;
  WriteTokens({TokenEntry("rude", R"("max_frames_per_second": 0.001)"), TokenEntry("patient")});
  const Running running = Start();
  EXPECT_THAT(RenderAs("rude"), IsOk());
  EXPECT_THAT(RenderAs("rude"), IsOk());
  held.Hold();
  std::vector<absl::Status> ends(3);
  std::vector<std::thread> clients;
  for (absl::Status& end : ends) {
    clients.emplace_back([&] { end = RenderAs("patient"); });
  }
  EXPECT_TRUE(AwaitFrames(/*working=*/1, /*queued=*/2));
  EXPECT_THAT(RenderAs("rude"), StatusIs(kRefused, HasSubstr("frames a second")));
  held.Release();
  for (std::thread& client : clients) {
    client.join();
  }
  for (const absl::Status& end : ends) {
    EXPECT_THAT(end, IsOk());
  }
}

TEST_F(RudeCallersTest, ARefusedFrameIsNotCountedAgainstTheRate) {
  HeldFrames held(&second_);
  options_.max_concurrent_frames = 1;
  options_.max_queued_frames = 0;
  WriteTokens({TokenEntry("limited", R"("max_frames_per_second": 0.001)"), TokenEntry("other")});
  const Running running = Start();
  std::thread client([&] { EXPECT_THAT(RenderAs("other"), IsOk()); });
  EXPECT_TRUE(AwaitFrames(/*working=*/1, /*queued=*/0));
  for (int i = 0; i < 4; ++i) {
    EXPECT_THAT(RenderAs("limited"), StatusIs(kRefused, HasSubstr("frames are in work")));
  }
  held.Release();
  client.join();
  EXPECT_THAT(RenderAs("limited"), IsOk());
  EXPECT_THAT(RenderAs("limited"), IsOk());
  EXPECT_THAT(RenderAs("limited"), StatusIs(kRefused, HasSubstr("frames a second")));
}

TEST_F(RudeCallersTest, ExportsCountAgainstTheRate) {
  WriteTokens({TokenEntry("limited", R"("max_frames_per_second": 0.001)")});
  const Running running = Start();
  for (int i = 0; i < 2; ++i) {
    EXPECT_THAT(ExportAs("limited").Finish(), IsOk());
  }
  EXPECT_THAT(ExportAs("limited").Finish(), StatusIs(kRefused, HasSubstr("frames a second")));
}

// Symptom: histograms waited in one queue for all, and one caller's hundred came before another's.
TEST_F(RudeCallersTest, HistogramsOfCallersTakeTurns) {
  // Bins, by which the agent knows whose histogram it is, and of which attempt.
  constexpr int kOfRude = 100;
  constexpr int kOfTheOther = 101;
  constexpr int kOfAttempt = 2;
  constexpr int kRude = 20;
  // An agent may still be asked when its client has the other one's error, and the test has ended.
  struct Script {
    absl::Mutex mutex;
    bool is_released ABSL_GUARDED_BY(mutex) = false;
    int attempt ABSL_GUARDED_BY(mutex) = -1;
    std::vector<int> asked ABSL_GUARDED_BY(mutex);  // less what tells attempts apart
  };
  const auto script = std::make_shared<Script>();
  first_.on_histogram = [script](grpc::ServerContext*,
                                 const internal::GetShardHistogramRequest& request,
                                 internal::GetShardHistogramResponse*) {
    const absl::MutexLock lock(&script->mutex);
    const int bins = request.max_bin_count() - kOfAttempt * script->attempt;
    if (bins >= kOfRude) {  // else late: of an attempt that is over
      script->asked.push_back(bins);
      script->mutex.Await(absl::Condition(&script->is_released));
    }
    return grpc::Status(grpc::StatusCode::DATA_LOSS, "a script");
  };
  second_.on_histogram = first_.on_histogram;
  WriteTokens({TokenEntry("rude"), TokenEntry("other")});
  const Running running = Start();
  const auto ask = [&](const std::string& token, int bins) {
    v1::GetHistogramRequest request;
    request.set_dataset("head");
    request.set_max_bin_count(bins);
    return Call(datasets_, &v1::DatasetService::Stub::GetHistogram, request, token).status();
  };
  // Nobody tells who waits in the coordinator. So the callers have more time at each attempt to come
  // there; with one queue for all, no time is enough.
  testing::WithEnoughTime(absl::Milliseconds(200), [&](absl::Duration time) {
    int attempt = 0;
    {
      const absl::MutexLock lock(&script->mutex);
      attempt = ++script->attempt;
      script->is_released = false;
      script->asked.clear();
    }
    std::vector<std::thread> clients;
    for (int i = 0; i < kRude; ++i) {
      clients.emplace_back([&] { ask("rude", kOfRude + kOfAttempt * attempt).IgnoreError(); });
    }
    EXPECT_TRUE(WaitFor([&] {
      const absl::MutexLock lock(&script->mutex);
      return !script->asked.empty();
    }));
    absl::SleepFor(time);  // until the others wait
    clients.emplace_back([&] { ask("other", kOfTheOther + kOfAttempt * attempt).IgnoreError(); });
    absl::SleepFor(time);
    {
      const absl::MutexLock lock(&script->mutex);
      script->is_released = true;
    }
    for (std::thread& client : clients) {
      client.join();
    }
    const absl::MutexLock lock(&script->mutex);
    const std::vector<int>& asked = script->asked;
    const auto first = std::find(asked.begin(), asked.end(), kOfTheOther);
    EXPECT_NE(first, asked.end());
    const std::ptrdiff_t before = first - asked.begin();
    RecordProperty("agents_asked_before", static_cast<int>(before));
    // Two agents, two histograms in work, and one turn of the rude caller.
    return before <= 8;
  });
}

// Symptom: queries for the values of labels, which read all samples, took the places of histograms.
TEST_F(RudeCallersTest, AHistogramIsAnsweredWhileQueriesOfLabelsAreInWork) {
  struct Script {
    absl::Notification release;
    std::atomic<int> label_count{0};
  };
  const auto script = std::make_shared<Script>();
  first_.on_histogram = [script](grpc::ServerContext*,
                                 const internal::GetShardHistogramRequest& request,
                                 internal::GetShardHistogramResponse*) {
    if (request.max_label_value_count() > 0) {
      ++script->label_count;
      script->release.WaitForNotification();
    }
    return grpc::Status(grpc::StatusCode::DATA_LOSS, "a script");
  };
  second_.on_histogram = first_.on_histogram;
  const Running running = Start();
  const auto ask = [&](int label_count) {
    v1::GetHistogramRequest request;
    request.set_dataset("head");
    request.set_max_bin_count(100);
    request.set_max_label_value_count(label_count);
    return Call(datasets_, &v1::DatasetService::Stub::GetHistogram, request).status();
  };
  std::vector<std::thread> clients;
  for (int i = 0; i < 6; ++i) {
    clients.emplace_back([&] { ask(10).IgnoreError(); });
  }
  // The two that have a place, at both agents. The others wait.
  EXPECT_TRUE(WaitFor([&] { return script->label_count == 4; }));
  EXPECT_THAT(ask(0), StatusIs(absl::StatusCode::kDataLoss)) << "the agent's answer";
  EXPECT_EQ(script->label_count, 4) << "no more than two are in work";
  script->release.Notify();
  for (std::thread& client : clients) {
    client.join();
  }
}

// Symptom: a client that sent nothing but wrong states got an error for each, read or not.
TEST_F(RudeCallersTest, WrongStatesGetFewErrors) {
  const Running running = Start();
  Stream rude(channel_, "");
  const base::MonotonicTime begin = base::MonotonicNow();
  const int errors =
      rude.CountFor(InvalidState(), absl::ZeroDuration(), &v1::InteractResponse::has_error);
  const double seconds = absl::ToDoubleSeconds(base::MonotonicNow() - begin);
  RecordProperty("errors", errors);
  EXPECT_GE(errors, 1);
  EXPECT_LE(errors, 10 * seconds + 5);
}

// Symptom: exact frames needed no acknowledgement, and a client that never gave one got as many as
// could be drawn.
TEST_F(RudeCallersTest, ExactFramesWaitForTheClientToShowThem) {
  const Running running = Start();
  Stream rude(channel_, "");
  const base::MonotonicTime begin = base::MonotonicNow();
  const int frames =
      rude.CountFor(FrameRequest(), absl::Milliseconds(5), &v1::InteractResponse::is_exact);
  const double seconds = absl::ToDoubleSeconds(base::MonotonicNow() - begin);
  RecordProperty("exact_frames", frames);
  EXPECT_GE(frames, 1);
  EXPECT_LE(frames, 2 * seconds + 8) << "none of them shown";
}

// Symptom: wrong states cost neither a place nor a frame of the rate.
TEST_F(RudeCallersTest, WrongStatesCountAgainstTheRate) {
  WriteTokens({TokenEntry("limited", R"("max_frames_per_second": 0.001)")});
  const Running running = Start();
  Stream rude(channel_, "limited");
  v1::InteractResponse response;
  for (const absl::StatusCode code :
       {absl::StatusCode::kInvalidArgument, absl::StatusCode::kInvalidArgument, kRefused}) {
    ASSERT_TRUE(rude.Send(InvalidState()));
    ASSERT_TRUE(rude.Read(&response));
    EXPECT_EQ(response.error().code(), static_cast<int>(code)) << response.error().message();
  }
}

// Symptom: 256 streams for all callers together; the first caller could take all of them.
TEST_F(RudeCallersTest, ACallerWithAllStreamsGivesOneToAnother) {
  WriteTokens({TokenEntry("rude"), TokenEntry("other")});
  const Running running = Start();
  std::vector<std::unique_ptr<Stream>> streams;
  v1::InteractResponse response;
  for (int i = 0; i < 256; ++i) {
    streams.push_back(std::make_unique<Stream>(channel_, "rude"));
    ASSERT_TRUE(streams.back()->Send(FrameRequest()));
    ASSERT_TRUE(streams.back()->Read(&response));
  }
  Stream other(channel_, "other");
  ASSERT_TRUE(other.Send(FrameRequest()));
  EXPECT_TRUE(other.Read(&response)) << other.Finish();
  EXPECT_THAT(streams.back()->Finish(), StatusIs(kRefused, HasSubstr("made room")));
  Stream one_more(channel_, "rude");
  EXPECT_THAT(one_more.Finish(), StatusIs(kRefused, HasSubstr("interactive streams are open")));
}

// Symptom: the rights of a token were looked at when a message came. What sent none kept them.
TEST_F(RudeCallersTest, AWithdrawnTokenEndsItsExportsAndIdleStreams) {
  WriteTokens({TokenEntry("leaver"), TokenEntry("stayer")});
  const Running running = Start();
  testing::Export mesh = ExportAs("leaver");
  ASSERT_TRUE(mesh.Read());
  Stream view(channel_, "leaver");
  Stream other(channel_, "stayer");
  v1::InteractResponse response;
  for (Stream* stream : {&view, &other}) {
    ASSERT_TRUE(stream->Send(FrameRequest()));
    ASSERT_TRUE(stream->Read(&response));
  }
  WriteTokens({TokenEntry("stayer")});
  std::atomic<bool> is_over{false};
  std::thread guard([&] {
    WaitFor([&] { return is_over.load(); });
    view.Cancel();
  });
  EXPECT_THAT(view.Finish(), StatusIs(absl::StatusCode::kUnauthenticated, HasSubstr("withdrawn")));
  EXPECT_THAT(mesh.Finish(), StatusIs(absl::StatusCode::kUnauthenticated, HasSubstr("withdrawn")));
  is_over.store(true);
  guard.join();
  ASSERT_TRUE(other.Send(FrameRequest()));
  EXPECT_TRUE(other.Read(&response)) << "another's stream goes on";
}

TEST_F(RudeCallersTest, AnExportWhoseClientIsTooSlowEndsAndSaysWhy) {
  options_.export_limits.allowance = absl::Milliseconds(100);
  options_.export_limits.least_bytes_per_second = std::size_t{1} << 30;
  const Running running = Start();
  testing::Export slow = ExportAs("");
  ASSERT_TRUE(slow.Read());
  EXPECT_TRUE(WaitFor([&] { return Metric("isoscope_cut_calls_total", "too_slow") == 1; }));
  EXPECT_THAT(slow.Finish(), StatusIs(absl::StatusCode::kDeadlineExceeded,
                                      HasSubstr("its client took less than 1073741824 bytes")));
  EXPECT_TRUE(WaitFor([&] { return Metric("isoscope_export_memory_bytes") == 0; }));
}

TEST_F(RudeCallersTest, AnExportHasALimitOfTime) {
  options_.export_limits.max_duration = absl::Seconds(3);  // the agent is asked within it
  std::atomic<int> cancelled_count{0};
  first_.on_surface = [&](grpc::ServerContext* context, FakeAgent::SurfaceWriter*) {
    return testing::HangUntilCancelled(context, &cancelled_count);
  };
  const Running running = Start();
  EXPECT_THAT(ExportAs("").Finish(),
              StatusIs(absl::StatusCode::kDeadlineExceeded,
                       AllOf(HasSubstr("it took 3s"), HasSubstr("--max-export-seconds"))));
  EXPECT_EQ(Metric("isoscope_cut_calls_total", "too_long"), 1);
  first_.Stop();
  EXPECT_EQ(cancelled_count, 1);
}

TEST_F(RudeCallersTest, TheLimitsOfATokenRefuseAndAreCounted) {
  WriteTokens(
      {TokenEntry("limited", R"("max_streams": 1, "max_exports": 1, "max_concurrent_frames": 1)"),
       TokenEntry("poor", R"("max_bytes_per_second": 0.1)"), TokenEntry("free")});
  HeldFrames held(&second_, /*is_holding=*/false);
  const Running running = Start();
  const auto refused = [](const std::string& part) {
    return StatusIs(kRefused, AllOf(HasSubstr("\"limited\""), HasSubstr(part)));
  };
  {
    testing::Export mesh = ExportAs("limited");
    ASSERT_TRUE(mesh.Read());
    EXPECT_THAT(ExportAs("limited").Finish(), refused("1 exports at a time"));
    testing::Export other = ExportAs("free");
    EXPECT_TRUE(other.Read());
    EXPECT_THAT(mesh.Finish(), IsOk());
  }
  EXPECT_THAT(ExportAs("limited").Finish(), IsOk()) << "the place is free again";

  v1::InteractResponse response;
  Stream view(channel_, "limited");
  ASSERT_TRUE(view.Send(FrameRequest()));
  ASSERT_TRUE(view.Read(&response));
  EXPECT_THAT(Stream(channel_, "limited").Finish(), refused("1 interactive streams at a time"));

  held.Hold();
  std::thread client([&] { EXPECT_THAT(RenderAs("limited"), IsOk()); });
  EXPECT_TRUE(AwaitFrames(/*working=*/1, /*queued=*/0));
  const absl::Status second = RenderAs("limited");
  EXPECT_THAT(second, refused("1 frames at a time"));
  EXPECT_TRUE(base::RetryDelayOf(second).has_value());
  held.Release();
  client.join();
  EXPECT_THAT(RenderAs("limited"), IsOk());

  EXPECT_THAT(RenderAs("poor"), IsOk()) << "what comes is not known before";
  EXPECT_THAT(RenderAs("poor"),
              StatusIs(kRefused, AllOf(HasSubstr("0.1 bytes a second"), HasSubstr("retry in"))));
  EXPECT_THAT(ExportAs("poor").Finish(), StatusIs(kRefused, HasSubstr("bytes a second")));
  for (const char* limit : {"exports", "streams", "frames"}) {
    EXPECT_EQ(Metric("isoscope_token_refusals_total", limit), 1) << limit;
  }
  EXPECT_EQ(Metric("isoscope_token_refusals_total", "bytes"), 2);
}

TEST_F(RudeCallersTest, MovingFramesLeaveOutTheAgentsAndExactOnesKeepThem) {
  const Running running = Start();
  Stream stream(channel_, "");
  ASSERT_TRUE(stream.Send(FrameRequest(), /*is_at_rest=*/false));
  v1::InteractResponse response;
  ASSERT_TRUE(stream.Read(&response));
  ASSERT_FALSE(response.is_exact());
  EXPECT_EQ(response.frame().statistics().agents_size(), 0);
  EXPECT_EQ(response.frame().statistics().triangle_count(), 14) << "totals stay";
  EXPECT_TRUE(response.frame().statistics().durations().has_encode_duration());
  ASSERT_TRUE(stream.Read(&response));
  ASSERT_TRUE(response.is_exact());
  EXPECT_EQ(response.frame().statistics().agents_size(), 2);
}

}  // namespace
}  // namespace isoscope::server
