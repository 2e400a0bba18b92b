// Agents, coordinators and gateways whose date jumps by an hour, back and forth, while they work.
// Each wait of the test ends long before that hour: whatever counts by the date fails here.

#include <csignal>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <grpcpp/client_context.h>
#include <openssl/sha.h>

#include "core/base/monotonic_time.h"
#include "core/io/atomic_file.h"
#include "isoscope/v1/cluster_service.grpc.pb.h"
#include "isoscope/v1/interact_service.grpc.pb.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "rpc/peer.h"
#include "tests/support/jumping_clock.h"
#include "tests/support/process_cluster.h"
#include "tests/support/raw_connection.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

namespace v1 = isoscope::v1;
using ::testing::HasSubstr;
using testing::IsOk;
using testing::kPatience;
using testing::ServerProcess;
using ::testing::StartsWith;
using testing::StatusIs;

std::string TokenEntry(const std::string& token, const std::string& more = "") {
  unsigned char digest[SHA256_DIGEST_LENGTH];
  SHA256(reinterpret_cast<const unsigned char*>(token.data()), token.size(), digest);
  return absl::StrCat(R"({"name": ")", token, R"(", "sha256": ")",
                      absl::BytesToHexString(
                          absl::string_view(reinterpret_cast<const char*>(digest), sizeof(digest))),
                      R"(", "datasets": ["*"])", more, "}");
}

// A coordinator with two replicas of one shard, and a gateway. All jump.
class ClockJumpTest : public ::testing::TestWithParam<int> {
 protected:
  void SetUp() override {
    ISOSCOPE_ASSERT_OK(testing::MakeDataset(testing::GyroidVolume({29, 27, 25}), folder_.Sub("d"),
                                            /*shard_count=*/1, 8));
    WriteTokens({TokenEntry("all"), TokenEntry("gone"),
                 TokenEntry("rare", R"(, "max_frames_per_second": 0.2)")});
    for (ServerProcess& agent : agents_) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(
          agent, testing::StartAgent({testing::ShardDirectory(folder_.Sub("d"), 0, 1)}));
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        coordinator_,
        testing::StartCoordinator({agents_[0].address, agents_[1].address},
                                  {"--tokens", folder_.Sub("tokens"), "--poll-seconds", "1",
                                   "--max-frame-seconds", "20"}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(gateway_,
                                  testing::StartGateway(coordinator_.address, {"--user-tokens"}));
    channel_ = rpc::MakeFreshChannel(coordinator_.address);
  }

  void WriteTokens(const std::vector<std::string>& entries) {
    ISOSCOPE_ASSERT_OK(io::WriteFileAtomically(
        folder_.Sub("tokens"), absl::StrCat("{\"tokens\": [", absl::StrJoin(entries, ", "), "]}")));
  }
  void Jump() { clock_.SetOffset(absl::Hours(GetParam())); }

  [[nodiscard]] absl::Status Render(const std::string& token,
                                    absl::Duration timeout = kPatience) const {
    grpc::ClientContext context;
    context.set_deadline(base::MonotonicNow() + timeout);
    rpc::SendToken(token, &context);
    v1::RenderIsosurfaceResponse response;
    return rpc::ToAbslStatus(v1::IsosurfaceService::NewStub(channel_)->RenderIsosurface(
        &context, testing::SmallRequest(), &response));
  }
  // Repeats `ask` until its result is of that code. Fails after kPatience.
  template <typename Ask>
  void Await(absl::StatusCode code, const Ask& ask) {
    const base::MonotonicTime end = base::MonotonicNow() + kPatience;
    absl::Status status = ask();
    while (status.code() != code && base::MonotonicNow() < end) {
      absl::SleepFor(absl::Milliseconds(50));
      status = ask();
    }
    EXPECT_EQ(status.code(), code) << status;
  }
  // OK once the coordinator says that this many agents are reachable.
  [[nodiscard]] absl::Status HasReachable(int count) const {
    grpc::ClientContext context;
    context.set_deadline(base::MonotonicNow() + kPatience);
    rpc::SendToken("all", &context);
    v1::GetClusterStatusResponse response;
    const absl::Status status = rpc::ToAbslStatus(
        v1::ClusterService::NewStub(channel_)->GetClusterStatus(&context, {}, &response));
    int reachable = 0;
    for (const v1::AgentStatus& agent : response.agents()) {
      reachable += agent.state() == v1::AgentStatus::STATE_REACHABLE ? 1 : 0;
    }
    return !status.ok()         ? status
           : reachable == count ? absl::OkStatus()
                                : absl::AbortedError(absl::StrCat(reachable, " are reachable"));
  }
  [[nodiscard]] int gateway_port() const { return testing::PortOf(gateway_.address); }

  testing::TempDir folder_;
  testing::JumpingClock clock_;
  ServerProcess agents_[2];
  ServerProcess coordinator_;
  ServerProcess gateway_;
  std::shared_ptr<grpc::Channel> channel_;
};

INSTANTIATE_TEST_SUITE_P(Hours, ClockJumpTest, ::testing::Values(-1, 1));

TEST_P(ClockJumpTest, AWithdrawnTokenIsRefused) {
  ASSERT_THAT(Render("gone"), IsOk());
  Jump();
  WriteTokens({TokenEntry("all")});
  Await(absl::StatusCode::kUnauthenticated, [&] { return Render("gone"); });
  EXPECT_THAT(Render("all"), IsOk());
}

// The watch for calls that are idle sleeps when the date jumps.
TEST_P(ClockJumpTest, TheIdleStreamOfAWithdrawnTokenEnds) {
  grpc::ClientContext context;
  context.set_deadline(base::MonotonicNow() + kPatience);
  rpc::SendToken("gone", &context);
  const auto stub = v1::InteractService::NewStub(channel_);
  const auto stream = stub->Interact(&context);
  v1::InteractRequest request;
  request.mutable_view_state()->set_sequence_number(1);
  request.mutable_view_state()->set_is_at_rest(true);
  *request.mutable_view_state()->mutable_frame() = testing::SmallRequest();
  stream->Write(request);
  v1::InteractResponse response;
  ASSERT_TRUE(stream->Read(&response));
  absl::SleepFor(absl::Seconds(1));
  Jump();
  WriteTokens({TokenEntry("all")});
  while (stream->Read(&response)) {
  }
  EXPECT_THAT(rpc::ToAbslStatus(stream->Finish()),
              StatusIs(absl::StatusCode::kUnauthenticated, HasSubstr("withdrawn")));
}

TEST_P(ClockJumpTest, ARateGoesOn) {
  Await(absl::StatusCode::kResourceExhausted, [&] { return Render("rare"); });
  Jump();
  Await(absl::StatusCode::kOk, [&] { return Render("rare"); });
  // An hour forth does not fill more than the burst.
  Await(absl::StatusCode::kResourceExhausted, [&] { return Render("rare"); });
}

TEST_P(ClockJumpTest, LostAgentsAreMissedAndFoundAgain) {
  ASSERT_THAT(HasReachable(2), IsOk());
  Jump();
  agents_[1].process->Kill();
  Await(absl::StatusCode::kOk, [&] { return HasReachable(1); });
  clock_.SetOffset(absl::ZeroDuration());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      agents_[1],
      testing::StartAgent({testing::ShardDirectory(folder_.Sub("d"), 0, 1)}, agents_[1].address));
  Await(absl::StatusCode::kOk, [&] { return HasReachable(2); });
}

