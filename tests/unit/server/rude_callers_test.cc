// Callers who are slow, rude or many, against agents of a script: what one of them does must not
// stop the others.

#include <algorithm>
#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/synchronization/mutex.h"
#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "gtest/gtest.h"

#include "core/base/retry_delay.h"
#include "core/rpc/grpc_status.h"
#include "core/rpc/peer.h"
#include "isoscope/v1/dataset_service.grpc.pb.h"
#include "isoscope/v1/interact_service.grpc.pb.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "isoscope/v1/trace.pb.h"
#include "server/access/access_tokens.h"
#include "server/coordinator_server.h"
#include "tests/support/certificates.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/server/fake_agent.h"

namespace isoscope::server {
namespace {

namespace internal = isoscope::internal::v1;
namespace v1 = isoscope::v1;

using ::testing::AllOf;
using testing::FakeAgent;
using ::testing::HasSubstr;
using testing::IsOk;
using testing::MakeShard;
using testing::PlayEmptyFrame;
using testing::StatusIs;

// A guard against a hang; nothing is measured by it.
constexpr absl::Duration kLimit = absl::Seconds(20);

v1::RenderIsosurfaceRequest Request(int width = 32, int height = 16) {
  v1::RenderIsosurfaceRequest request;
  request.set_dataset("head");
  request.set_isovalue(100);
  request.mutable_viewport()->set_width_px(width);
  request.mutable_viewport()->set_height_px(height);
  return request;
}

bool WaitFor(const std::function<bool()>& condition) {
  const absl::Time end = absl::Now() + kLimit;
  while (!condition() && absl::Now() < end) {
    absl::SleepFor(absl::Milliseconds(1));
  }
  return condition();
}

std::string Entry(const std::string& token, const std::string& limits = "") {
  return absl::StrCat(R"({"name": ")", token, R"(", "sha256": ")",
                      absl::BytesToHexString(DigestOfToken(token)), R"(", "datasets": ["*"])",
                      limits.empty() ? "" : ", ", limits, "}");
}

// The mesh of blocks, 1.2 MiB each.
grpc::Status WriteLargeSurface(std::int64_t first_block, std::int64_t end_block,
                               FakeAgent::SurfaceWriter* writer) {
  constexpr int kTriangles = 100'000;
  for (std::int64_t id = first_block; id < end_block; ++id) {
    internal::ExtractSurfaceResponse message;
    internal::BlockSurface* block = message.add_blocks();
    block->set_block_id(id);
    const std::vector<float> positions = {1, 1, 1.5F, 2, 1, 1.5F, 1, 2, 1.5F};
    const std::int64_t edge = 3 * (91 + 20 * id) + 2;
    const std::vector<std::int64_t> keys = {edge, edge + 3, edge + 27};
    std::vector<std::uint32_t> triangles;
    for (int i = 0; i < kTriangles; ++i) {
      triangles.insert(triangles.end(), {0, 1, 2});
    }
    block->set_positions(positions.data(), positions.size() * sizeof(float));
    block->set_normals(positions.data(), positions.size() * sizeof(float));
    block->set_edge_keys(keys.data(), keys.size() * sizeof(std::int64_t));
    block->set_triangles(triangles.data(), triangles.size() * sizeof(std::uint32_t));
    if (!writer->Write(message)) {
      return grpc::Status::CANCELLED;
    }
  }
  return grpc::Status::OK;
}

// Two agents with a shard each, and the tokens that a test wants.
class RudeCallersTest : public ::testing::Test {
 protected:
  void SetUp() override {
    for (FakeAgent* agent : {&first_, &second_}) {
      agent->on_frame = [](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
        return PlayEmptyFrame(stream);
      };
    }
    first_.on_surface = [](grpc::ServerContext*, FakeAgent::SurfaceWriter* writer) {
      return WriteLargeSurface(0, 4, writer);
    };
    second_.on_surface = [](grpc::ServerContext*, FakeAgent::SurfaceWriter* writer) {
      return WriteLargeSurface(4, 8, writer);
    };
    options_.poll_interval = absl::Hours(1);
  }

  void WriteTokens(const std::vector<std::string>& entries) {
    testing::ReplaceFile(folder_.Sub("tokens.json"),
                         absl::StrCat(R"({"tokens": [)", absl::StrJoin(entries, ","), "]}"));
    options_.token_file = folder_.Sub("tokens.json");
  }

