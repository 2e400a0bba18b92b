#include "clients/cpp/connection/service_client.h"

#include <atomic>
#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include "core/base/monotonic_time.h"
#include "core/base/retry_delay.h"
#include "isoscope/v1/cluster_service.grpc.pb.h"
#include "isoscope/v1/dataset_service.grpc.pb.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "rpc/grpc_status.h"
#include "tests/support/enough_time.h"
#include "tests/support/status_matchers.h"

namespace isoscope::client {
namespace {

namespace v1 = isoscope::v1;
using isoscope::testing::IsOk;
using isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr absl::Duration kShort = absl::Milliseconds(50);
constexpr absl::Duration kSignInterval = absl::Milliseconds(100);

// Never answers; ends when its client has gone.
grpc::Status Hang(grpc::ServerContext* context) {
  while (!context->IsCancelled()) {
    absl::SleepFor(absl::Milliseconds(1));
  }
  return grpc::Status::CANCELLED;
}

class HangingDatasets final : public v1::DatasetService::Service {
 public:
  grpc::Status GetDataset(grpc::ServerContext* context, const v1::GetDatasetRequest*,
                          v1::GetDatasetResponse*) override {
    return Hang(context);
  }
  grpc::Status GetHistogram(grpc::ServerContext* context, const v1::GetHistogramRequest*,
                            v1::GetHistogramResponse*) override {
    return Hang(context);
  }
  grpc::Status ListDatasets(grpc::ServerContext* context, const v1::ListDatasetsRequest*,
                            v1::ListDatasetsResponse*) override {
    return Hang(context);
  }
};

class HangingCluster final : public v1::ClusterService::Service {
 public:
  grpc::Status GetCapabilities(grpc::ServerContext* context, const v1::GetCapabilitiesRequest*,
                               v1::GetCapabilitiesResponse*) override {
    return Hang(context);
  }
  grpc::Status GetClusterStatus(grpc::ServerContext* context, const v1::GetClusterStatusRequest*,
                                v1::GetClusterStatusResponse*) override {
    return Hang(context);
  }
};

// Hangs, after some parts or chunks.
class HangingSurfaces final : public v1::IsosurfaceService::Service {
 public:
  grpc::Status RenderIsosurface(grpc::ServerContext* context, const v1::RenderIsosurfaceRequest*,
                                v1::RenderIsosurfaceResponse*) override {
    return Hang(context);
  }
  grpc::Status RenderIsosurfaceStream(
      grpc::ServerContext* context, const v1::RenderIsosurfaceStreamRequest*,
      grpc::ServerWriter<v1::RenderIsosurfaceStreamResponse>* writer) override {
    writer->Write({});
    return Hang(context);
  }
  grpc::Status PickSurface(grpc::ServerContext* context, const v1::PickSurfaceRequest*,
                           v1::PickSurfaceResponse*) override {
    return Hang(context);
  }
  grpc::Status ExportIsosurface(grpc::ServerContext* context, const v1::ExportIsosurfaceRequest*,
                                grpc::ServerWriter<v1::ExportIsosurfaceResponse>* writer) override {
    base::MonotonicTime last = base::MonotonicNow();
    for (int i = 0; i < sign_count; ++i) {
      absl::SleepFor(kSignInterval);
      const base::MonotonicTime now = base::MonotonicNow();
      was_slow = was_slow || now - last > slow_pause;
      last = now;
      if (!writer->Write({})) {
        return grpc::Status::CANCELLED;
      }
    }
    v1::ExportIsosurfaceResponse chunk;
    chunk.mutable_measures();
    for (int i = 0; i < chunk_count; ++i) {
      writer->Write(chunk);
    }
    ++export_count;
    if (hangs) {
      return Hang(context);
    }
    return refusals_left-- > 0
               ? rpc::ToGrpcStatus(base::WithRetryDelay(
                     absl::UnavailableError("an agent is restarting"), absl::Milliseconds(1)))
               : grpc::Status::OK;
  }

  int sign_count = 0;
  absl::Duration slow_pause = absl::InfiniteDuration();  // between two signs
  std::atomic<bool> was_slow{false};
  int chunk_count = 0;
  std::atomic<int> export_count{0};
  std::atomic<int> refusals_left{0};
  bool hangs = true;
};

class ServiceClientTest : public ::testing::Test {
 protected:
  void SetUp() override {
    grpc::ServerBuilder builder;
    builder.RegisterService(&datasets_);
    builder.RegisterService(&cluster_);
    builder.RegisterService(&surfaces_);
    server_ = builder.BuildAndStart();
    client_ = std::make_unique<ServiceClient>(server_->InProcessChannel({}), "", &interrupt_, "");
  }

