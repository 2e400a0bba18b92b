// Interactive streams of a cluster of real processes: every view ends in the bytes of
// RenderIsosurface, whatever came before, and no client can hold another one up.

#include <cmath>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/time/clock.h"
#include "gtest/gtest.h"
#include <grpcpp/client_context.h>

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "isoscope/v1/interact_service.grpc.pb.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "tests/support/process_cluster.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

namespace v1 = isoscope::v1;
using ::testing::HasSubstr;
using testing::IsOk;
using testing::ProcessCluster;
using testing::StatusIs;

constexpr absl::Duration kLimit = absl::Minutes(2);

// A client of one stream.
class Viewer {
 public:
  explicit Viewer(const std::shared_ptr<grpc::Channel>& channel)
      : stub_(v1::InteractService::NewStub(channel)) {
    context_.set_deadline(base::MonotonicNow() + kLimit);
    stream_ = stub_->Interact(&context_);
  }
  ~Viewer() { context_.TryCancel(); }

  bool Send(std::int64_t sequence, const v1::RenderIsosurfaceRequest& frame,
            bool is_at_rest = false) {
    v1::InteractRequest request;
    request.mutable_view_state()->set_sequence_number(sequence);
    *request.mutable_view_state()->mutable_frame() = frame;
    request.mutable_view_state()->set_is_at_rest(is_at_rest);
    return SendRaw(request);
  }
  // From any thread.
  bool SendRaw(const v1::InteractRequest& request) {
    const base::MutexLock lock(&write_mutex_);
    return stream_->Write(request);
  }
  bool Shown(std::int64_t frame_number) {
    v1::InteractRequest request;
    request.mutable_frame_shown()->set_frame_number(frame_number);
    return SendRaw(request);
  }
  // The next answer; none at the end of the stream.
  std::optional<v1::InteractResponse> Read() {
    v1::InteractResponse response;
    if (!stream_->Read(&response)) {
      return std::nullopt;
    }
    return response;
  }
  // Reads and acknowledges until the exact frame or an error of `sequence`.
  std::optional<v1::InteractResponse> ReadLast(std::int64_t sequence) {
    while (std::optional<v1::InteractResponse> response = Read()) {
      Shown(response->frame_number());
      if (response->sequence_number() == sequence &&
          (response->is_exact() || response->has_error())) {
        return response;
      }
    }
    return std::nullopt;
  }
  void Cancel() { context_.TryCancel(); }
  void CloseSide() { stream_->WritesDone(); }
  absl::Status Finish() { return rpc::ToAbslStatus(stream_->Finish()); }

 private:
  std::unique_ptr<v1::InteractService::Stub> stub_;
  grpc::ClientContext context_;
  base::Mutex write_mutex_;  // one write at a time
  std::unique_ptr<grpc::ClientReaderWriter<v1::InteractRequest, v1::InteractResponse>> stream_;
};

class InteractTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const std::string dataset = temp_dir_.Sub("dataset");
    ISOSCOPE_ASSERT_OK(testing::MakeDataset(testing::GyroidVolume({43, 37, 29}), dataset, 2, 8));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(cluster_, ProcessCluster::Start(dataset, 2));
    channel_ = rpc::MakeFreshChannel(cluster_->address());
    stub_ = v1::IsosurfaceService::NewStub(channel_);
  }

  // Views on a circle around the volume.
  static v1::RenderIsosurfaceRequest FrameOf(int view) {
    v1::RenderIsosurfaceRequest request = testing::SmallRequest();
    request.mutable_viewport()->set_width_px(160);
    request.mutable_viewport()->set_height_px(120);
    v1::Camera* camera = request.mutable_camera();
    camera->mutable_eye()->set_x(90 - view);
    camera->mutable_eye()->set_y(60 + view);
    camera->mutable_eye()->set_z(70);
    camera->mutable_target()->set_x(21);
    camera->mutable_target()->set_y(18);
    camera->mutable_target()->set_z(14);
    camera->mutable_up()->set_y(1);
    camera->mutable_perspective()->set_fov_y_degrees(30);
    return request;
  }

  std::string Render(const v1::RenderIsosurfaceRequest& request) {
    grpc::ClientContext context;
    context.set_deadline(base::MonotonicNow() + kLimit);
    v1::RenderIsosurfaceResponse response;
    ISOSCOPE_EXPECT_OK(rpc::ToAbslStatus(stub_->RenderIsosurface(&context, request, &response)));
    return response.png();
  }

  testing::TempDir temp_dir_;
  std::unique_ptr<ProcessCluster> cluster_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::IsosurfaceService::Stub> stub_;
};

