// The public service against agents of a script: what goes wrong on an agent, and what clients see.

#include <algorithm>
#include <atomic>
#include <limits>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/synchronization/mutex.h"
#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/retry_delay.h"
#include "core/image/png_codec.h"
#include "core/rpc/grpc_status.h"
#include "isoscope/v1/cluster_service.grpc.pb.h"
#include "isoscope/v1/dataset_service.grpc.pb.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "proto/message_checksum.h"
#include "server/access/access_tokens.h"
#include "server/admission/coordinator_memory.h"
#include "server/coordinator_server.h"
#include "tests/support/certificates.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/server/fake_agent.h"

namespace isoscope::server {
namespace {

namespace internal = isoscope::internal::v1;

using ::testing::AllOf;
using testing::FakeAgent;
using ::testing::HasSubstr;
using testing::IsOk;
using testing::MakeShard;
using ::testing::Not;
using testing::PlayEmptyFrame;
using testing::StatusIs;

// Waits until the coordinator cancels, for as long as any test may take.
bool WaitUntilCancelled(grpc::ServerContext* context) {
  const absl::Time limit = absl::Now() + absl::Seconds(20);
  while (!context->IsCancelled() && absl::Now() < limit) {
    absl::SleepFor(absl::Milliseconds(2));
  }
  return context->IsCancelled();
}

isoscope::v1::RenderIsosurfaceRequest Request() {
  isoscope::v1::RenderIsosurfaceRequest request;
  request.set_dataset("head");
  request.set_isovalue(100);
  request.mutable_viewport()->set_width_px(32);
  request.mutable_viewport()->set_height_px(16);
  return request;
}

// Two agents with a shard each; the first one behaves unless a test says otherwise.
class IsosurfaceServiceTest : public ::testing::Test {
 protected:
  void SetUp() override {
    for (FakeAgent* agent : {&first_, &second_}) {
      agent->on_frame = [](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
        return PlayEmptyFrame(stream);
      };
    }
    options_.poll_interval = absl::Hours(1);
  }

  void StartCluster() {
    first_.Start();
    second_.Start();
    options_.agents = {{first_.address(), nullptr}, {second_.address(), nullptr}};
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(coordinator_, CoordinatorServer::Start(options_));
    ISOSCOPE_ASSERT_OK(coordinator_->WaitUntilReady(absl::Now() + absl::Seconds(20)));
    channel_ = coordinator_->InProcessChannel();
    stub_ = isoscope::v1::IsosurfaceService::NewStub(channel_);
  }

  absl::StatusOr<isoscope::v1::RenderIsosurfaceResponse> Render(
      const isoscope::v1::RenderIsosurfaceRequest& request,
      absl::Duration timeout = absl::Seconds(20)) {
    grpc::ClientContext context;
    context.set_deadline(absl::ToChronoTime(absl::Now() + timeout));
    isoscope::v1::RenderIsosurfaceResponse response;
    const absl::Status status =
        rpc::ToAbslStatus(stub_->RenderIsosurface(&context, request, &response));
    if (!status.ok()) {
      return status;
    }
    return response;
  }

  FakeAgent first_{{MakeShard("head", 0, 2)}};
  FakeAgent second_{{MakeShard("head", 1, 2)}};
  CoordinatorServerOptions options_;
  std::unique_ptr<CoordinatorServer> coordinator_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<isoscope::v1::IsosurfaceService::Stub> stub_;
};

TEST_F(IsosurfaceServiceTest, AFrameWithoutSurfaceIsTheBackgroundAndSumsTheAgents) {
  StartCluster();
  isoscope::v1::RenderIsosurfaceRequest request = Request();
  request.mutable_background_color()->set_red(1);
  request.mutable_background_color()->set_alpha(1);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto response, Render(request));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::RgbaImage picture, image::DecodePng(response.png()));
  EXPECT_EQ(picture.width, 32);
  EXPECT_EQ(picture.height, 16);
  for (const image::Rgba8& pixel : picture.pixels) {
    ASSERT_EQ(pixel, (image::Rgba8{255, 0, 0, 255}));
  }
  const isoscope::v1::RenderStatistics& statistics = response.statistics();
  EXPECT_EQ(statistics.triangle_count(), 14);
  EXPECT_EQ(statistics.active_block_count(), 10);
  EXPECT_EQ(statistics.culled_block_count(), 4);
  EXPECT_EQ(statistics.png_bytes(), static_cast<std::int64_t>(response.png().size()));
  EXPECT_GT(statistics.network_bytes(), 0);
  ASSERT_EQ(statistics.agents_size(), 2);
  EXPECT_EQ(statistics.agents(0).agent_address(), first_.address());
  EXPECT_EQ(statistics.agents(1).shard_indices(0), 1);
  EXPECT_EQ(response.camera().perspective().fov_y_degrees(), 30);
}

