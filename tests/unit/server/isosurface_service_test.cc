// The public service against agents of a script: what goes wrong on an agent, and what clients see.

#include <algorithm>
#include <atomic>
#include <limits>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/synchronization/mutex.h"
#include "absl/synchronization/notification.h"
#include "absl/time/time.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/retry_delay.h"
#include "core/image/png_codec.h"
#include "core/math/exact_sum.h"
#include "proto/message_checksum.h"
#include "rpc/signs_of_life.h"
#include "server/admission/coordinator_memory.h"
#include "server/isosurface_service_impl.h"
#include "tests/support/enough_time.h"
#include "tests/unit/server/fake_cluster.h"

namespace isoscope::server {
namespace {

namespace internal = isoscope::internal::v1;

using ::testing::AllOf;
using testing::Export;
using testing::FakeAgent;
using testing::FrameRequest;
using testing::HangUntilCancelled;
using ::testing::HasSubstr;
using testing::HeldFrames;
using testing::IsOk;
using testing::MakeShard;
using ::testing::Not;
using testing::PlayEmptyFrame;
using testing::StatusIs;
using testing::Triangles;
using testing::WaitFor;

// An agent whose frames end so at once.
auto Fail(grpc::StatusCode code, const std::string& message) {
  return [=](grpc::ServerContext*, FakeAgent::FrameStream*) { return grpc::Status(code, message); };
}

// An agent that sends this surface.
auto SendSurface(const internal::ExtractSurfaceResponse& message) {
  return [=](grpc::ServerContext*, FakeAgent::SurfaceWriter* writer) {
    writer->Write(message);
    return grpc::Status::OK;
  };
}

using IsosurfaceServiceTest = testing::TwoAgentsTest;

TEST_F(IsosurfaceServiceTest, AFrameWithoutSurfaceIsTheBackgroundAndSumsTheAgents) {
  const Running running = Start();
  isoscope::v1::RenderIsosurfaceRequest request = FrameRequest();
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

TEST_F(IsosurfaceServiceTest, AgentsGetTheFrameAndTheirShare) {
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
  const Running running = Start();
  isoscope::v1::RenderIsosurfaceRequest request = FrameRequest();
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
  EXPECT_EQ(begin.frame().ray_seed(), 77);
  ASSERT_EQ(begin.frame().surfaces_size(), 1);
  EXPECT_EQ(begin.frame().surfaces(0).isovalue(), 100);
  // Bit for bit: every agent must compute the same view.
  EXPECT_EQ(begin.frame().camera().perspective().fov_y_degrees(), 33.3);
  EXPECT_EQ(begin.frame().camera().eye().z(), 0.1);
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
  const Running running = Start();
  // True if both agents were asked, false if none was. What they are to draw must not depend on it.
  const auto render = [&](double isovalue) {
    {
      absl::MutexLock lock(&mutex);
      asked.clear();
      visible.clear();
    }
    isoscope::v1::RenderIsosurfaceRequest request = FrameRequest();
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
  const Running running = Start();
  const auto expect_bad = [this](const isoscope::v1::RenderIsosurfaceRequest& request,
                                 const std::string& field) {
    EXPECT_THAT(Render(request), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(field)));
  };
  isoscope::v1::RenderIsosurfaceRequest request = FrameRequest();
  request.set_isovalue(std::numeric_limits<double>::quiet_NaN());
  expect_bad(request, "isovalue");
  request = FrameRequest();
  request.clear_viewport();
  expect_bad(request, "viewport");
  request = FrameRequest();
  request.mutable_base_color()->set_green(0.5F);
  expect_bad(request, "base_color.alpha");
  request = FrameRequest();
  request.mutable_camera();
  expect_bad(request, "camera.eye");
  // A parameter of a newer version: without it the picture might be another one.
  request = FrameRequest();
  request.GetReflection()->MutableUnknownFields(&request)->AddVarint(99, 1);
  expect_bad(request, "number 99");
  request = FrameRequest();
  request.set_dataset("haed");
  EXPECT_THAT(Render(request), StatusIs(absl::StatusCode::kNotFound, HasSubstr("head")));
}

TEST_F(IsosurfaceServiceTest, AnAgentsErrorKeepsItsCodeAndNamesTheAgent) {
  for (const grpc::StatusCode code :
       {grpc::StatusCode::DATA_LOSS, grpc::StatusCode::INTERNAL,
        grpc::StatusCode::RESOURCE_EXHAUSTED, grpc::StatusCode::FAILED_PRECONDITION}) {
    first_.Stop();
    second_.Stop();
    second_.on_frame = Fail(code, "block 1713 at offset 4096");
    const Running running = Start();
    EXPECT_THAT(Render(FrameRequest()),
                StatusIs(static_cast<absl::StatusCode>(code),
                         AllOf(HasSubstr(second_.address()), HasSubstr("shard 1"),
                               HasSubstr("block 1713 at offset 4096"))));
    coordinator_.reset();
  }
}

TEST_F(IsosurfaceServiceTest, AnAgentWithoutMemoryForTheWholeGetsSmallerBands) {
  constexpr int kMostPixels = 5000;
  std::atomic<int> refused{0};
  std::atomic<int> drawn{0};
  second_.on_frame = [&](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
    internal::RenderFrameRequest request;
    internal::RenderFrameResponse response;
    stream->Read(&request);
    const internal::FrameSpec frame = request.begin().frame();
    const int pixels = frame.has_region()
                           ? frame.region().width_px() * frame.region().height_px()
                           : frame.viewport().width_px() * frame.viewport().height_px();
    EXPECT_EQ(frame.viewport().width_px(), 200) << "a band is a region of the whole";
    response.mutable_ray_hits();
    stream->Write(response);
    stream->Read(&request);
    if (pixels > kMostPixels) {
      ++refused;
      return grpc::Status(grpc::StatusCode::RESOURCE_EXHAUSTED, "raise --memory-limit to 99MiB");
    }
    ++drawn;
    response.mutable_occluders_done();
    stream->Write(response);
    stream->Read(&request);
    response.mutable_frame_done()->mutable_statistics()->set_triangle_count(7);
    stream->Write(response);
    return grpc::Status::OK;
  };
  const Running running = Start();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto response, Render(FrameRequest(200, 180)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::RgbaImage picture, image::DecodePng(response.png()));
  EXPECT_EQ(picture.width, 200);
  EXPECT_EQ(picture.height, 180);
  EXPECT_GT(response.statistics().band_count(), 200 * 180 / kMostPixels);
  EXPECT_EQ(drawn.load(), response.statistics().band_count());
  EXPECT_GT(refused.load(), 1);
  // The next frame begins with them.
  const int refused_before = refused.load();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto next, Render(FrameRequest(200, 180)));
  EXPECT_EQ(next.statistics().band_count(), response.statistics().band_count());
  EXPECT_EQ(next.png(), response.png());
  EXPECT_EQ(refused.load(), refused_before);
  // Bands of fewer pixels than the least are no way out: the agent's advice reaches the client.
  Stop();
  second_.on_frame = Fail(grpc::StatusCode::RESOURCE_EXHAUSTED, "raise --memory-limit to 99MiB");
  const Running running_again = Start();
  EXPECT_THAT(Render(FrameRequest(200, 180)),
              StatusIs(absl::StatusCode::kResourceExhausted,
                       AllOf(HasSubstr(second_.address()), HasSubstr("to 99MiB"))));
}

// Symptom: for a minute after such a refusal the least bands were drawn, hundreds for a picture.
TEST_F(IsosurfaceServiceTest, AnAgentWithoutMemoryForAnySizeIsNotTakenForOneWithALimit) {
  std::atomic<bool> fails{true};
  second_.on_frame = [&](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
    return fails ? grpc::Status(grpc::StatusCode::RESOURCE_EXHAUSTED, "too many open files")
                 : PlayEmptyFrame(stream);
  };
  const Running running = Start();
  EXPECT_THAT(Render(FrameRequest(200, 180)),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("too many open files")));
  fails = false;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto response, Render(FrameRequest(200, 180)));
  EXPECT_EQ(response.statistics().band_count(), 1);
}