TEST_F(InteractTest, ADragEndsInTheBytesOfRenderIsosurface) {
  Viewer viewer(channel_);
  constexpr int kStates = 40;
  std::thread sender([&] {
    for (int i = 1; i <= kStates; ++i) {
      EXPECT_TRUE(viewer.Send(i, FrameOf(i)));
      absl::SleepFor(absl::Milliseconds(10));
    }
  });
  int moving_count = 0;
  std::int64_t last_sequence = 0;
  std::int64_t last_number = 0;
  std::optional<v1::InteractResponse> exact;
  while (std::optional<v1::InteractResponse> response = viewer.Read()) {
    EXPECT_FALSE(response->has_error()) << response->error().message();
    EXPECT_EQ(response->frame_number(), last_number + 1);
    EXPECT_GE(response->sequence_number(), last_sequence) << "frames never go back";
    last_number = response->frame_number();
    last_sequence = response->sequence_number();
    viewer.Shown(last_number);
    EXPECT_EQ(response->frame().camera().eye().x(), 90.0 - static_cast<double>(last_sequence))
        << "a frame carries its camera";
    EXPECT_GT(response->depth_grid().width(), 0);
    EXPECT_EQ(response->depth_grid().depths().size(),
              static_cast<std::size_t>(2 * response->depth_grid().width() *
                                       response->depth_grid().height()));
    EXPECT_LE(response->depth_grid().near(), response->depth_grid().far());
    if (response->is_exact() && last_sequence == kStates) {
      exact = std::move(response);
      break;
    }
    if (!response->is_exact()) {
      ++moving_count;
      EXPECT_TRUE(response->frame().png().empty());
      EXPECT_TRUE(absl::StartsWith(response->frame().jpeg(), "\xFF\xD8"));
      EXPECT_TRUE(absl::EndsWith(response->frame().jpeg(), "\xFF\xD9"));
      EXPECT_GT(response->frame().extent().width_px(), 0);
    }
  }
  sender.join();
  ASSERT_TRUE(exact.has_value());
  EXPECT_GT(moving_count, 0);
  EXPECT_EQ(exact->sequence_number(), kStates);
  EXPECT_EQ(exact->frame().png(), Render(FrameOf(kStates)));
}

TEST_F(InteractTest, AStateAtRestIsAnsweredWithTheExactFrameAlone) {
  Viewer viewer(channel_);
  v1::RenderIsosurfaceRequest request = FrameOf(3);
  request.set_samples(4);
  request.mutable_ambient_occlusion();
  ASSERT_TRUE(viewer.Send(1, request, /*is_at_rest=*/true));
  const std::optional<v1::InteractResponse> response = viewer.Read();
  ASSERT_TRUE(response.has_value());
  EXPECT_TRUE(response->is_exact());
  EXPECT_EQ(response->frame().png(), Render(request));
  EXPECT_EQ(response->depth_grid().width(), 256);
}

TEST_F(InteractTest, AFrameThatFailsIsToldAndTheStreamGoesOn) {
  Viewer viewer(channel_);
  v1::RenderIsosurfaceRequest wrong = FrameOf(0);
  wrong.set_dataset("nothing");
  ASSERT_TRUE(viewer.Send(1, wrong));
  std::optional<v1::InteractResponse> response = viewer.ReadLast(1);
  ASSERT_TRUE(response.has_value());
  EXPECT_EQ(response->error().code(), static_cast<int>(absl::StatusCode::kNotFound));
  EXPECT_THAT(response->error().message(), HasSubstr("nothing"));
  EXPECT_FALSE(response->has_frame());

  wrong = FrameOf(0);
  wrong.mutable_viewport()->set_width_px(0);
  ASSERT_TRUE(viewer.Send(2, wrong));
  response = viewer.ReadLast(2);
  ASSERT_TRUE(response.has_value());
  EXPECT_EQ(response->error().code(), static_cast<int>(absl::StatusCode::kInvalidArgument));
  EXPECT_THAT(response->error().message(), HasSubstr("viewport.width_px is 0"));

  wrong = FrameOf(0);
  wrong.mutable_output()->set_depth(true);
  ASSERT_TRUE(viewer.Send(3, wrong));
  response = viewer.ReadLast(3);
  ASSERT_TRUE(response.has_value());
  EXPECT_EQ(response->error().code(), static_cast<int>(absl::StatusCode::kInvalidArgument));

  ASSERT_TRUE(viewer.Send(4, FrameOf(4)));
  response = viewer.ReadLast(4);
  ASSERT_TRUE(response.has_value());
  EXPECT_EQ(response->frame().png(), Render(FrameOf(4)));
}