TEST_F(IsosurfaceServiceTest, AgentsGetTheRequestAndTheirShare) {
  internal::BeginFrame begin;
  second_.on_frame = [&](grpc::ServerContext*, FakeAgent::FrameStream* stream) -> grpc::Status {
    internal::RenderFrameRequest request;
    stream->Read(&request);
    begin = request.begin();
    internal::RenderFrameResponse response;
    response.mutable_frame_done();
    stream->Write(response);
    return grpc::Status::OK;
  };
  StartCluster();
  isoscope::v1::RenderIsosurfaceRequest request = Request();
  request.set_culling(isoscope::v1::CULLING_NONE);
  request.set_ray_seed(77);
  request.mutable_camera()->mutable_eye()->set_z(0.1);
  request.mutable_camera()->mutable_target();
  request.mutable_camera()->mutable_perspective()->set_fov_y_degrees(33.3);
  ISOSCOPE_ASSERT_OK(Render(request));
  EXPECT_EQ(begin.dataset_id(), testing::kSomeId);
  EXPECT_EQ(begin.agent_index(), 1);
  EXPECT_EQ(begin.agent_count(), 2);
  ASSERT_EQ(begin.shard_indices_size(), 1);
  EXPECT_EQ(begin.shard_indices(0), 1);
  EXPECT_EQ(begin.request().ray_seed(), 77);
  EXPECT_EQ(begin.request().isovalue(), 100);
  // Bit for bit: every agent must compute the same view.
  EXPECT_EQ(begin.request().camera().perspective().fov_y_degrees(), 33.3);
  EXPECT_EQ(begin.request().camera().eye().z(), 0.1);
}

TEST_F(IsosurfaceServiceTest, AgentsAreAskedForActiveBlocksOncePerLevel) {
  // Each agent's answers are of its own, so that a list of another frame would show.
  absl::Mutex mutex;
  std::vector<bool> asked;
  std::vector<std::string> visible;
  const auto play = [&](std::int64_t first_block) {
    return [&, first_block](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
      internal::RenderFrameRequest request;
      internal::RenderFrameResponse response;
      stream->Read(&request);
      const bool is_asked = request.begin().report_active_blocks();
      response.mutable_ray_hits();
      if (is_asked) {
        auto* deltas = response.mutable_ray_hits()->mutable_active_blocks();
        deltas->add_block_id_deltas(first_block);
        deltas->add_block_id_deltas(2);
      }
      stream->Write(response);
      stream->Read(&request);
      response.mutable_occluders_done();
      stream->Write(response);
      stream->Read(&request);
      {
        absl::MutexLock lock(&mutex);
        asked.push_back(is_asked);
        visible.push_back(request.visible_blocks().blocks().ShortDebugString());
      }
      response.mutable_frame_done();
      stream->Write(response);
      return grpc::Status::OK;
    };
  };
  first_.on_frame = play(0);
  second_.on_frame = play(1);
  StartCluster();
  // True if both agents were asked, false if none was. What they are to draw must not depend on it.
  const auto render = [&](double isovalue) {
    {
      absl::MutexLock lock(&mutex);
      asked.clear();
      visible.clear();
    }
    isoscope::v1::RenderIsosurfaceRequest request = Request();
    request.set_isovalue(isovalue);
    EXPECT_THAT(Render(request), IsOk());
    absl::MutexLock lock(&mutex);
    EXPECT_EQ(asked.size(), 2U);
    EXPECT_EQ(asked.front(), asked.back());
    std::sort(visible.begin(), visible.end());
    EXPECT_EQ(visible, (std::vector<std::string>{"block_id_deltas: 0 block_id_deltas: 2",
                                                 "block_id_deltas: 1 block_id_deltas: 2"}));
    return static_cast<bool>(asked.front());
  };
  EXPECT_TRUE(render(100));
  EXPECT_FALSE(render(100));
  EXPECT_TRUE(render(101)) << "another level has other active blocks";
  EXPECT_FALSE(render(101));
  EXPECT_FALSE(render(100)) << "the first level was forgotten";
}

TEST_F(IsosurfaceServiceTest, BadRequestsAreRefusedNamingTheField) {
  StartCluster();
  const auto expect_bad = [this](const isoscope::v1::RenderIsosurfaceRequest& request,
                                 const std::string& field) {
    EXPECT_THAT(Render(request), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(field)));
  };
  isoscope::v1::RenderIsosurfaceRequest request = Request();
  request.set_isovalue(std::numeric_limits<double>::quiet_NaN());
  expect_bad(request, "isovalue");
  request = Request();
  request.clear_viewport();
  expect_bad(request, "viewport");
  request = Request();
  request.mutable_base_color()->set_green(0.5F);
  expect_bad(request, "base_color.alpha");
  request = Request();
  request.mutable_camera();
  expect_bad(request, "camera.eye");
  // A parameter of a newer version: without it the picture might be another one.
  request = Request();
  request.GetReflection()->MutableUnknownFields(&request)->AddVarint(99, 1);
  expect_bad(request, "number 99");
  request = Request();
  request.set_dataset("haed");
  EXPECT_THAT(Render(request), StatusIs(absl::StatusCode::kNotFound, HasSubstr("head")));
}