TEST_F(IsosurfaceServiceTest, AnAgentThatIsBusySaysWhenToComeAgain) {
  second_.on_frame = [](grpc::ServerContext*, FakeAgent::FrameStream*) {
    return rpc::ToGrpcStatus(base::WithRetryDelay(absl::ResourceExhaustedError("64 frames wait"),
                                                  absl::Milliseconds(700)));
  };
  const Running running = Start();
  const absl::Status status = Render(FrameRequest()).status();
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("64 frames wait")));
  EXPECT_EQ(base::RetryDelayOf(status), absl::Milliseconds(700));
}

// Symptom: an agent whose machine was short of memory, or of files, was asked for the same picture
// in ever smaller bands, some fifteen times.
TEST_F(IsosurfaceServiceTest, AnAgentThatIsBusyIsNotAskedForSmallerBands) {
  std::atomic<int> asked{0};
  second_.on_frame = [&](grpc::ServerContext*, FakeAgent::FrameStream*) {
    ++asked;
    return rpc::ToGrpcStatus(
        base::WithRetryDelay(absl::ResourceExhaustedError("no memory for a step of the frame"),
                             absl::Milliseconds(500)));
  };
  const Running running = Start();
  EXPECT_THAT(Render(FrameRequest(400, 300)),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("no memory for a step of")));
  EXPECT_EQ(asked.load(), 1);
}

