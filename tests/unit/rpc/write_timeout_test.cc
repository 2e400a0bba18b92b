#include "rpc/write_timeout.h"

#include <functional>
#include <memory>
#include <utility>

#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gtest/gtest.h"
#include <grpcpp/client_context.h>

#include "core/base/monotonic_time.h"
#include "isoscope/v1/cluster_service.grpc.pb.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "tests/support/enough_time.h"
#include "tests/support/status_matchers.h"

namespace isoscope::rpc {
namespace {

namespace v1 = isoscope::v1;
using testing::IsOk;
using testing::StatusIs;

// Never answers by itself; ends when it is cancelled.
class Reactor final : public grpc::ServerUnaryReactor {
 public:
  explicit Reactor(grpc::CallbackServerContext* call) : context(call), timeout(call) {}
  void OnCancel() override { Finish(grpc::Status(grpc::StatusCode::CANCELLED, "cancelled")); }
  void OnDone() override {
    timeout.Stop();
    done.Notify();
  }
  grpc::CallbackServerContext* const context;
  WriteTimeout timeout;
  absl::Notification done;
};

class Service final : public v1::ClusterService::CallbackService {
 public:
  grpc::ServerUnaryReactor* GetCapabilities(grpc::CallbackServerContext* context,
                                            const v1::GetCapabilitiesRequest* /*request*/,
                                            v1::GetCapabilitiesResponse* /*response*/) override {
    reactor = std::make_unique<Reactor>(context);
    begin(reactor.get());
    return reactor.get();
  }
  std::function<void(Reactor*)> begin;
  std::unique_ptr<Reactor> reactor;
};

class WriteTimeoutTest : public ::testing::Test {
 protected:
  absl::Status Call(std::function<void(Reactor*)> begin) {
    service_.begin = std::move(begin);
    grpc::ServerBuilder builder;
    builder.RegisterService(&service_);
    const std::unique_ptr<grpc::Server> server = builder.BuildAndStart();
    grpc::ClientContext context;
    v1::GetCapabilitiesResponse response;
    const absl::Status status =
        ToAbslStatus(v1::ClusterService::NewStub(server->InProcessChannel({}))
                         ->GetCapabilities(&context, {}, &response));
    service_.reactor->done.WaitForNotification();
    return status;
  }
  // Expects that a write's limit has no effect once `forget` was called before it passed.
  void ExpectForgotten(absl::Duration limit, const std::function<void(WriteTimeout*)>& forget) {
    testing::WithEnoughTime(limit, [&](absl::Duration write_limit) {
      bool is_in_time = false;
      const absl::Status status = Call([&](Reactor* reactor) {
        reactor->timeout.Start(absl::Hours(1));
        const base::MonotonicTime begin = base::MonotonicNow();
        reactor->timeout.Start(write_limit);
        forget(&reactor->timeout);
        is_in_time = base::MonotonicNow() - begin < write_limit;
        if (!is_in_time) {
          reactor->context->TryCancel();  // which the alarm may have done
          return;
        }
        absl::SleepFor(3 * write_limit);
        reactor->Finish(grpc::Status::OK);
      });
      if (is_in_time) {
        EXPECT_THAT(status, IsOk());
      }
      return is_in_time;
    });
  }
  Service service_;
};

TEST_F(WriteTimeoutTest, ACallThatIsNotTakenIsCancelled) {
  EXPECT_THAT(Call([](Reactor* reactor) { reactor->timeout.Start(absl::Milliseconds(20)); }),
              StatusIs(absl::StatusCode::kCancelled));
}

TEST_F(WriteTimeoutTest, TheLastWriteCounts) {
  ExpectForgotten(absl::Milliseconds(20),
                  [](WriteTimeout* timeout) { timeout->Start(absl::Hours(1)); });
}

TEST_F(WriteTimeoutTest, NothingHappensAfterTheEnd) {
  EXPECT_THAT(Call([](Reactor* reactor) {
                reactor->timeout.Start(absl::Hours(1));
                reactor->Finish(grpc::Status::OK);
              }),
              IsOk());
  // The context is gone: an alarm that rang would use it (AddressSanitizer runs this test).
  service_.reactor->timeout.Start(absl::Milliseconds(1));
  absl::SleepFor(absl::Milliseconds(50));
}

TEST_F(WriteTimeoutTest, AnAlarmMayRingWhileItIsReplacedOrPaused) {
  Call([](Reactor* reactor) {
    for (int i = 0; i < 2000; ++i) {
      reactor->timeout.Start(absl::ZeroDuration());
      reactor->timeout.Start(absl::Microseconds(i % 50));
      reactor->timeout.Pause();
    }
    reactor->timeout.Start(absl::ZeroDuration());
  }).IgnoreError();  // it ends: no alarm waits for the lock of the thread that destroys it
}

TEST_F(WriteTimeoutTest, NoTimeRunsBetweenAWriteThatIsTakenAndTheNextOne) {
  ExpectForgotten(absl::Milliseconds(50), [](WriteTimeout* timeout) { timeout->Pause(); });
}

}  // namespace
}  // namespace isoscope::rpc