  void StartCluster() {
    first_.Start();
    second_.Start();
    options_.agents = {{first_.address(), nullptr}, {second_.address(), nullptr}};
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(coordinator_, CoordinatorServer::Start(options_));
    ISOSCOPE_ASSERT_OK(coordinator_->WaitUntilReady(absl::Now() + kLimit));
    channel_ = coordinator_->InProcessChannel();
    stub_ = v1::IsosurfaceService::NewStub(channel_);
  }

  absl::Status Render(const std::string& token, const v1::RenderIsosurfaceRequest& request,
                      absl::Duration timeout = kLimit) {
    grpc::ClientContext context;
    context.set_deadline(absl::ToChronoTime(absl::Now() + timeout));
    rpc::SendToken(token, &context);
    v1::RenderIsosurfaceResponse response;
    return rpc::ToAbslStatus(stub_->RenderIsosurface(&context, request, &response));
  }

  // Returns the value of a metric, of the sample with this label value if one is given.
  double Metric(const std::string& name, const std::string& label = "") {
    for (const base::MetricFamily& family : coordinator_->CollectMetrics()) {
      for (const base::MetricSample& sample : family.samples) {
        const bool is_wanted =
            label.empty() || std::any_of(sample.labels.begin(), sample.labels.end(),
                                         [&](const auto& one) { return one.second == label; });
        if (family.name == name && is_wanted) {
          return sample.value;
        }
      }
    }
    ADD_FAILURE() << "no metric " << name << " " << label;
    return -1;
  }

  testing::TempDir folder_;
  FakeAgent first_{{MakeShard("head", 0, 2)}};
  FakeAgent second_{{MakeShard("head", 1, 2)}};
  CoordinatorServerOptions options_;
  std::unique_ptr<CoordinatorServer> coordinator_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::IsosurfaceService::Stub> stub_;
};

// One export, which a test reads chunk by chunk.
class Export {
 public:
  Export(v1::IsosurfaceService::Stub* stub, const std::string& token) {
    rpc::SendToken(token, &context_);
    v1::ExportIsosurfaceRequest request;
    request.set_dataset("head");
    request.set_isovalue(100);
    reader_ = stub->ExportIsosurface(&context_, request);
  }
  ~Export() {
    if (!is_finished_) {
      context_.TryCancel();
      Finish().IgnoreError();
    }
  }
  bool Read() {
    v1::ExportIsosurfaceResponse chunk;
    return reader_->Read(&chunk);
  }
  absl::Status Finish() {
    while (Read()) {
    }
    is_finished_ = true;
    return rpc::ToAbslStatus(reader_->Finish());
  }

 private:
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReader<v1::ExportIsosurfaceResponse>> reader_;
  bool is_finished_ = false;
};

// One interactive stream.
class Stream {
 public:
  Stream(const std::shared_ptr<grpc::Channel>& channel, const std::string& token)
      : stub_(v1::InteractService::NewStub(channel)) {
    context_.set_deadline(absl::ToChronoTime(absl::Now() + 3 * kLimit));
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
  v1::RenderIsosurfaceRequest frame = Request();
  frame.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_JPEG);
  return frame;
}

// Symptom: an export reserved the memory of frames, and a client that took no chunk kept it.
TEST_F(RudeCallersTest, ASlowReaderOfAnExportDoesNotStopFrames) {
  options_.memory_limit_bytes = std::size_t{96} * 1024 * 1024;
  StartCluster();
  Export slow(stub_.get(), "");
  ASSERT_TRUE(slow.Read());
  absl::SleepFor(absl::Milliseconds(200));  // until all that may wait for it does
  for (int i = 0; i < 3; ++i) {
    EXPECT_THAT(Render("", Request(1024, 1024), absl::Seconds(10)), IsOk()) << i;
  }
  EXPECT_TRUE(slow.Read()) << "the export goes on";
}

