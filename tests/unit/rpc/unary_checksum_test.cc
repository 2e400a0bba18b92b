// A unary call between coordinator and agents returns the answer to the request, or an error that
// names the network as the cause.

#include "rpc/unary_checksum.h"

#include <functional>
#include <memory>

#include "gtest/gtest.h"
#include <grpcpp/channel.h>
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include "isoscope/internal/v1/partition_agent_service.grpc.pb.h"
#include "rpc/grpc_status.h"
#include "tests/support/status_matchers.h"

namespace isoscope::rpc {
namespace {

namespace v1 = isoscope::internal::v1;

using isoscope::testing::IsOk;
using isoscope::testing::StatusIs;

class UnaryChecksumTest : public ::testing::Test, public v1::PartitionAgentService::Service {
 protected:
  void SetUp() override {
    grpc::ServerBuilder builder;
    builder.RegisterService(this);
    server_ = builder.BuildAndStart();
    stub_ = v1::PartitionAgentService::NewStub(server_->InProcessChannel({}));
  }
  void TearDown() override { server_->Shutdown(); }

  // The network changes what the server reads and what the client reads.
  absl::Status Call() {
    v1::GetActiveBoxRequest request;
    request.add_isovalues(60);
    v1::GetActiveBoxResponse response;
    grpc::ClientContext context;
    const grpc::Status status = stub_->GetActiveBox(&context, request, &response);
    if (response_on_its_way_) {
      response_on_its_way_(&response);
    }
    return CheckAnswer(request, ToAbslStatus(status), response, context);
  }

  grpc::Status GetActiveBox(grpc::ServerContext* context, const v1::GetActiveBoxRequest* request,
                            v1::GetActiveBoxResponse* response) override {
    v1::GetActiveBoxRequest read = *request;
    if (request_on_its_way_) {
      request_on_its_way_(&read);
    }
    response->set_active_block_count(12);
    if (sends_checksum_) {
      AnswerChecksum(read, status_, *response, context);
    }
    return ToGrpcStatus(status_);
  }

  std::function<void(v1::GetActiveBoxRequest*)> request_on_its_way_;
  std::function<void(v1::GetActiveBoxResponse*)> response_on_its_way_;
  absl::Status status_;
  bool sends_checksum_ = true;

 private:
  std::unique_ptr<grpc::Server> server_;
  std::unique_ptr<v1::PartitionAgentService::Stub> stub_;
};

TEST_F(UnaryChecksumTest, WhatCameAsItWasSentIsTaken) { EXPECT_THAT(Call(), IsOk()); }

TEST_F(UnaryChecksumTest, AnAnswerToAnotherQuestionIsRefused) {
  request_on_its_way_ = [](auto* request) { request->set_isovalues(0, 61); };
  EXPECT_THAT(Call(), StatusIs(absl::StatusCode::kUnavailable));
}

TEST_F(UnaryChecksumTest, AnAlteredAnswerIsRefused) {
  response_on_its_way_ = [](auto* response) { response->set_active_block_count(13); };
  EXPECT_THAT(Call(), StatusIs(absl::StatusCode::kUnavailable));
}

TEST_F(UnaryChecksumTest, AnAnswerWithoutChecksumIsRefused) {
  sends_checksum_ = false;
  EXPECT_THAT(Call(), StatusIs(absl::StatusCode::kUnavailable));
}

TEST_F(UnaryChecksumTest, TheClientIsBlamedOnlyForTheRequestItSent) {
  status_ = absl::InvalidArgumentError("isovalues is NaN");
  EXPECT_THAT(Call(), StatusIs(absl::StatusCode::kInvalidArgument));
  request_on_its_way_ = [](auto* request) { request->set_isovalues(0, 61); };
  EXPECT_THAT(Call(), StatusIs(absl::StatusCode::kUnavailable));
  sends_checksum_ = false;  // gRPC's own refusals have none
  EXPECT_THAT(Call(), StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST_F(UnaryChecksumTest, OtherErrorsStayWhatTheyAre) {
  status_ = absl::FailedPreconditionError("the dataset is not served");
  request_on_its_way_ = [](auto* request) { request->set_isovalues(0, 61); };
  EXPECT_THAT(Call(), StatusIs(absl::StatusCode::kFailedPrecondition));
}

}  // namespace
}  // namespace isoscope::rpc