// Symptom: the trace of a picture of thousands of bands had thousands of processes, each with
// memory of its own.
TEST_F(IsosurfaceServiceTest, ATraceHasTheDetailsOfTheFirstBandsAndASpanForEachOther) {
  constexpr int kMostPixels = 128 * 128;
  constexpr int kDetailedBands = 64;
  const auto play = [](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
    internal::RenderFrameRequest request;
    internal::RenderFrameResponse response;
    stream->Read(&request);
    const bool has_trace = request.begin().with_trace();
    const isoscope::v1::Region region = request.begin().frame().region();
    if (!request.begin().frame().has_region() ||
        region.width_px() * region.height_px() > kMostPixels) {
      return grpc::Status(grpc::StatusCode::RESOURCE_EXHAUSTED, "raise --memory-limit to 99MiB");
    }
    response.mutable_ray_hits();
    stream->Write(response);
    stream->Read(&request);
    response.mutable_occluders_done();
    stream->Write(response);
    stream->Read(&request);
    response.mutable_frame_done();
    if (has_trace) {
      response.mutable_frame_done()->mutable_trace()->mutable_spans()->add_tracks()->set_name("w");
    }
    stream->Write(response);
    return grpc::Status::OK;
  };
  first_.on_frame = play;
  second_.on_frame = play;
  const Running running = Start();
  isoscope::v1::RenderIsosurfaceRequest request = FrameRequest(1536, 1280);
  request.set_with_trace(true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto response, Render(request));
  const std::int64_t band_count = response.statistics().band_count();
  ASSERT_GT(band_count, kDetailedBands);
  EXPECT_EQ(response.trace().processes_size(), 1 + 2 * kDetailedBands);
  std::int64_t without_details = 0;
  for (const isoscope::v1::TraceTrack& track : response.trace().processes(0).tracks()) {
    for (const isoscope::v1::TraceSpan& span : track.spans()) {
      without_details += span.name() == "band" ? 1 : 0;
    }
  }
  EXPECT_EQ(without_details, band_count - kDetailedBands);
}

TEST_F(IsosurfaceServiceTest, AnAgentThatRefusesTheCoordinatorsMessageIsNotTheClientsFault) {
  second_.on_frame = Fail(grpc::StatusCode::INVALID_ARGUMENT, "out of order");
  const Running running = Start();
  EXPECT_THAT(Render(FrameRequest()),
              StatusIs(absl::StatusCode::kInternal, HasSubstr("out of order")));
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
  const Running running = Start();
  EXPECT_THAT(Render(FrameRequest()),
              StatusIs(absl::StatusCode::kInternal, HasSubstr(second_.address())));
  EXPECT_THAT(
      Render(FrameRequest()),
      StatusIs(absl::StatusCode::kInternal,
               AllOf(HasSubstr(second_.address()), HasSubstr("malformed"), HasSubstr("1000000"))));
}

TEST_F(IsosurfaceServiceTest, AMessageThatIsDamagedOnItsWayIsNotTheAgentsFault) {
  internal::ExtractSurfaceResponse damaged_surface;
  proto::ParseChecked(nullptr, &damaged_surface);
  first_.on_surface = SendSurface(damaged_surface);
  second_.on_frame = [](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
    internal::RenderFrameResponse damaged;
    proto::ParseChecked(nullptr, &damaged);
    stream->Write(damaged);
    return grpc::Status::OK;
  };
  const Running running = Start();
  EXPECT_THAT(Render(FrameRequest()),
              StatusIs(absl::StatusCode::kUnavailable,
                       AllOf(HasSubstr(second_.address()), HasSubstr("CRC-32C"))));
  EXPECT_THAT(Export(frames_.get()).Finish(),
              StatusIs(absl::StatusCode::kUnavailable,
                       AllOf(HasSubstr(first_.address()), HasSubstr("CRC-32C"))));
}

