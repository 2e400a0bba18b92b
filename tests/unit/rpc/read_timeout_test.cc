#include "rpc/read_timeout.h"

#include <functional>
#include <memory>
#include <utility>

#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gtest/gtest.h"
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include "core/base/monotonic_time.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "rpc/grpc_status.h"
#include "tests/support/enough_time.h"
#include "tests/support/status_matchers.h"

namespace isoscope::rpc {
namespace {

namespace v1 = isoscope::v1;
using testing::IsOk;
using testing::StatusIs;

using Writer = grpc::ServerWriter<v1::ExportIsosurfaceResponse>;

// A thread of its own for each call, so that a script may block.
class Service final : public v1::IsosurfaceService::Service {
 public:
  explicit Service(std::function<void(grpc::ServerContext*, Writer*)> script)
      : script_(std::move(script)) {}
  grpc::Status ExportIsosurface(grpc::ServerContext* context,
                                const v1::ExportIsosurfaceRequest* /*request*/,
                                Writer* writer) override {
    script_(context, writer);
    return context->IsCancelled() ? grpc::Status::CANCELLED : grpc::Status::OK;
  }

 private:
  const std::function<void(grpc::ServerContext*, Writer*)> script_;
};

void WaitUntilCancelled(grpc::ServerContext* context) {
  while (!context->IsCancelled()) {
    absl::SleepFor(absl::Milliseconds(1));
  }
}

struct Outcome {
  int message_count = 0;
  bool is_silent = false;
  absl::Status status;
};

// A machine under load keeps it, too.
constexpr absl::Duration kEnough = absl::Minutes(2);

// Reads to the end: `sent_count` messages within kEnough each, and what follows within `timeout`.
Outcome ReadAll(std::function<void(grpc::ServerContext*, Writer*)> script, int sent_count,
                absl::Duration timeout) {
  Service service(std::move(script));
  grpc::ServerBuilder builder;
  builder.RegisterService(&service);
  const std::unique_ptr<grpc::Server> server = builder.BuildAndStart();
  const auto stub = v1::IsosurfaceService::NewStub(server->InProcessChannel({}));
  grpc::ClientContext context;
  const auto reader = stub->ExportIsosurface(&context, {});
  Outcome outcome;
  while (true) {
    v1::ExportIsosurfaceResponse message;
    ReadTimeout silence(&context, outcome.message_count < sent_count ? kEnough : timeout);
    const bool has_message = reader->Read(&message);
    outcome.is_silent = silence.Stop();
    if (!has_message) {
      break;
    }
    ++outcome.message_count;
  }
  outcome.status = ToAbslStatus(reader->Finish());
  return outcome;
}

TEST(ReadTimeoutTest, AServerThatNeverSendsIsCancelledAndToldApartFromOtherErrors) {
  const Outcome outcome =
      ReadAll([](grpc::ServerContext* context, Writer*) { WaitUntilCancelled(context); }, 0,
              absl::Milliseconds(20));
  EXPECT_TRUE(outcome.is_silent);
  EXPECT_THAT(outcome.status, StatusIs(absl::StatusCode::kCancelled));
}

TEST(ReadTimeoutTest, AServerThatFallsSilentIsCancelledAfterWhatItSent) {
  const Outcome outcome = ReadAll(
      [](grpc::ServerContext* context, Writer* writer) {
        writer->Write({});
        writer->Write({});
        WaitUntilCancelled(context);
      },
      2, absl::Milliseconds(20));
  EXPECT_TRUE(outcome.is_silent);
  EXPECT_EQ(outcome.message_count, 2);
}

TEST(ReadTimeoutTest, AServerThatSendsInTimeIsReadToItsEnd) {
  const Outcome outcome = ReadAll(
      [](grpc::ServerContext*, Writer* writer) {
        for (int i = 0; i < 5; ++i) {
          writer->Write({});
        }
      },
      5, kEnough);
  EXPECT_FALSE(outcome.is_silent);
  EXPECT_EQ(outcome.message_count, 5);
  EXPECT_THAT(outcome.status, IsOk());
}

TEST(ReadTimeoutTest, AfterTheReadTheCallIsLeftAlone) {
  const auto service = std::make_unique<Service>([](grpc::ServerContext*, Writer* writer) {
    writer->Write({});
    writer->Write({});
  });
  grpc::ServerBuilder builder;
  builder.RegisterService(service.get());
  const std::unique_ptr<grpc::Server> server = builder.BuildAndStart();
  const auto stub = v1::IsosurfaceService::NewStub(server->InProcessChannel({}));
  testing::WithEnoughTime(absl::Milliseconds(200), [&](absl::Duration limit) {
    grpc::ClientContext context;
    const auto reader = stub->ExportIsosurface(&context, {});
    v1::ExportIsosurfaceResponse message;
    {
      const base::MonotonicTime begin = base::MonotonicNow();
      ReadTimeout silence(&context, limit);
      const bool has_message = reader->Read(&message);
      const bool is_silent = silence.Stop();
      if (base::MonotonicNow() - begin >= limit) {
        while (reader->Read(&message)) {
        }
        reader->Finish();
        return false;
      }
      EXPECT_TRUE(has_message);
      EXPECT_FALSE(is_silent);
    }
    absl::SleepFor(limit + absl::Milliseconds(100));  // the time passes outside of a read
    EXPECT_TRUE(reader->Read(&message));
    EXPECT_FALSE(reader->Read(&message));
    EXPECT_THAT(ToAbslStatus(reader->Finish()), IsOk());
    return true;
  });
}

}  // namespace
}  // namespace isoscope::rpc