// The exact frame comes by a timer of gRPC, once a view has not moved for a while.
TEST_P(ClockJumpTest, AViewThatComesToRestGetsItsExactFrame) {
  grpc::ClientContext context;
  context.set_deadline(base::MonotonicNow() + kPatience);
  rpc::SendToken("all", &context);
  const auto stub = v1::InteractService::NewStub(channel_);
  const auto stream = stub->Interact(&context);
  for (int sequence = 1; sequence <= 6; ++sequence) {
    clock_.SetOffset(sequence % 2 == 0 ? absl::Hours(GetParam()) : absl::ZeroDuration());
    v1::InteractRequest request;
    request.mutable_view_state()->set_sequence_number(sequence);
    *request.mutable_view_state()->mutable_frame() = testing::SmallRequest();
    ASSERT_TRUE(stream->Write(request));
    v1::InteractResponse response;
    do {
      ASSERT_TRUE(stream->Read(&response)) << rpc::ToAbslStatus(stream->Finish());
      v1::InteractRequest shown;
      shown.mutable_frame_shown()->set_frame_number(response.frame_number());
      stream->Write(shown);
    } while (!response.is_exact() || response.sequence_number() != sequence);
  }
}

TEST_P(ClockJumpTest, AFrameGoesToTheReplicaOfAnAgentThatHangs) {
  ASSERT_THAT(Render("all"), IsOk());
  agents_[0].process->Stop();
  Jump();
  EXPECT_THAT(Render("all"), IsOk());
  clock_.SetOffset(absl::ZeroDuration());
  EXPECT_THAT(Render("all"), IsOk());
  agents_[0].process->Signal(SIGCONT);
}

TEST_P(ClockJumpTest, AFramesDeadlinePasses) {
  ASSERT_THAT(Render("all"), IsOk());
  agents_[0].process->Stop();
  agents_[1].process->Stop();
  Jump();
  EXPECT_THAT(Render("all", absl::Seconds(3)), StatusIs(absl::StatusCode::kDeadlineExceeded));
  agents_[0].process->Signal(SIGCONT);
  agents_[1].process->Signal(SIGCONT);
}

TEST_P(ClockJumpTest, TheGatewayAnswersAndDropsHalfARequest) {
  testing::RawConnection half(gateway_port());
  half.Send("GET /healthz HTTP/1.1\r\nHo");
  Jump();
  testing::RawConnection whole(gateway_port());
  whole.Send("GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_THAT(whole.ReadAnswer(), StartsWith("HTTP/1.1 200"));
  EXPECT_EQ(half.ReadAll(), "");  // after ten seconds
}

TEST_P(ClockJumpTest, ServersEndWithinTheirDrainTime) {
  // A stream that stays open, which a server that ends waits for no longer than its drain time.
  grpc::ClientContext context;
  const auto stub = v1::InteractService::NewStub(channel_);
  rpc::SendToken("all", &context);
  const auto stream = stub->Interact(&context);
  ASSERT_THAT(Render("all"), IsOk());
  Jump();
  for (const ServerProcess* server : {&gateway_, &coordinator_, &agents_[0]}) {
    server->process->Signal(SIGTERM);
  }
  clock_.SetOffset(absl::ZeroDuration());
  for (const ServerProcess* server : {&gateway_, &coordinator_, &agents_[0]}) {
    const absl::StatusOr<int> code = server->process->Wait(kPatience);
    ASSERT_THAT(code, IsOk());
    EXPECT_EQ(*code, 0);
  }
  context.TryCancel();
}

}  // namespace
}  // namespace isoscope