TEST_F(IsosurfaceServiceTest, AnAgentThatDiesDuringTheFrameIsUnavailableNamingItsShards) {
  absl::Notification begun;
  second_.on_frame = [&](grpc::ServerContext* context, FakeAgent::FrameStream* stream) {
    internal::RenderFrameRequest request;
    stream->Read(&request);
    begun.Notify();
    return HangUntilCancelled(context);
  };
  const Running running = Start();
  std::thread killer([&] {
    begun.WaitForNotification();
    second_.Stop();
  });
  EXPECT_THAT(Render(FrameRequest()),
              StatusIs(absl::StatusCode::kUnavailable,
                       AllOf(HasSubstr(second_.address()), HasSubstr("shard 1"))));
  killer.join();
  // The next frame asks again and says what is missing.
  EXPECT_THAT(Render(FrameRequest()),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       AllOf(HasSubstr("shard 1"), HasSubstr(second_.address()))));
  // And the one after the agent's return succeeds.
  second_.on_frame = first_.on_frame;
  second_.StartAgain();
  EXPECT_THAT(Render(FrameRequest()), IsOk());
}

TEST_F(IsosurfaceServiceTest, AnAgentThatHangsEndsTheFrameAtTheServersLimitNamingTheAgent) {
  std::atomic<int> cancelled_count{0};
  second_.on_frame = [&](grpc::ServerContext* context, FakeAgent::FrameStream*) {
    return HangUntilCancelled(context, &cancelled_count);
  };
  options_.max_frame_duration = absl::Seconds(3);  // the agent is asked within it
  const Running running = Start();
  EXPECT_THAT(Render(FrameRequest()),
              StatusIs(absl::StatusCode::kDeadlineExceeded, HasSubstr(second_.address())));
  second_.Stop();
  EXPECT_EQ(cancelled_count, 1);
}

TEST_F(IsosurfaceServiceTest, AClientThatCancelsStopsTheAgents) {
  absl::Notification begun;
  std::atomic<int> cancelled_count{0};
  second_.on_frame = [&](grpc::ServerContext* context, FakeAgent::FrameStream* stream) {
    internal::RenderFrameRequest request;
    stream->Read(&request);
    begun.Notify();
    return HangUntilCancelled(context, &cancelled_count);
  };
  const Running running = Start();
  grpc::ClientContext context;
  isoscope::v1::RenderIsosurfaceResponse response;
  std::thread client([&] {
    const grpc::Status status = frames_->RenderIsosurface(&context, FrameRequest(), &response);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::CANCELLED);
  });
  begun.WaitForNotification();
  context.TryCancel();
  client.join();
  EXPECT_TRUE(WaitFor([&] { return cancelled_count == 1; }));
}

TEST_F(IsosurfaceServiceTest, MoreFramesThanMayWaitAreRefusedWithAdvice) {
  HeldFrames held(&second_);
  options_.max_concurrent_frames = 1;
  options_.max_queued_frames = 0;
  const Running running = Start();
  std::thread client([&] { EXPECT_THAT(Render(FrameRequest()), IsOk()); });
  EXPECT_TRUE(held.AwaitOne());
  EXPECT_THAT(Render(FrameRequest()),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("retry later")));
  EXPECT_TRUE(base::RetryDelayOf(Render(FrameRequest()).status()).has_value());
  held.Release();
  client.join();
  EXPECT_THAT(Render(FrameRequest()), IsOk());
}