TEST_F(IsosurfaceServiceTest, AnAgentsErrorKeepsItsCodeAndNamesTheAgent) {
  for (const grpc::StatusCode code :
       {grpc::StatusCode::DATA_LOSS, grpc::StatusCode::INTERNAL,
        grpc::StatusCode::RESOURCE_EXHAUSTED, grpc::StatusCode::FAILED_PRECONDITION}) {
    first_.Stop();
    second_.Stop();
    second_.on_frame = [code](grpc::ServerContext*, FakeAgent::FrameStream*) -> grpc::Status {
      return {code, "block 1713 at offset 4096"};
    };
    StartCluster();
    EXPECT_THAT(Render(Request()),
                StatusIs(static_cast<absl::StatusCode>(code),
                         AllOf(HasSubstr(second_.address()), HasSubstr("shard 1"),
                               HasSubstr("block 1713 at offset 4096"))));
    coordinator_.reset();
  }
}

TEST_F(IsosurfaceServiceTest, AnAgentThatIsBusySaysWhenToComeAgain) {
  second_.on_frame = [](grpc::ServerContext*, FakeAgent::FrameStream*) {
    return rpc::ToGrpcStatus(base::WithRetryDelay(absl::ResourceExhaustedError("64 frames wait"),
                                                  absl::Milliseconds(700)));
  };
  StartCluster();
  const absl::Status status = Render(Request()).status();
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("64 frames wait")));
  EXPECT_EQ(base::RetryDelayOf(status), absl::Milliseconds(700));
}

TEST_F(IsosurfaceServiceTest, AnAgentThatRefusesTheCoordinatorsMessageIsNotTheClientsFault) {
  second_.on_frame = [](grpc::ServerContext*, FakeAgent::FrameStream*) -> grpc::Status {
    return {grpc::StatusCode::INVALID_ARGUMENT, "out of order"};
  };
  StartCluster();
  EXPECT_THAT(Render(Request()), StatusIs(absl::StatusCode::kInternal, HasSubstr("out of order")));
}

TEST_F(IsosurfaceServiceTest, AnAgentThatEndsTooEarlyOrSendsRubbishIsAnInternalError) {
  std::atomic<int> call_count{0};
  second_.on_frame = [&](grpc::ServerContext*, FakeAgent::FrameStream* stream) -> grpc::Status {
    if (call_count++ == 0) {
      return grpc::Status::OK;
    }
    internal::RenderFrameResponse response;
    response.mutable_ray_hits()->mutable_hits()->add_block_id_deltas(1'000'000);
    stream->Write(response);
    return grpc::Status::OK;
  };
  StartCluster();
  EXPECT_THAT(Render(Request()),
              StatusIs(absl::StatusCode::kInternal, HasSubstr(second_.address())));
  EXPECT_THAT(Render(Request()), StatusIs(absl::StatusCode::kInternal,
                                          AllOf(HasSubstr(second_.address()),
                                                HasSubstr("malformed"), HasSubstr("1000000"))));
}

TEST_F(IsosurfaceServiceTest, AMessageThatIsDamagedOnItsWayIsNotTheAgentsFault) {
  first_.on_surface = [](grpc::ServerContext*, FakeAgent::SurfaceWriter* writer) {
    internal::ExtractSurfaceResponse damaged;
    proto::ParseChecked(nullptr, &damaged);
    writer->Write(damaged);
    return grpc::Status::OK;
  };
  second_.on_surface = [](grpc::ServerContext*, FakeAgent::SurfaceWriter*) {
    return grpc::Status::OK;
  };
  second_.on_frame = [](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
    internal::RenderFrameResponse damaged;
    proto::ParseChecked(nullptr, &damaged);
    stream->Write(damaged);
    return grpc::Status::OK;
  };
  StartCluster();
  EXPECT_THAT(Render(Request()),
              StatusIs(absl::StatusCode::kUnavailable,
                       AllOf(HasSubstr(second_.address()), HasSubstr("CRC-32C"))));
  grpc::ClientContext context;
  const auto reader = stub_->ExportIsosurface(&context, {});
  isoscope::v1::ExportIsosurfaceResponse chunk;
  EXPECT_FALSE(reader->Read(&chunk));
  EXPECT_THAT(rpc::ToAbslStatus(reader->Finish()),
              StatusIs(absl::StatusCode::kUnavailable,
                       AllOf(HasSubstr(first_.address()), HasSubstr("CRC-32C"))));
}

TEST_F(IsosurfaceServiceTest, AnAgentThatDiesDuringTheFrameIsUnavailableNamingItsShards) {
  absl::Notification begun;
  second_.on_frame = [&](grpc::ServerContext* context, FakeAgent::FrameStream* stream) {
    internal::RenderFrameRequest request;
    stream->Read(&request);
    begun.Notify();
    WaitUntilCancelled(context);
    return grpc::Status::CANCELLED;
  };
  StartCluster();
  std::thread killer([&] {
    begun.WaitForNotification();
    second_.Stop();
  });
  EXPECT_THAT(Render(Request()),
              StatusIs(absl::StatusCode::kUnavailable,
                       AllOf(HasSubstr(second_.address()), HasSubstr("shard 1"))));
  killer.join();
  // The next frame asks again and says what is missing.
  EXPECT_THAT(Render(Request()),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       AllOf(HasSubstr("shard 1"), HasSubstr(second_.address()))));
  // And the one after the agent's return succeeds.
  second_.on_frame = [](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
    return PlayEmptyFrame(stream);
  };
  second_.Start(second_.port());
  EXPECT_THAT(Render(Request()), IsOk());
}