// Symptom: of 80 agents and 1 GiB an export took the memory of all frames. It streams from eight.
TEST_F(RudeCallersTest, ASlowReaderOfAnExportOfEightyAgentsLeavesFramesTheirMemory) {
  constexpr int kAgentCount = 80;
  constexpr int kBlockCount = 8;
  std::vector<std::unique_ptr<FakeAgent>> agents;
  options_.agents.clear();
  for (int i = 0; i < kAgentCount; ++i) {
    agents.push_back(std::make_unique<FakeAgent>(
        std::vector<internal::ShardDescription>{MakeShard("head", i, kAgentCount)}));
    agents.back()->on_frame = [](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
      return PlayEmptyFrame(stream);
    };
    agents.back()->on_surface = [i](grpc::ServerContext*, FakeAgent::SurfaceWriter* writer) {
      return i < kBlockCount ? WriteLargeSurface(i, i + 1, writer) : grpc::Status::OK;
    };
    agents.back()->Start();
    options_.agents.push_back({agents.back()->address(), nullptr});
  }
  options_.memory_limit_bytes = std::size_t{1024} * 1024 * 1024;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(coordinator_, CoordinatorServer::Start(options_));
  ISOSCOPE_ASSERT_OK(coordinator_->WaitUntilReady(absl::Now() + kLimit));
  stub_ = v1::IsosurfaceService::NewStub(coordinator_->InProcessChannel());
  Export slow(stub_.get(), "");
  ASSERT_TRUE(slow.Read());
  EXPECT_GT(Metric("isoscope_export_memory_bytes"), 0);
  EXPECT_LE(Metric("isoscope_export_memory_bytes"), 128 * 1024 * 1024);
  EXPECT_EQ(Metric("isoscope_frame_memory_bytes"), 0);
  for (int i = 0; i < 3; ++i) {
    EXPECT_THAT(Render("", Request(2048, 2048)), IsOk()) << i;
  }
  EXPECT_THAT(slow.Finish(), IsOk());
  EXPECT_TRUE(WaitFor([&] { return Metric("isoscope_export_memory_bytes") == 0; }));
  coordinator_.reset();  // before the agents
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
  StartCluster();
  v1::RenderIsosurfaceRequest request = Request(1200, 1200);
  EXPECT_THAT(Render("", request), IsOk());
  request.set_with_trace(true);
  EXPECT_THAT(Render("", request),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("or for no trace")));

  request = Request();
  request.set_with_trace(true);
  grpc::ClientContext context;
  v1::RenderIsosurfaceResponse response;
  ASSERT_THAT(rpc::ToAbslStatus(stub_->RenderIsosurface(&context, request, &response)), IsOk());
  ASSERT_EQ(response.trace().processes_size(), 3);
  int of_both_agents = 0;
  for (int i = 1; i < 3; ++i) {
    const v1::ProcessTrace& of_agent = response.trace().processes(i);
    const int kept = of_agent.tracks(0).spans_size();
    EXPECT_GT(kept, 0);
    EXPECT_EQ(kept + of_agent.dropped_span_count(), kSpanCount);
    of_both_agents += kept;
  }
  EXPECT_LT(of_both_agents, 12 * 1024 * 1024 / 320) << "an eighth of the limit, 320 bytes a span";
}

// Symptom: the bytes of image, occlusion map and bands stayed reserved until the client had taken
// the last part.
TEST_F(RudeCallersTest, AFrameThatIsBeingSentReservesOnlyItsResponse) {
  StartCluster();
  grpc::ClientContext context;
  v1::RenderIsosurfaceStreamRequest request;
  *request.mutable_request() = Request(1024, 1024);
  request.mutable_request()->mutable_output()->set_image_format(
      v1::OutputOptions::IMAGE_FORMAT_RGBA8);
  const auto reader = stub_->RenderIsosurfaceStream(&context, request);
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
  absl::Notification release;
  std::atomic<bool> is_held{false};
  second_.on_frame = [&](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
    if (is_held.load()) {
      release.WaitForNotification();
    }
    return PlayEmptyFrame(stream);
  };
  options_.max_concurrent_frames = 1;
  options_.max_queued_frames = 2;
  WriteTokens({Entry("rude", R"("max_frames_per_second": 0.001)"), Entry("patient")});
  StartCluster();
  EXPECT_THAT(Render("rude", Request()), IsOk());
  EXPECT_THAT(Render("rude", Request()), IsOk());
  is_held.store(true);
  std::vector<absl::Status> ends(3);
  std::vector<std::thread> clients;
  for (absl::Status& end : ends) {
    clients.emplace_back([&] { end = Render("patient", Request()); });
  }
  EXPECT_TRUE(WaitFor([&] {
    return Metric("isoscope_admission_frames", "working") == 1 &&
           Metric("isoscope_admission_frames", "queued") == 2;
  }));
  EXPECT_THAT(Render("rude", Request()),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("frames a second")));
  release.Notify();
  for (std::thread& client : clients) {
    client.join();
  }
  for (const absl::Status& end : ends) {
    EXPECT_THAT(end, IsOk());
  }
}