TEST_F(IsosurfaceServiceTest, AQueuedFrameHearsOfItsDeadlineWhileTheThreadsAreBusy) {
  HeldFrames held(&second_);
  options_.max_concurrent_frames = 1;
  options_.max_queued_frames = 4;
  const Running running = Start();
  std::thread client([&] { EXPECT_THAT(Render(FrameRequest()), IsOk()); });
  EXPECT_TRUE(held.AwaitOne());
  testing::WithEnoughTime(absl::Seconds(2), [this](absl::Duration time) {
    const absl::Status status = Render(FrameRequest(), time).status();
    if (status.message() == "Deadline Exceeded") {  // gRPC's own: the server's answer was late
      return false;
    }
    EXPECT_THAT(status,
                StatusIs(absl::StatusCode::kDeadlineExceeded,
                         AllOf(HasSubstr("for its turn"), HasSubstr("1 frames are in work"))));
    return true;
  });
  held.Release();
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
  const Running running = Start();
  std::atomic<int> refused{0};
  std::vector<std::thread> clients;
  // Those that are refused come back at once, the others when they are released.
  constexpr int kPlaces = 4 + 16;
  for (int i = 0; i < kPlaces + 5; ++i) {
    clients.emplace_back([&] {
      const absl::Status status = Export(frames_.get()).Finish();
      if (!status.ok()) {
        EXPECT_THAT(status, StatusIs(absl::StatusCode::kResourceExhausted,
                                     HasSubstr("exports are in work")));
        EXPECT_TRUE(base::RetryDelayOf(status).has_value());
        ++refused;
      }
    });
  }
  EXPECT_TRUE(WaitFor([&] { return refused == 5; }));
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
    return HangUntilCancelled(context);
  };
  const Running running = Start();
  std::thread client([&] { EXPECT_FALSE(Render(FrameRequest()).ok()); });
  begun.WaitForNotification();
  coordinator_->Shutdown(absl::ZeroDuration());
  client.join();
}

TEST_F(IsosurfaceServiceTest, OneTriangleIsExportedInWorldSpace) {
  first_.on_surface = SendSurface(Triangles());
  const Running running = Start();
  Export mesh(frames_.get());
  ASSERT_TRUE(mesh.Read());
  EXPECT_EQ(mesh.chunk().positions().size(), 3 * 3 * sizeof(float));
  EXPECT_EQ(mesh.chunk().triangles().size(), 3 * sizeof(std::int64_t));
  EXPECT_FALSE(mesh.Read());
  EXPECT_THAT(mesh.Finish(), IsOk());
}

TEST_F(IsosurfaceServiceTest, AnExportKeepsItsMemoryUntilASlowClientHasTheMesh) {
  constexpr int kTriangles = 100'000;  // three chunks: one on its way, two wait
  first_.on_surface = SendSurface(Triangles(0, kTriangles));
  const Running running = Start();
  Export mesh(frames_.get());
  const auto has_bytes = [&](double bytes) {
    return WaitFor([&] { return Metric("isoscope_export_memory_bytes") == bytes; });
  };
  // The agents' share of the memory is returned, and the rest stays.
  ASSERT_TRUE(has_bytes(CoordinatorMemory::kExportAnswerBytes));
  absl::SleepFor(absl::Milliseconds(50));
  ASSERT_TRUE(has_bytes(CoordinatorMemory::kExportAnswerBytes));
  EXPECT_GT(Metric("isoscope_unsent_bytes"), 1e5);
  EXPECT_THAT(mesh.Finish(), IsOk());
  EXPECT_EQ(mesh.triangle_count(), kTriangles);
  EXPECT_TRUE(has_bytes(0));
  EXPECT_TRUE(WaitFor([&] { return Metric("isoscope_unsent_bytes") == 0; }));
}

// What agents that are well send comes sooner, on a machine under load, too.
constexpr absl::Duration kSilence = absl::Seconds(5);

// Two agents serve the only shard. The first one sends two blocks of five, then ends so.
struct TakeoverCase {
  const char* name;
  bool is_silent;
};

class TakeoverTest : public testing::FakeClusterTest,
                     public ::testing::WithParamInterface<TakeoverCase> {};

TEST_P(TakeoverTest, AnExportGoesOnBehindTheLastBlockWhenAReplicaTakesOver) {
  std::atomic<int> stream_count{0};
  std::atomic<int> cancelled_count{0};
  for (int i = 0; i < 2; ++i) {
    AddAgent({MakeShard("head", 0, 1)})->on_surface = [&](grpc::ServerContext* context,
                                                          FakeAgent::SurfaceWriter* writer) {
      if (++stream_count > 1) {
        return testing::WriteBlocks(0, 5, 1, writer);
      }
      testing::WriteBlocks(0, 2, 1, writer);
      return GetParam().is_silent ? HangUntilCancelled(context, &cancelled_count)
                                  : grpc::Status(grpc::StatusCode::UNAVAILABLE, "killed");
    };
  }
  if (GetParam().is_silent) {
    options_.max_agent_silence = kSilence;
  }
  const Running running = Start();
  Export mesh(frames_.get());
  EXPECT_THAT(mesh.Finish(), IsOk());
  EXPECT_EQ(stream_count, 2);
  EXPECT_EQ(mesh.triangle_count(), 5) << "each block once";
  agents_.clear();
  EXPECT_EQ(cancelled_count, GetParam().is_silent ? 1 : 0);
}