TEST_F(IsosurfaceServiceTest, AnAgentThatHangsEndsTheFrameAtTheServersLimitNamingTheAgent) {
  std::atomic<bool> was_cancelled{false};
  second_.on_frame = [&](grpc::ServerContext* context, FakeAgent::FrameStream*) {
    was_cancelled.store(WaitUntilCancelled(context));
    return grpc::Status::CANCELLED;
  };
  options_.max_frame_duration = absl::Milliseconds(300);
  StartCluster();
  EXPECT_THAT(Render(Request()),
              StatusIs(absl::StatusCode::kDeadlineExceeded, HasSubstr(second_.address())));
  second_.Stop();
  EXPECT_TRUE(was_cancelled.load());
}

TEST_F(IsosurfaceServiceTest, AClientThatCancelsStopsTheAgents) {
  absl::Notification begun;
  absl::Notification cancelled;
  second_.on_frame = [&](grpc::ServerContext* context, FakeAgent::FrameStream* stream) {
    internal::RenderFrameRequest request;
    stream->Read(&request);
    begun.Notify();
    if (WaitUntilCancelled(context)) {
      cancelled.Notify();
    }
    return grpc::Status::CANCELLED;
  };
  StartCluster();
  grpc::ClientContext context;
  isoscope::v1::RenderIsosurfaceResponse response;
  std::thread client([&] {
    const grpc::Status status = stub_->RenderIsosurface(&context, Request(), &response);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::CANCELLED);
  });
  begun.WaitForNotification();
  context.TryCancel();
  client.join();
  EXPECT_TRUE(cancelled.WaitForNotificationWithTimeout(absl::Seconds(20)));
}

TEST_F(IsosurfaceServiceTest, MoreFramesThanMayWaitAreRefusedWithAdvice) {
  absl::Notification begun;
  absl::Notification release;
  second_.on_frame = [&](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
    if (!begun.HasBeenNotified()) {
      begun.Notify();
    }
    release.WaitForNotification();
    return PlayEmptyFrame(stream);
  };
  options_.max_concurrent_frames = 1;
  options_.max_queued_frames = 0;
  StartCluster();
  std::thread client([&] { EXPECT_THAT(Render(Request()), IsOk()); });
  begun.WaitForNotification();
  EXPECT_THAT(Render(Request()),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("retry later")));
  EXPECT_TRUE(base::RetryDelayOf(Render(Request()).status()).has_value());
  release.Notify();
  client.join();
  EXPECT_THAT(Render(Request()), IsOk());
}

TEST_F(IsosurfaceServiceTest, AQueuedFrameHearsOfItsDeadlineWhileTheThreadsAreBusy) {
  absl::Notification begun;
  absl::Notification release;
  second_.on_frame = [&](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
    if (!begun.HasBeenNotified()) {
      begun.Notify();
    }
    release.WaitForNotification();
    return PlayEmptyFrame(stream);
  };
  options_.max_concurrent_frames = 1;
  options_.max_queued_frames = 4;
  StartCluster();
  std::thread client([&] { EXPECT_THAT(Render(Request()), IsOk()); });
  begun.WaitForNotification();
  EXPECT_THAT(Render(Request(), absl::Seconds(2)),
              StatusIs(absl::StatusCode::kDeadlineExceeded,
                       AllOf(HasSubstr("for its turn"), HasSubstr("1 frames are in work"))));
  release.Notify();
  client.join();
}

TEST_F(IsosurfaceServiceTest, ExportsBeyondTheirQueueAreRefusedWithATimeToComeAgain) {
  absl::Notification release;
  for (FakeAgent* agent : {&first_, &second_}) {
    agent->on_surface = [&](grpc::ServerContext*, FakeAgent::SurfaceWriter*) {
      release.WaitForNotification();
      return grpc::Status::OK;
    };
  }
  StartCluster();
  std::atomic<int> refused{0};
  std::vector<std::thread> clients;
  // Those that are refused come back at once, the others when they are released.
  constexpr int kPlaces = 4 + 16;
  for (int i = 0; i < kPlaces + 5; ++i) {
    clients.emplace_back([&] {
      grpc::ClientContext context;
      const auto reader = stub_->ExportIsosurface(&context, {});
      isoscope::v1::ExportIsosurfaceResponse chunk;
      while (reader->Read(&chunk)) {
      }
      const absl::Status status = rpc::ToAbslStatus(reader->Finish());
      if (!status.ok()) {
        EXPECT_THAT(status, StatusIs(absl::StatusCode::kResourceExhausted,
                                     HasSubstr("exports are in work")));
        EXPECT_TRUE(base::RetryDelayOf(status).has_value());
        ++refused;
      }
    });
  }
  while (refused.load() < 5) {
    absl::SleepFor(absl::Milliseconds(1));
  }
  release.Notify();
  for (std::thread& client : clients) {
    client.join();
  }
  EXPECT_EQ(refused.load(), 5);
}