  HangingDatasets datasets_;
  HangingCluster cluster_;
  HangingSurfaces surfaces_;
  std::unique_ptr<grpc::Server> server_;
  cli::Interrupt interrupt_;
  std::unique_ptr<ServiceClient> client_;
};

TEST_F(ServiceClientTest, EveryCallToAServerThatNeverAnswersEndsAndNamesTheFlag) {
  const auto ends = StatusIs(absl::StatusCode::kDeadlineExceeded, HasSubstr("--timeout"));
  EXPECT_THAT(client_->GetDataset("", kShort), ends);
  EXPECT_THAT(client_->GetHistogram({}, kShort), ends);
  EXPECT_THAT(client_->ListDatasets(kShort), ends);
  EXPECT_THAT(client_->GetCapabilities(kShort), ends);
  EXPECT_THAT(client_->GetClusterStatus(kShort), ends);
  EXPECT_THAT(client_->RenderIsosurface({}, kShort), ends);
  EXPECT_THAT(client_->RenderIsosurfaceStream({}, kShort), ends);
  EXPECT_THAT(client_->PickSurface({}, kShort), ends);
  const auto ignore = [](const v1::ExportIsosurfaceResponse&) { return absl::OkStatus(); };
  EXPECT_THAT(client_->ExportIsosurface({}, kShort, ignore), ends);
}

TEST_F(ServiceClientTest, AnExportWithoutADeadlineEndsWhenTheServerIsSilent) {
  for (const int chunk_count : {0, 3}) {
    surfaces_.chunk_count = chunk_count;
    isoscope::testing::WithEnoughTime(absl::Milliseconds(500), [&](absl::Duration silence) {
      int seen = 0;
      const auto count = [&](const v1::ExportIsosurfaceResponse&) {
        ++seen;
        return absl::OkStatus();
      };
      EXPECT_THAT(
          client_->ExportIsosurface({}, absl::InfiniteDuration(), count, silence),
          StatusIs(
              absl::StatusCode::kDeadlineExceeded,
              AllOf(HasSubstr(absl::StrCat("sent nothing for ", absl::FormatDuration(silence))),
                    Not(HasSubstr("--timeout")))));
      EXPECT_LE(seen, chunk_count);
      return seen == chunk_count;
    });
  }
}

// Signs of life are no chunks: the client waits on, and may still try again.
TEST_F(ServiceClientTest, AServerThatWorksForLongIsWaitedForWhileItTellsSo) {
  surfaces_.chunk_count = 1;
  surfaces_.hangs = false;
  int seen = 0;
  const auto count = [&](const v1::ExportIsosurfaceResponse&) {
    ++seen;
    return absl::OkStatus();
  };
  isoscope::testing::WithEnoughTime(absl::Seconds(2), [&](absl::Duration silence) {
    surfaces_.sign_count = static_cast<int>(1.5 * silence / kSignInterval);
    surfaces_.slow_pause = silence / 4;
    surfaces_.was_slow = false;
    const absl::Status status =
        client_->ExportIsosurface({}, absl::InfiniteDuration(), count, silence);
    if (absl::IsDeadlineExceeded(status) && surfaces_.was_slow) {
      return false;  // it did not tell so in time
    }
    EXPECT_THAT(status, IsOk());
    return true;
  });
  EXPECT_EQ(seen, 1);
  surfaces_.sign_count = 1;
  surfaces_.chunk_count = 0;
  surfaces_.export_count = 0;
  surfaces_.refusals_left = 1;
  EXPECT_THAT(client_->ExportIsosurface({}, absl::Seconds(60), count), IsOk());
  EXPECT_EQ(surfaces_.export_count, 2);
  EXPECT_EQ(seen, 1);
}

TEST_F(ServiceClientTest, AnExportWhoseChunksComeIsReadToItsEnd) {
  surfaces_.chunk_count = 5;
  surfaces_.hangs = false;
  int seen = 0;
  EXPECT_THAT(client_->ExportIsosurface({}, absl::InfiniteDuration(),
                                        [&](const v1::ExportIsosurfaceResponse&) {
                                          ++seen;
                                          return absl::OkStatus();
                                        }),
              IsOk());
  EXPECT_EQ(seen, 5);
}

// Visited chunks can't be undone: a second attempt would repeat the first chunks of a mesh.
TEST_F(ServiceClientTest, AnExportThatBreaksIsTriedAgainOnlyBeforeItsFirstChunk) {
  surfaces_.hangs = false;
  surfaces_.refusals_left = 1;
  int seen = 0;
  const auto count = [&](const v1::ExportIsosurfaceResponse&) {
    ++seen;
    return absl::OkStatus();
  };
  EXPECT_THAT(client_->ExportIsosurface({}, absl::Seconds(60), count), IsOk());
  EXPECT_EQ(surfaces_.export_count, 2);
  surfaces_.export_count = 0;
  surfaces_.refusals_left = 1;
  surfaces_.chunk_count = 2;
  EXPECT_THAT(client_->ExportIsosurface({}, absl::Seconds(60), count),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr("restarting")));
  EXPECT_EQ(surfaces_.export_count, 1);
  EXPECT_EQ(seen, 2);
}

TEST_F(ServiceClientTest, AnInterruptEndsACallThatWouldTakeLong) {
  interrupt_.Trigger();
  EXPECT_THAT(client_->GetDataset("", kAnswerTimeout), StatusIs(absl::StatusCode::kCancelled));
}

}  // namespace
}  // namespace isoscope::client
