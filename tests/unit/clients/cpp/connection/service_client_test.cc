#include "clients/cpp/connection/service_client.h"

#include <atomic>
#include <map>
#include <memory>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
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

struct ExportScript {
  int sign_count = 0;
  absl::Duration slow_pause = absl::InfiniteDuration();  // between two signs
  int chunk_count = 0;
  int refusal_count = 0;
  bool hangs = true;
};

// The exports of one request, and what came of them.
struct ScriptedExport {
  explicit ScriptedExport(const ExportScript& what)
      : script(what), refusals_left(what.refusal_count) {}

  // A call may go on after its client has left: another script is another request.
  const ExportScript script;
  v1::ExportIsosurfaceRequest request;
  std::atomic<int> refusals_left;
  std::atomic<bool> was_slow{false};
  std::atomic<int> export_count{0};
};

// Hangs, after some parts or chunks.
class HangingSurfaces final : public v1::IsosurfaceService::Service {
 public:
  ScriptedExport& Serve(const ExportScript& script) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    const std::string dataset = absl::StrCat("dataset ", exports_.size());
    ScriptedExport& served =
        *exports_.emplace(dataset, std::make_unique<ScriptedExport>(script)).first->second;
    served.request.set_dataset(dataset);
    return served;
  }

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
  grpc::Status ExportIsosurface(grpc::ServerContext* context,
                                const v1::ExportIsosurfaceRequest* request,
                                grpc::ServerWriter<v1::ExportIsosurfaceResponse>* writer) override {
    ScriptedExport& served = Find(request->dataset());
    const ExportScript& script = served.script;
    base::MonotonicTime last = base::MonotonicNow();
    for (int i = 0; i < script.sign_count; ++i) {
      absl::SleepFor(kSignInterval);
      const base::MonotonicTime now = base::MonotonicNow();
      if (now - last > script.slow_pause) {
        served.was_slow = true;
      }
      last = now;
      if (!writer->Write({})) {
        return grpc::Status::CANCELLED;
      }
    }
    v1::ExportIsosurfaceResponse chunk;
    chunk.mutable_measures();
    for (int i = 0; i < script.chunk_count; ++i) {
      writer->Write(chunk);
    }
    ++served.export_count;
    if (script.hangs) {
      return Hang(context);
    }
    return served.refusals_left-- > 0
               ? rpc::ToGrpcStatus(base::WithRetryDelay(
                     absl::UnavailableError("an agent is restarting"), absl::Milliseconds(1)))
               : grpc::Status::OK;
  }

 private:
  ScriptedExport& Find(const std::string& dataset) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    return *exports_.at(dataset);
  }

  base::Mutex mutex_;
  std::map<std::string, std::unique_ptr<ScriptedExport>> exports_ ABSL_GUARDED_BY(mutex_);
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
  EXPECT_THAT(client_->ExportIsosurface(surfaces_.Serve({}).request, kShort, ignore), ends);
}

TEST_F(ServiceClientTest, AnExportWithoutADeadlineEndsWhenTheServerIsSilent) {
  for (const int chunk_count : {0, 3}) {
    const ScriptedExport& served = surfaces_.Serve({.chunk_count = chunk_count});
    isoscope::testing::WithEnoughTime(absl::Milliseconds(500), [&](absl::Duration silence) {
      int seen = 0;
      const auto count = [&](const v1::ExportIsosurfaceResponse&) {
        ++seen;
        return absl::OkStatus();
      };
      EXPECT_THAT(
          client_->ExportIsosurface(served.request, absl::InfiniteDuration(), count, silence),
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
  int seen = 0;
  const auto count = [&](const v1::ExportIsosurfaceResponse&) {
    ++seen;
    return absl::OkStatus();
  };
  isoscope::testing::WithEnoughTime(absl::Seconds(2), [&](absl::Duration silence) {
    seen = 0;
    const ScriptedExport& served =
        surfaces_.Serve({.sign_count = static_cast<int>(1.5 * silence / kSignInterval),
                         .slow_pause = silence / 4,
                         .chunk_count = 1,
                         .hangs = false});
    const absl::Status status =
        client_->ExportIsosurface(served.request, absl::InfiniteDuration(), count, silence);
    if (absl::IsDeadlineExceeded(status) && served.was_slow) {
      return false;  // it did not tell so in time
    }
    EXPECT_THAT(status, IsOk());
    return true;
  });
  EXPECT_EQ(seen, 1);
  const ScriptedExport& refused =
      surfaces_.Serve({.sign_count = 1, .refusal_count = 1, .hangs = false});
  EXPECT_THAT(client_->ExportIsosurface(refused.request, absl::Seconds(60), count), IsOk());
  EXPECT_EQ(refused.export_count, 2);
  EXPECT_EQ(seen, 1);
}

TEST_F(ServiceClientTest, AnExportWhoseChunksComeIsReadToItsEnd) {
  int seen = 0;
  EXPECT_THAT(client_->ExportIsosurface(surfaces_.Serve({.chunk_count = 5, .hangs = false}).request,
                                        absl::InfiniteDuration(),
                                        [&](const v1::ExportIsosurfaceResponse&) {
                                          ++seen;
                                          return absl::OkStatus();
                                        }),
              IsOk());
  EXPECT_EQ(seen, 5);
}

// Visited chunks can't be undone: a second attempt would repeat the first chunks of a mesh.
TEST_F(ServiceClientTest, AnExportThatBreaksIsTriedAgainOnlyBeforeItsFirstChunk) {
  int seen = 0;
  const auto count = [&](const v1::ExportIsosurfaceResponse&) {
    ++seen;
    return absl::OkStatus();
  };
  const ScriptedExport& before = surfaces_.Serve({.refusal_count = 1, .hangs = false});
  EXPECT_THAT(client_->ExportIsosurface(before.request, absl::Seconds(60), count), IsOk());
  EXPECT_EQ(before.export_count, 2);
  const ScriptedExport& after =
      surfaces_.Serve({.chunk_count = 2, .refusal_count = 1, .hangs = false});
  EXPECT_THAT(client_->ExportIsosurface(after.request, absl::Seconds(60), count),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr("restarting")));
  EXPECT_EQ(after.export_count, 1);
  EXPECT_EQ(seen, 2);
}

TEST_F(ServiceClientTest, AnInterruptEndsACallThatWouldTakeLong) {
  interrupt_.Trigger();
  EXPECT_THAT(client_->GetDataset("", kAnswerTimeout), StatusIs(absl::StatusCode::kCancelled));
}

}  // namespace
}  // namespace isoscope::client