TEST_F(IsosurfaceServiceTest, ShutdownWithoutGraceCancelsFramesInWork) {
  absl::Notification begun;
  second_.on_frame = [&](grpc::ServerContext* context, FakeAgent::FrameStream*) {
    begun.Notify();
    WaitUntilCancelled(context);
    return grpc::Status::CANCELLED;
  };
  StartCluster();
  std::thread client([&] { EXPECT_FALSE(Render(Request()).ok()); });
  begun.WaitForNotification();
  coordinator_->Shutdown(absl::ZeroDuration());
  client.join();
}

internal::ExtractSurfaceResponse OneTriangle(std::int64_t block_id = 0) {
  internal::ExtractSurfaceResponse message;
  internal::BlockSurface* block = message.add_blocks();
  block->set_block_id(block_id);
  const std::vector<float> positions = {1, 1, 1.5F, 2, 1, 1.5F, 1, 2, 1.5F};
  // No vertex is one of another block.
  const std::int64_t edge = 3 * (91 + 20 * block_id) + 2;
  const std::vector<std::int64_t> keys = {edge, edge + 3, edge + 27};
  const std::vector<std::uint32_t> triangles = {0, 1, 2};
  block->set_positions(positions.data(), positions.size() * sizeof(float));
  block->set_normals(positions.data(), positions.size() * sizeof(float));
  block->set_edge_keys(keys.data(), keys.size() * sizeof(std::int64_t));
  block->set_triangles(triangles.data(), triangles.size() * sizeof(std::uint32_t));
  return message;
}

TEST_F(IsosurfaceServiceTest, OneTriangleIsExportedInWorldSpace) {
  first_.on_surface = [](grpc::ServerContext*, FakeAgent::SurfaceWriter* writer) {
    writer->Write(OneTriangle());
    return grpc::Status::OK;
  };
  second_.on_surface = [](grpc::ServerContext*, FakeAgent::SurfaceWriter*) {
    return grpc::Status::OK;
  };
  StartCluster();
  grpc::ClientContext context;
  isoscope::v1::ExportIsosurfaceRequest request;
  request.set_isovalue(100);
  const auto reader = stub_->ExportIsosurface(&context, request);
  isoscope::v1::ExportIsosurfaceResponse chunk;
  ASSERT_TRUE(reader->Read(&chunk));
  EXPECT_EQ(chunk.positions().size(), 3 * 3 * sizeof(float));
  EXPECT_EQ(chunk.triangles().size(), 3 * sizeof(std::int64_t));
  EXPECT_FALSE(reader->Read(&chunk));
  EXPECT_THAT(rpc::ToAbslStatus(reader->Finish()), IsOk());
}

double GaugeOf(CoordinatorServer* coordinator, const std::string& name) {
  for (const base::MetricFamily& family : coordinator->CollectMetrics()) {
    if (family.name == name) {
      return family.samples.at(0).value;
    }
  }
  ADD_FAILURE() << "no metric " << name;
  return 0;
}

TEST_F(IsosurfaceServiceTest, AnExportKeepsItsMemoryUntilASlowClientHasTheMesh) {
  constexpr int kTriangles = 100'000;  // three chunks: one on its way, two wait
  first_.on_surface = [](grpc::ServerContext*, FakeAgent::SurfaceWriter* writer) {
    internal::ExtractSurfaceResponse message = OneTriangle();
    const std::string triangle = message.blocks(0).triangles();
    std::string* const triangles = message.mutable_blocks(0)->mutable_triangles();
    for (int i = 1; i < kTriangles; ++i) {
      triangles->append(triangle);
    }
    writer->Write(message);
    return grpc::Status::OK;
  };
  second_.on_surface = [](grpc::ServerContext*, FakeAgent::SurfaceWriter*) {
    return grpc::Status::OK;
  };
  StartCluster();
  grpc::ClientContext context;
  isoscope::v1::ExportIsosurfaceRequest request;
  request.set_isovalue(100);
  const auto reader = stub_->ExportIsosurface(&context, request);
  const auto wait_for_bytes = [&](double bytes) {
    const absl::Time end = absl::Now() + absl::Seconds(20);
    while (GaugeOf(coordinator_.get(), "isoscope_export_memory_bytes") != bytes) {
      ASSERT_LT(absl::Now(), end);
      absl::SleepFor(absl::Milliseconds(1));
    }
  };
  // What agents needed is given back, and the rest stays.
  wait_for_bytes(CoordinatorMemory::kExportAnswerBytes);
  absl::SleepFor(absl::Milliseconds(50));
  wait_for_bytes(CoordinatorMemory::kExportAnswerBytes);
  EXPECT_GT(GaugeOf(coordinator_.get(), "isoscope_unsent_bytes"), 1e5);
  std::size_t bytes = 0;
  isoscope::v1::ExportIsosurfaceResponse chunk;
  while (reader->Read(&chunk)) {
    bytes += chunk.triangles().size();
  }
  EXPECT_THAT(rpc::ToAbslStatus(reader->Finish()), IsOk());
  EXPECT_EQ(bytes, kTriangles * 3 * sizeof(std::int64_t));
  wait_for_bytes(0);
  const absl::Time end = absl::Now() + absl::Seconds(20);
  while (GaugeOf(coordinator_.get(), "isoscope_unsent_bytes") != 0 && absl::Now() < end) {
    absl::SleepFor(absl::Milliseconds(1));
  }
  EXPECT_EQ(GaugeOf(coordinator_.get(), "isoscope_unsent_bytes"), 0);
}