TEST_F(RudeCallersTest, ARefusedFrameIsNotCountedAgainstTheRate) {
  absl::Notification release;
  std::atomic<bool> is_held{true};
  second_.on_frame = [&](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
    if (is_held.load()) {
      release.WaitForNotification();
    }
    return PlayEmptyFrame(stream);
  };
  options_.max_concurrent_frames = 1;
  options_.max_queued_frames = 0;
  WriteTokens({Entry("limited", R"("max_frames_per_second": 0.001)"), Entry("other")});
  StartCluster();
  std::thread client([&] { EXPECT_THAT(Render("other", Request()), IsOk()); });
  EXPECT_TRUE(WaitFor([&] { return Metric("isoscope_admission_frames", "working") == 1; }));
  for (int i = 0; i < 4; ++i) {
    EXPECT_THAT(Render("limited", Request()),
                StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("frames are in work")));
  }
  is_held.store(false);
  release.Notify();
  client.join();
  EXPECT_THAT(Render("limited", Request()), IsOk());
  EXPECT_THAT(Render("limited", Request()), IsOk());
  EXPECT_THAT(Render("limited", Request()),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("frames a second")));
}

TEST_F(RudeCallersTest, ExportsCountAgainstTheRate) {
  WriteTokens({Entry("limited", R"("max_frames_per_second": 0.001)")});
  StartCluster();
  for (int i = 0; i < 2; ++i) {
    EXPECT_THAT(Export(stub_.get(), "limited").Finish(), IsOk());
  }
  EXPECT_THAT(Export(stub_.get(), "limited").Finish(),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("frames a second")));
}

// Symptom: histograms waited in one queue for all, and one caller's hundred came before another's.
TEST_F(RudeCallersTest, HistogramsOfCallersTakeTurns) {
  constexpr int kOfTheOther = 7;  // bins, by which the agent knows whose histogram it is
  constexpr int kRude = 20;
  absl::Notification release;
  absl::Mutex mutex;
  std::vector<int> asked;
  first_.on_histogram = [&](grpc::ServerContext*, const internal::GetShardHistogramRequest& request,
                            internal::GetShardHistogramResponse*) {
    {
      const absl::MutexLock lock(&mutex);
      asked.push_back(request.max_bin_count());
    }
    release.WaitForNotification();
    return grpc::Status(grpc::StatusCode::DATA_LOSS, "a script");
  };
  second_.on_histogram = first_.on_histogram;
  WriteTokens({Entry("rude"), Entry("other")});
  StartCluster();
  const auto stub = v1::DatasetService::NewStub(channel_);
  const auto ask = [&](const std::string& token, int bins) {
    grpc::ClientContext context;
    rpc::SendToken(token, &context);
    v1::GetHistogramRequest request;
    request.set_dataset("head");
    request.set_max_bin_count(bins);
    v1::GetHistogramResponse response;
    return stub->GetHistogram(&context, request, &response);
  };
  std::vector<std::thread> clients;
  for (int i = 0; i < kRude; ++i) {
    clients.emplace_back([&] { ask("rude", 100); });
  }
  EXPECT_TRUE(WaitFor([&] {
    const absl::MutexLock lock(&mutex);
    return !asked.empty();
  }));
  absl::SleepFor(absl::Milliseconds(200));  // until the others wait
  clients.emplace_back([&] { ask("other", kOfTheOther); });
  absl::SleepFor(absl::Milliseconds(200));
  release.Notify();
  for (std::thread& client : clients) {
    client.join();
  }
  const auto first = std::find(asked.begin(), asked.end(), kOfTheOther);
  ASSERT_NE(first, asked.end());
  const std::ptrdiff_t before = first - asked.begin();
  RecordProperty("agents_asked_before", static_cast<int>(before));
  // Two agents, two histograms in work, and one turn of the rude caller.
  EXPECT_LE(before, 8) << "of " << asked.size();
}

// Symptom: a client that sent nothing but wrong states got an error for each, read or not.
TEST_F(RudeCallersTest, WrongStatesGetFewErrors) {
  StartCluster();
  Stream rude(channel_, "");
  std::atomic<int> errors{0};
  std::thread reader([&] {
    v1::InteractResponse response;
    while (rude.Read(&response)) {
      errors += response.has_error() ? 1 : 0;
    }
  });
  int states = 0;
  const absl::Time begin = absl::Now();
  while (absl::Now() < begin + absl::Seconds(1) && rude.Send(InvalidState())) {
    ++states;
  }
  rude.Cancel();
  reader.join();
  const double seconds = absl::ToDoubleSeconds(absl::Now() - begin);
  RecordProperty("states", states);
  RecordProperty("errors", errors.load());
  EXPECT_GE(errors.load(), 1);
  EXPECT_LE(errors.load(), 10 * seconds + 5) << "for " << states << " states";
}