TEST_F(InteractTest, WrongMessagesEndTheStreamAndSayWhy) {
  struct Case {
    const char* expected;
    std::vector<v1::InteractRequest> messages;
  };
  const auto state = [](std::int64_t sequence, double rate) {
    v1::InteractRequest request;
    request.mutable_view_state()->set_sequence_number(sequence);
    request.mutable_view_state()->set_target_frames_per_second(rate);
    *request.mutable_view_state()->mutable_frame() = FrameOf(0);
    return request;
  };
  v1::InteractRequest shown;
  shown.mutable_frame_shown()->set_frame_number(9);
  shown.mutable_frame_shown()->mutable_decode_duration()->set_seconds(-1);
  v1::InteractRequest unknown = state(1, 0);
  unknown.GetReflection()->MutableUnknownFields(&unknown)->AddVarint(77, 1);
  for (const Case& wrong :
       {Case{"kind is not set", {v1::InteractRequest()}},
        Case{"sequence_number is 0: must be greater", {state(0, 0)}},
        Case{"sequence_number is 5: must be greater than that of the state before, 5",
             {state(5, 0), state(5, 0)}},
        Case{"target_frames_per_second is 0.5", {state(1, 0.5)}},
        Case{"target_frames_per_second is nan", {state(1, std::nan(""))}},
        Case{"decode_duration is -1s", {shown}}, Case{"77", {unknown}}}) {
    Viewer viewer(channel_);
    for (const v1::InteractRequest& message : wrong.messages) {
      viewer.SendRaw(message);
    }
    while (viewer.Read().has_value()) {
    }
    EXPECT_THAT(viewer.Finish(),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(wrong.expected)));
  }
}

TEST_F(InteractTest, AClientThatNeitherReadsNorAcknowledgesHoldsNobodyUp) {
  Viewer stalled(channel_);
  Viewer other(rpc::MakeFreshChannel(cluster_->address()));
  for (int i = 1; i <= 200; ++i) {
    ASSERT_TRUE(stalled.Send(i, FrameOf(i % 40)));
  }
  for (int i = 1; i <= 5; ++i) {
    ASSERT_TRUE(other.Send(i, FrameOf(i), /*is_at_rest=*/true));
    const std::optional<v1::InteractResponse> response = other.ReadLast(i);
    ASSERT_TRUE(response.has_value());
    EXPECT_EQ(response->frame().png(), Render(FrameOf(i)));
  }
}

TEST_F(InteractTest, EightViewersGetTheirOwnPictures) {
  std::vector<std::thread> threads;
  for (int v = 0; v < 8; ++v) {
    threads.emplace_back([&, v] {
      Viewer viewer(rpc::MakeFreshChannel(cluster_->address()));
      for (int i = 1; i <= 10; ++i) {
        EXPECT_TRUE(viewer.Send(i, FrameOf(10 * v + i)));
      }
      const std::optional<v1::InteractResponse> response = viewer.ReadLast(10);
      ASSERT_TRUE(response.has_value());
      EXPECT_EQ(response->frame().png(), Render(FrameOf(10 * v + 10)));
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
}

TEST_F(InteractTest, StreamsEndWhenTheClientClosesCancelsOrGoes) {
  {
    Viewer closes(channel_);
    ASSERT_TRUE(closes.Send(1, FrameOf(1)));
    closes.CloseSide();
    while (closes.Read().has_value()) {
    }
    EXPECT_THAT(closes.Finish(), IsOk());
  }
  {
    Viewer cancels(channel_);
    ASSERT_TRUE(cancels.Send(1, FrameOf(1)));
    cancels.Cancel();
    while (cancels.Read().has_value()) {
    }
    EXPECT_EQ(cancels.Finish().code(), absl::StatusCode::kCancelled);
  }
  EXPECT_FALSE(Render(FrameOf(2)).empty()) << "the coordinator lives on";
}

TEST_F(InteractTest, AnIdleStreamDoesNotHoldTheCoordinatorsEndUp) {
  Viewer viewer(channel_);
  ASSERT_TRUE(viewer.Send(1, FrameOf(1)));
  ASSERT_TRUE(viewer.ReadLast(1).has_value());
  cluster_->coordinator().Signal(SIGTERM);
  while (viewer.Read().has_value()) {
  }
  EXPECT_THAT(viewer.Finish(),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr("the coordinator stops")));
}

}  // namespace
}  // namespace isoscope