TEST_F(IsosurfaceServiceTest, AnExportGoesOnBehindTheLastBlockWhenAReplicaTakesOver) {
  std::atomic<int> stream_count{0};
  for (FakeAgent* agent : {&first_, &second_}) {
    agent->SetShards({MakeShard("head", 0, 1)});
    agent->on_surface = [&](grpc::ServerContext*, FakeAgent::SurfaceWriter* writer) {
      const bool is_first = ++stream_count == 1;
      for (std::int64_t block = 0; block < (is_first ? 2 : 5); ++block) {
        writer->Write(OneTriangle(block));
      }
      return is_first ? grpc::Status(grpc::StatusCode::UNAVAILABLE, "killed") : grpc::Status::OK;
    };
  }
  StartCluster();
  grpc::ClientContext context;
  isoscope::v1::ExportIsosurfaceRequest request;
  request.set_isovalue(100);
  const auto reader = stub_->ExportIsosurface(&context, request);
  isoscope::v1::ExportIsosurfaceResponse chunk;
  std::string triangles;
  while (reader->Read(&chunk)) {
    triangles += chunk.triangles();
  }
  EXPECT_THAT(rpc::ToAbslStatus(reader->Finish()), IsOk());
  EXPECT_EQ(stream_count, 2);
  EXPECT_EQ(triangles.size(), 5 * 3 * sizeof(std::int64_t)) << "each block once";
}

// Symptom: an export had no deadline, and one agent that hung held it, and its place, for ever.
TEST_F(IsosurfaceServiceTest, AnAgentThatSendsNothingEndsTheExportNamingTheAgent) {
  std::atomic<bool> was_cancelled{false};
  first_.on_surface = [](grpc::ServerContext*, FakeAgent::SurfaceWriter* writer) {
    writer->Write(OneTriangle());
    return grpc::Status::OK;
  };
  second_.on_surface = [&](grpc::ServerContext* context, FakeAgent::SurfaceWriter*) {
    was_cancelled.store(WaitUntilCancelled(context));
    return grpc::Status::CANCELLED;
  };
  options_.max_agent_silence = absl::Seconds(1);
  StartCluster();
  grpc::ClientContext context;
  isoscope::v1::ExportIsosurfaceRequest request;
  request.set_isovalue(100);
  const auto reader = stub_->ExportIsosurface(&context, request);
  isoscope::v1::ExportIsosurfaceResponse chunk;
  while (reader->Read(&chunk)) {
  }
  EXPECT_THAT(rpc::ToAbslStatus(reader->Finish()),
              StatusIs(absl::StatusCode::kDeadlineExceeded,
                       AllOf(HasSubstr(second_.address()), HasSubstr("sent nothing for 1s"),
                             Not(HasSubstr(first_.address())))));
  second_.Stop();
  EXPECT_TRUE(was_cancelled.load());
}

TEST_F(IsosurfaceServiceTest, AReplicaTakesOverAnExportFromAnAgentThatFallsSilent) {
  std::atomic<int> stream_count{0};
  for (FakeAgent* agent : {&first_, &second_}) {
    agent->SetShards({MakeShard("head", 0, 1)});
    agent->on_surface = [&](grpc::ServerContext* stream_context, FakeAgent::SurfaceWriter* writer) {
      const bool is_first = ++stream_count == 1;
      for (std::int64_t block = 0; block < (is_first ? 2 : 5); ++block) {
        writer->Write(OneTriangle(block));
      }
      if (is_first) {
        EXPECT_TRUE(WaitUntilCancelled(stream_context)) << "the export waited for it all the same";
        return grpc::Status::CANCELLED;
      }
      return grpc::Status::OK;
    };
  }
  options_.max_agent_silence = absl::Seconds(1);
  StartCluster();
  grpc::ClientContext context;
  isoscope::v1::ExportIsosurfaceRequest request;
  request.set_isovalue(100);
  const auto reader = stub_->ExportIsosurface(&context, request);
  isoscope::v1::ExportIsosurfaceResponse chunk;
  std::string triangles;
  while (reader->Read(&chunk)) {
    triangles += chunk.triangles();
  }
  EXPECT_THAT(rpc::ToAbslStatus(reader->Finish()), IsOk());
  EXPECT_EQ(stream_count, 2);
  EXPECT_EQ(triangles.size(), 5 * 3 * sizeof(std::int64_t)) << "each block once";
}