// Symptom: exact frames needed no acknowledgement, and a client that never gave one got as many as
// could be drawn.
TEST_F(RudeCallersTest, ExactFramesWaitForTheClientToShowThem) {
  StartCluster();
  Stream rude(channel_, "");
  std::atomic<int> frames{0};
  std::thread reader([&] {
    v1::InteractResponse response;
    while (rude.Read(&response)) {
      frames += response.is_exact() ? 1 : 0;
    }
  });
  const absl::Time end = absl::Now() + absl::Seconds(1);
  while (absl::Now() < end && rude.Send(Request())) {
    absl::SleepFor(absl::Milliseconds(5));
  }
  rude.Cancel();
  reader.join();
  RecordProperty("exact_frames", frames.load());
  EXPECT_GE(frames.load(), 1);
  EXPECT_LE(frames.load(), 10) << "in a second or so, none of them shown";
}

// Symptom: wrong states cost neither a place nor a frame of the rate.
TEST_F(RudeCallersTest, WrongStatesCountAgainstTheRate) {
  WriteTokens({Entry("limited", R"("max_frames_per_second": 0.001)")});
  StartCluster();
  Stream rude(channel_, "limited");
  v1::InteractResponse response;
  for (const absl::StatusCode code :
       {absl::StatusCode::kInvalidArgument, absl::StatusCode::kInvalidArgument,
        absl::StatusCode::kResourceExhausted}) {
    ASSERT_TRUE(rude.Send(InvalidState()));
    ASSERT_TRUE(rude.Read(&response));
    EXPECT_EQ(response.error().code(), static_cast<int>(code)) << response.error().message();
  }
}

// Symptom: 256 streams for all callers together; whoever came first had them all.
TEST_F(RudeCallersTest, ACallerWithAllStreamsGivesOneToAnother) {
  WriteTokens({Entry("rude"), Entry("other")});
  StartCluster();
  std::vector<std::unique_ptr<Stream>> streams;
  v1::InteractResponse response;
  for (int i = 0; i < 256; ++i) {
    streams.push_back(std::make_unique<Stream>(channel_, "rude"));
    ASSERT_TRUE(streams.back()->Send(Request()));
    ASSERT_TRUE(streams.back()->Read(&response));
  }
  Stream other(channel_, "other");
  ASSERT_TRUE(other.Send(Request()));
  EXPECT_TRUE(other.Read(&response)) << other.Finish();
  EXPECT_THAT(streams.back()->Finish(),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("made room")));
  Stream one_more(channel_, "rude");
  EXPECT_THAT(one_more.Finish(), StatusIs(absl::StatusCode::kResourceExhausted,
                                          HasSubstr("interactive streams are open")));
}

// Symptom: the rights of a token were looked at when a message came. What sent none kept them.
TEST_F(RudeCallersTest, AWithdrawnTokenEndsItsExportsAndIdleStreams) {
  WriteTokens({Entry("leaver"), Entry("stayer")});
  StartCluster();
  Export mesh(stub_.get(), "leaver");
  ASSERT_TRUE(mesh.Read());
  Stream view(channel_, "leaver");
  Stream other(channel_, "stayer");
  v1::InteractResponse response;
  for (Stream* stream : {&view, &other}) {
    ASSERT_TRUE(stream->Send(Request()));
    ASSERT_TRUE(stream->Read(&response));
  }
  WriteTokens({Entry("stayer")});
  std::atomic<bool> is_over{false};
  std::thread guard([&] {
    WaitFor([&] { return is_over.load(); });
    view.Cancel();
  });
  EXPECT_THAT(view.Finish(), StatusIs(absl::StatusCode::kUnauthenticated, HasSubstr("withdrawn")));
  EXPECT_THAT(mesh.Finish(), StatusIs(absl::StatusCode::kUnauthenticated, HasSubstr("withdrawn")));
  is_over.store(true);
  guard.join();
  ASSERT_TRUE(other.Send(Request()));
  EXPECT_TRUE(other.Read(&response)) << "another's stream goes on";
}