INSTANTIATE_TEST_SUITE_P(Ends, TakeoverTest,
                         ::testing::Values(TakeoverCase{"Killed", false},
                                           TakeoverCase{"FallsSilent", true}),
                         [](const auto& of) { return of.param.name; });

// Symptom: an export had no deadline, and one hung agent held it and its place without end.
TEST_F(IsosurfaceServiceTest, AnAgentThatSendsNothingEndsTheExportNamingTheAgent) {
  std::atomic<int> cancelled_count{0};
  first_.on_surface = SendSurface(Triangles());
  second_.on_surface = [&](grpc::ServerContext* context, FakeAgent::SurfaceWriter*) {
    return HangUntilCancelled(context, &cancelled_count);
  };
  options_.max_agent_silence = kSilence;
  const Running running = Start();
  EXPECT_THAT(Export(frames_.get()).Finish(),
              StatusIs(absl::StatusCode::kDeadlineExceeded,
                       AllOf(HasSubstr(second_.address()), HasSubstr("sent nothing for 5s"),
                             Not(HasSubstr(first_.address())))));
  second_.Stop();
  EXPECT_EQ(cancelled_count, 1);
}

// Symptom: measures that took minutes ended as a silent agent or a silent server. The agent works
// longer than both limits, and tells that it does.
TEST_F(IsosurfaceServiceTest, SignsOfLifeKeepAQuietExportThroughEveryLimit) {
  constexpr int kSigns = 60;
  const auto works_for_long = [](const internal::ExtractSurfaceResponse& last) {
    return [last](grpc::ServerContext*, FakeAgent::SurfaceWriter* writer) {
      for (int i = 0; i < kSigns; ++i) {
        absl::SleepFor(absl::Milliseconds(100));
        writer->Write(internal::ExtractSurfaceResponse());
      }
      writer->Write(last);
      return grpc::Status::OK;
    };
  };
  first_.on_surface = works_for_long(Triangles());
  options_.max_agent_silence = kSilence;
  options_.sign_of_life_interval = absl::Milliseconds(100);
  const Running running = Start();
  isoscope::v1::ExportIsosurfaceRequest request = testing::ExportRequest();
  request.clear_isovalue();
  request.add_surfaces()->set_isovalue(100);
  request.add_surfaces()->set_isovalue(50);
  Export mesh(frames_.get(), "", request);
  int sign_count = 0;
  int last_surface = 0;
  while (mesh.Read()) {
    sign_count += rpc::IsSignOfLife(mesh.chunk()) ? 1 : 0;
    EXPECT_GE(mesh.chunk().surface_index(), last_surface) << "never falls, also for old clients";
    last_surface = mesh.chunk().surface_index();
  }
  EXPECT_THAT(mesh.Finish(), IsOk());
  EXPECT_EQ(mesh.triangle_count(), 2);
  EXPECT_EQ(last_surface, 1);
  EXPECT_GT(sign_count, 0);
}

// Exports that wait for their turn tell it, too.
TEST_F(IsosurfaceServiceTest, AnExportInTheQueueGivesSignsOfLife) {
  absl::Notification release;
  first_.on_surface = [&](grpc::ServerContext*, FakeAgent::SurfaceWriter* writer) {
    release.WaitForNotification();
    return testing::WriteBlocks(0, 1, 1, writer);
  };
  options_.sign_of_life_interval = absl::Milliseconds(20);
  const Running running = Start();
  std::vector<std::unique_ptr<Export>> exports;
  for (int i = 0; i <= IsosurfaceServiceImpl::kMaxConcurrentExports; ++i) {
    exports.push_back(std::make_unique<Export>(frames_.get()));
  }
  for (const std::unique_ptr<Export>& one : exports) {
    ASSERT_TRUE(one->Read());
    EXPECT_TRUE(rpc::IsSignOfLife(one->chunk()));
  }
  release.Notify();
  for (const std::unique_ptr<Export>& one : exports) {
    EXPECT_THAT(one->Finish(), IsOk());
    EXPECT_EQ(one->triangle_count(), 1);
  }
}