TEST_F(IsosurfaceServiceTest, SurfacesFollowOneAnotherAndWrongRequestsReachNoAgent) {
  first_.on_surface = [](grpc::ServerContext*, FakeAgent::SurfaceWriter* writer) {
    writer->Write(OneTriangle());
    return grpc::Status::OK;
  };
  second_.on_surface = [](grpc::ServerContext*, FakeAgent::SurfaceWriter*) {
    return grpc::Status::OK;
  };
  StartCluster();
  isoscope::v1::ExportIsosurfaceRequest request;
  request.add_surfaces()->set_isovalue(100);
  request.add_surfaces()->set_isovalue(50);
  grpc::ClientContext context;
  const auto reader = stub_->ExportIsosurface(&context, request);
  isoscope::v1::ExportIsosurfaceResponse chunk;
  for (int surface = 0; surface < 2; ++surface) {
    ASSERT_TRUE(reader->Read(&chunk));
    EXPECT_EQ(chunk.surface_index(), surface);
    EXPECT_EQ(base::LoadLittleEndian<std::int64_t>(chunk.triangles().data()), 3 * surface);
  }
  EXPECT_FALSE(reader->Read(&chunk));
  EXPECT_THAT(rpc::ToAbslStatus(reader->Finish()), IsOk());

  first_.on_surface = nullptr;  // to be asked would end the test
  second_.on_surface = nullptr;
  request.mutable_clip()->add_half_spaces();
  grpc::ClientContext bad_context;
  const auto refused = stub_->ExportIsosurface(&bad_context, request);
  EXPECT_FALSE(refused->Read(&chunk));
  EXPECT_THAT(
      rpc::ToAbslStatus(refused->Finish()),
      StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("clip.half_spaces[0].normal")));
}

TEST_F(IsosurfaceServiceTest, AMalformedSurfaceIsRefusedNamingTheAgent) {
  first_.on_surface = [](grpc::ServerContext*, FakeAgent::SurfaceWriter* writer) {
    internal::ExtractSurfaceResponse message;
    message.add_blocks()->set_positions("123");
    writer->Write(message);
    return grpc::Status::OK;
  };
  second_.on_surface = [](grpc::ServerContext*, FakeAgent::SurfaceWriter*) {
    return grpc::Status::OK;
  };
  StartCluster();
  grpc::ClientContext context;
  const auto reader = stub_->ExportIsosurface(&context, {});
  isoscope::v1::ExportIsosurfaceResponse chunk;
  EXPECT_FALSE(reader->Read(&chunk));
  EXPECT_THAT(rpc::ToAbslStatus(reader->Finish()),
              StatusIs(absl::StatusCode::kInternal,
                       AllOf(HasSubstr(first_.address()), HasSubstr("3 bytes of positions"))));
}

TEST_F(IsosurfaceServiceTest, StatusAndDatasetsTellWhatTheRegistrySaw) {
  StartCluster();
  grpc::ClientContext status_context;
  isoscope::v1::GetClusterStatusResponse status;
  ASSERT_TRUE(isoscope::v1::ClusterService::NewStub(channel_)
                  ->GetClusterStatus(&status_context, {}, &status)
                  .ok());
  ASSERT_EQ(status.agents_size(), 2);
  EXPECT_EQ(status.agents(0).state(), isoscope::v1::AgentStatus::STATE_REACHABLE);
  EXPECT_EQ(status.agents(0).version(), "1.2.3");
  EXPECT_EQ(status.agents(0).shards_size(), 1);

  grpc::ClientContext list_context;
  isoscope::v1::ListDatasetsResponse list;
  const auto datasets = isoscope::v1::DatasetService::NewStub(channel_);
  ASSERT_TRUE(datasets->ListDatasets(&list_context, {}, &list).ok());
  ASSERT_EQ(list.datasets_size(), 1);
  EXPECT_EQ(list.datasets(0).name(), "head");
  EXPECT_EQ(list.datasets(0).missing_shards_size(), 0);

  grpc::ClientContext get_context;
  isoscope::v1::GetDatasetRequest request;
  request.set_name("none");
  isoscope::v1::GetDatasetResponse dataset;
  EXPECT_EQ(datasets->GetDataset(&get_context, request, &dataset).error_code(),
            grpc::StatusCode::NOT_FOUND);

  grpc::ClientContext capabilities_context;
  isoscope::v1::GetCapabilitiesResponse capabilities;
  ASSERT_TRUE(isoscope::v1::ClusterService::NewStub(channel_)
                  ->GetCapabilities(&capabilities_context, {}, &capabilities)
                  .ok());
  EXPECT_EQ(capabilities.max_concurrent_frame_count(), options_.max_concurrent_frames);
  EXPECT_FALSE(capabilities.version().empty());
}