TEST_F(RudeCallersTest, AnExportWhoseClientIsTooSlowEndsAndSaysWhy) {
  options_.export_limits.allowance = absl::Milliseconds(100);
  options_.export_limits.least_bytes_per_second = std::size_t{1} << 30;
  StartCluster();
  Export slow(stub_.get(), "");
  ASSERT_TRUE(slow.Read());
  EXPECT_TRUE(WaitFor([&] { return Metric("isoscope_cut_calls_total", "too_slow") == 1; }));
  EXPECT_THAT(slow.Finish(), StatusIs(absl::StatusCode::kDeadlineExceeded,
                                      HasSubstr("its client took less than 1073741824 bytes")));
  EXPECT_TRUE(WaitFor([&] { return Metric("isoscope_export_memory_bytes") == 0; }));
}

TEST_F(RudeCallersTest, AnExportHasALimitOfTime) {
  options_.export_limits.max_duration = absl::Milliseconds(300);
  first_.on_surface = [](grpc::ServerContext* context, FakeAgent::SurfaceWriter*) {
    EXPECT_TRUE(WaitFor([&] { return context->IsCancelled(); }));
    return grpc::Status::CANCELLED;
  };
  StartCluster();
  EXPECT_THAT(Export(stub_.get(), "").Finish(),
              StatusIs(absl::StatusCode::kDeadlineExceeded,
                       AllOf(HasSubstr("it took 300ms"), HasSubstr("--max-export-seconds"))));
  EXPECT_EQ(Metric("isoscope_cut_calls_total", "too_long"), 1);
  first_.Stop();
}

TEST_F(RudeCallersTest, TheLimitsOfATokenRefuseAndAreCounted) {
  WriteTokens(
      {Entry("limited", R"("max_streams": 1, "max_exports": 1, "max_concurrent_frames": 1)"),
       Entry("poor", R"("max_bytes_per_second": 0.1)"), Entry("free")});
  absl::Notification release;
  std::atomic<bool> is_held{false};
  second_.on_frame = [&](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
    if (is_held.load()) {
      release.WaitForNotification();
    }
    return PlayEmptyFrame(stream);
  };
  StartCluster();
  const auto refused = [](const std::string& part) {
    return StatusIs(absl::StatusCode::kResourceExhausted,
                    AllOf(HasSubstr("\"limited\""), HasSubstr(part)));
  };
  {
    Export mesh(stub_.get(), "limited");
    ASSERT_TRUE(mesh.Read());
    EXPECT_THAT(Export(stub_.get(), "limited").Finish(), refused("1 exports at a time"));
    Export other(stub_.get(), "free");
    EXPECT_TRUE(other.Read());
    EXPECT_THAT(mesh.Finish(), IsOk());
  }
  EXPECT_THAT(Export(stub_.get(), "limited").Finish(), IsOk()) << "the place is free again";

  v1::InteractResponse response;
  Stream view(channel_, "limited");
  ASSERT_TRUE(view.Send(Request()));
  ASSERT_TRUE(view.Read(&response));
  EXPECT_THAT(Stream(channel_, "limited").Finish(), refused("1 interactive streams at a time"));

  is_held.store(true);
  std::thread client([&] { EXPECT_THAT(Render("limited", Request()), IsOk()); });
  EXPECT_TRUE(WaitFor([&] { return Metric("isoscope_admission_frames", "working") == 1; }));
  const absl::Status second = Render("limited", Request());
  EXPECT_THAT(second, refused("1 frames at a time"));
  EXPECT_TRUE(base::RetryDelayOf(second).has_value());
  is_held.store(false);
  release.Notify();
  client.join();
  EXPECT_THAT(Render("limited", Request()), IsOk());

  EXPECT_THAT(Render("poor", Request()), IsOk()) << "what comes is not known before";
  EXPECT_THAT(Render("poor", Request()),
              StatusIs(absl::StatusCode::kResourceExhausted,
                       AllOf(HasSubstr("0.1 bytes a second"), HasSubstr("retry in"))));
  EXPECT_THAT(Export(stub_.get(), "poor").Finish(),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("bytes a second")));
  EXPECT_EQ(Metric("isoscope_token_refusals_total", "exports"), 1);
  EXPECT_EQ(Metric("isoscope_token_refusals_total", "streams"), 1);
  EXPECT_EQ(Metric("isoscope_token_refusals_total", "frames"), 1);
  EXPECT_EQ(Metric("isoscope_token_refusals_total", "bytes"), 2);
}

TEST_F(RudeCallersTest, MovingFramesLeaveOutTheAgentsAndExactOnesKeepThem) {
  StartCluster();
  Stream stream(channel_, "");
  ASSERT_TRUE(stream.Send(Request(), /*is_at_rest=*/false));
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