TEST_F(IsosurfaceServiceTest, SurfacesFollowOneAnotherAndWrongRequestsReachNoAgent) {
  first_.on_surface = SendSurface(Triangles());
  const Running running = Start();
  isoscope::v1::ExportIsosurfaceRequest request;
  request.add_surfaces()->set_isovalue(100);
  request.add_surfaces()->set_isovalue(50);
  Export mesh(frames_.get(), "", request);
  for (int surface = 0; surface < 2; ++surface) {
    ASSERT_TRUE(mesh.Read());
    EXPECT_EQ(mesh.chunk().surface_index(), surface);
    EXPECT_EQ(base::LoadLittleEndian<std::int64_t>(mesh.chunk().triangles().data()), 3 * surface);
  }
  EXPECT_FALSE(mesh.Read());
  EXPECT_THAT(mesh.Finish(), IsOk());

  first_.on_surface = nullptr;  // to be asked would end the test
  second_.on_surface = nullptr;
  request.mutable_clip()->add_half_spaces();
  EXPECT_THAT(
      Export(frames_.get(), "", request).Finish(),
      StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("clip.half_spaces[0].normal")));
}

// The sums of both agents together, behind the mesh; or an error, if an agent has none.
TEST_F(IsosurfaceServiceTest, MeasuresAreTheSumsOfAllAgents) {
  const auto sums_of = [](double area, double volume, std::int64_t open_edges) {
    internal::ExtractSurfaceResponse message;
    math::ExactSum sum;
    sum.Add(area);
    message.mutable_sums()->set_area(sum.Encode());
    sum = {};
    sum.Add(volume);
    message.mutable_sums()->set_volume(sum.Encode());
    message.mutable_sums()->set_triangle_count(4);
    message.mutable_sums()->set_open_edge_count(open_edges);
    return message;
  };
  first_.on_surface = SendSurface(sums_of(2, -3, 0));
  second_.on_surface = SendSurface(sums_of(5, 4, 0));
  const Running running = Start();
  isoscope::v1::ExportIsosurfaceRequest request = testing::ExportRequest();
  request.set_with_measures(true);
  request.set_without_mesh(true);
  const auto measures = [&] {
    Export mesh(frames_.get(), "", request);
    EXPECT_TRUE(mesh.Read());
    const isoscope::v1::SurfaceMeasures of_surface = mesh.chunk().measures();
    EXPECT_FALSE(mesh.Read());
    EXPECT_THAT(mesh.Finish(), IsOk());
    return of_surface;
  };
  EXPECT_EQ(measures().area(), 7);
  EXPECT_EQ(measures().volume(), 1);
  EXPECT_EQ(measures().triangle_count(), 8);
  EXPECT_EQ(measures().open_edge_count(), 0);
  second_.on_surface = SendSurface(sums_of(5, 4, 6));
  EXPECT_FALSE(measures().has_volume());
  EXPECT_EQ(measures().open_edge_count(), 6);
  second_.on_surface = SendSurface(Triangles());
  EXPECT_THAT(Export(frames_.get(), "", request).Finish(),
              StatusIs(absl::StatusCode::kInternal, HasSubstr("no sums")));
  second_.on_surface = SendSurface(sums_of(5, 4, -6));
  EXPECT_THAT(Export(frames_.get(), "", request).Finish(),
              StatusIs(absl::StatusCode::kInternal, HasSubstr("-6 open edges")));
  request.set_with_measures(false);
  EXPECT_THAT(Export(frames_.get(), "", request).Finish(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("without_mesh")));
}

TEST_F(IsosurfaceServiceTest, AMalformedSurfaceIsRefusedNamingTheAgent) {
  internal::ExtractSurfaceResponse malformed;
  malformed.add_blocks()->set_positions("123");
  first_.on_surface = SendSurface(malformed);
  const Running running = Start();
  EXPECT_THAT(Export(frames_.get()).Finish(),
              StatusIs(absl::StatusCode::kInternal,
                       AllOf(HasSubstr(first_.address()), HasSubstr("3 bytes of positions"))));
}