TEST_F(IsosurfaceServiceTest, TheStatusOfTheClusterHasTheFramesInWorkAndWhatCameOfThem) {
  absl::Notification begun;
  absl::Notification go_on;
  second_.on_frame = [&](grpc::ServerContext* context, FakeAgent::FrameStream* stream) {
    const auto traceparent = context->client_metadata().find("traceparent");
    EXPECT_NE(traceparent, context->client_metadata().end());
    begun.Notify();
    go_on.WaitForNotification();
    return PlayEmptyFrame(stream);
  };
  StartCluster();
  const auto cluster = isoscope::v1::ClusterService::NewStub(channel_);
  const auto status = [&] {
    grpc::ClientContext context;
    isoscope::v1::GetClusterStatusResponse response;
    EXPECT_TRUE(cluster->GetClusterStatus(&context, {}, &response).ok());
    return response;
  };
  EXPECT_EQ(status().frames_size(), 0);
  std::thread client([&] { EXPECT_THAT(Render(Request()), IsOk()); });
  begun.WaitForNotification();
  const isoscope::v1::GetClusterStatusResponse during = status();
  go_on.Notify();
  client.join();
  EXPECT_EQ(during.load().working_frame_count(), 1);
  ASSERT_EQ(during.frames_size(), 1);
  EXPECT_EQ(during.frames(0).dataset(), "head");
  EXPECT_EQ(during.frames(0).extent().width_px(), 32);
  EXPECT_EQ(during.frames(0).request_id().size(), 32u);
  EXPECT_EQ(during.frames(0).step(), isoscope::v1::FrameInWork::STEP_OCCLUDER_SELECTION);
  const isoscope::v1::GetClusterStatusResponse after = status();
  EXPECT_EQ(after.frames_size(), 0);
  EXPECT_EQ(after.load().done_frame_count(), 1);
  EXPECT_EQ(after.load().failed_frame_count(), 0);
}

TEST_F(IsosurfaceServiceTest, FramesOfDatasetsThatACallerMayNotSeeAreNotInItsStatus) {
  const testing::TempDir folder;
  options_.token_file = folder.Sub("tokens.json");
  const auto entry = [](const std::string& name, const std::string& dataset) {
    return absl::StrFormat(R"({"name": "%s", "sha256": "%s", "datasets": ["%s"]})", name,
                           absl::BytesToHexString(DigestOfToken(name)), dataset);
  };
  testing::ReplaceFile(
      options_.token_file,
      absl::StrFormat(R"({"tokens": [%s, %s]})", entry("alice", "head"), entry("bob", "other")));
  absl::Notification begun;
  absl::Notification go_on;
  second_.on_frame = [&](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
    begun.Notify();
    go_on.WaitForNotification();
    return PlayEmptyFrame(stream);
  };
  StartCluster();
  const auto cluster = isoscope::v1::ClusterService::NewStub(channel_);
  const auto frames_seen_by = [&](const std::string& token) {
    grpc::ClientContext context;
    context.AddMetadata("authorization", absl::StrCat("Bearer ", token));
    isoscope::v1::GetClusterStatusResponse response;
    EXPECT_TRUE(cluster->GetClusterStatus(&context, {}, &response).ok());
    return response.frames_size();
  };
  std::thread client([&] {
    grpc::ClientContext context;
    context.AddMetadata("authorization", "Bearer alice");
    isoscope::v1::RenderIsosurfaceResponse response;
    EXPECT_THAT(rpc::ToAbslStatus(stub_->RenderIsosurface(&context, Request(), &response)), IsOk());
  });
  EXPECT_TRUE(begun.WaitForNotificationWithTimeout(absl::Seconds(20)));
  EXPECT_EQ(frames_seen_by("alice"), 1);
  EXPECT_EQ(frames_seen_by("bob"), 0);
  go_on.Notify();
  client.join();
}

TEST_F(IsosurfaceServiceTest, AFrameIsTracedOfAgentsThatTellNoTimesAndAPickIsRefused) {
  StartCluster();
  isoscope::v1::RenderIsosurfaceRequest request = Request();
  request.set_with_trace(true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto response, Render(request));
  ASSERT_EQ(response.trace().processes_size(), 1);
  EXPECT_EQ(response.trace().processes(0).name(), "coordinator");

  isoscope::v1::PickSurfaceRequest pick;
  *pick.mutable_frame() = request;
  pick.add_pixels();
  grpc::ClientContext context;
  isoscope::v1::PickSurfaceResponse picked;
  EXPECT_THAT(rpc::ToAbslStatus(stub_->PickSurface(&context, pick, &picked)),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("frame.with_trace")));
}

TEST_F(IsosurfaceServiceTest, MetricsCountFramesCallsAndTheAgentThatFailed) {
  second_.on_frame = [](grpc::ServerContext*, FakeAgent::FrameStream*) {
    return grpc::Status(grpc::StatusCode::DATA_LOSS, "block 7 is damaged");
  };
  StartCluster();
  EXPECT_THAT(Render(Request()), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("block 7")));
  std::string text;
  for (const base::MetricFamily& family : coordinator_->CollectMetrics()) {
    for (const base::MetricSample& sample : family.samples) {
      if (sample.value > 0) {
        text += family.name;
        for (const auto& [name, value] : sample.labels) {
          text += " " + value;
        }
        text += "\n";
      }
    }
  }
  EXPECT_THAT(text, AllOf(HasSubstr("isoscope_frames_total failed\n"),
                          HasSubstr("isoscope_requests_total RenderIsosurface DATA_LOSS\n"),
                          HasSubstr("isoscope_agent_failures_total selecting_occluders DATA_LOSS"),
                          HasSubstr("isoscope_agents reachable\n")));
}

TEST_F(IsosurfaceServiceTest, AnAddressInUseIsUnavailable) {
  StartCluster();
  CoordinatorServerOptions options = options_;
  options.listen_address = first_.address();
  EXPECT_THAT(CoordinatorServer::Start(options),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr(first_.address())));
}

}  // namespace
}  // namespace isoscope::server