TEST_F(IsosurfaceServiceTest, StatusAndDatasetsTellWhatTheRegistrySaw) {
  const Running running = Start();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto status, Status());
  ASSERT_EQ(status.agents_size(), 2);
  EXPECT_EQ(status.agents(0).state(), isoscope::v1::AgentStatus::STATE_REACHABLE);
  EXPECT_EQ(status.agents(0).version(), "1.2.3");
  EXPECT_EQ(status.agents(0).shards_size(), 1);

  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto list, List());
  ASSERT_EQ(list.datasets_size(), 1);
  EXPECT_EQ(list.datasets(0).name(), "head");
  EXPECT_EQ(list.datasets(0).missing_shards_size(), 0);

  isoscope::v1::GetDatasetRequest request;
  request.set_name("none");
  EXPECT_THAT(Call(datasets_, &isoscope::v1::DatasetService::Stub::GetDataset, request),
              StatusIs(absl::StatusCode::kNotFound));
  for (const std::string& name : {std::string("head"), list.datasets(0).dataset_id()}) {
    request.set_name(name);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto found,
        Call(datasets_, &isoscope::v1::DatasetService::Stub::GetDataset, request));
    EXPECT_EQ(found.dataset().name(), "head") << name;
    EXPECT_EQ(found.picture_revision(), status.agents(0).picture_revision());
  }

  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto capabilities,
      Call(cluster_, &isoscope::v1::ClusterService::Stub::GetCapabilities, {}));
  EXPECT_EQ(capabilities.max_concurrent_frame_count(), options_.max_concurrent_frames);
  EXPECT_FALSE(capabilities.version().empty());
}

TEST_F(IsosurfaceServiceTest, TheStatusOfTheClusterHasTheFramesInWorkAndWhatCameOfThem) {
  HeldFrames held(&second_);
  std::atomic<bool> has_traceparent{false};
  second_.on_frame = [&, play = second_.on_frame](grpc::ServerContext* context,
                                                  FakeAgent::FrameStream* stream) {
    has_traceparent = context->client_metadata().contains("traceparent");
    return play(context, stream);
  };
  const Running running = Start();
  const auto status = [&] { return Status().value(); };
  EXPECT_EQ(status().frames_size(), 0);
  std::thread client([&] { EXPECT_THAT(Render(FrameRequest()), IsOk()); });
  EXPECT_TRUE(held.AwaitOne());
  const isoscope::v1::GetClusterStatusResponse during = status();
  held.Release();
  client.join();
  EXPECT_TRUE(has_traceparent);
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
  WriteTokens({testing::TokenEntry("alice", "", R"("head")"),
               testing::TokenEntry("bob", "", R"("other")")});
  HeldFrames held(&second_);
  const Running running = Start();
  std::thread client(
      [&] { EXPECT_THAT(Render(FrameRequest(), testing::kLimit, "alice"), IsOk()); });
  EXPECT_TRUE(held.AwaitOne());
  EXPECT_EQ(Status("alice").value().frames_size(), 1);
  EXPECT_EQ(Status("bob").value().frames_size(), 0);
  held.Release();
  client.join();
}

TEST_F(IsosurfaceServiceTest, AFrameIsTracedOfAgentsThatTellNoTimesAndAPickIsRefused) {
  const Running running = Start();
  isoscope::v1::RenderIsosurfaceRequest request = FrameRequest();
  request.set_with_trace(true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto response, Render(request));
  ASSERT_EQ(response.trace().processes_size(), 1);
  EXPECT_EQ(response.trace().processes(0).name(), "coordinator");

  isoscope::v1::PickSurfaceRequest pick;
  *pick.mutable_frame() = request;
  pick.add_pixels();
  EXPECT_THAT(Call(frames_, &isoscope::v1::IsosurfaceService::Stub::PickSurface, pick),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("frame.with_trace")));
}

TEST_F(IsosurfaceServiceTest, MetricsCountFramesCallsAndTheAgentThatFailed) {
  second_.on_frame = Fail(grpc::StatusCode::DATA_LOSS, "block 7 is damaged");
  const Running running = Start();
  EXPECT_THAT(Render(FrameRequest()), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("block 7")));
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
  const Running running = Start();
  CoordinatorServerOptions options = options_;
  options.listen_address = first_.address();
  EXPECT_THAT(CoordinatorServer::Start(options),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr(first_.address())));
}

}  // namespace
}  // namespace isoscope::server
