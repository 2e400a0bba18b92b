#include "rpc/request_context.h"

#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <grpcpp/server_builder.h>

#include "isoscope/v1/cluster_service.grpc.pb.h"
#include "rpc/channel.h"
#include "rpc/unary_call.h"

namespace isoscope::rpc {
namespace {

namespace v1 = isoscope::v1;
using ::testing::Eq;
using ::testing::Ne;

constexpr char kTraceId[] = "4bf92f3577b34da6a3ce929d0e0e4736";
constexpr char kTraceparent[] = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01";

// A service that answers capabilities, and refuses to tell the cluster's status.
class Service final : public v1::ClusterService::CallbackService {
 public:
  grpc::ServerUnaryReactor* GetCapabilities(grpc::CallbackServerContext* context,
                                            const v1::GetCapabilitiesRequest* request,
                                            v1::GetCapabilitiesResponse* /*response*/) override {
    return AnswerUnary(context, *request, [] { return absl::OkStatus(); });
  }
  grpc::ServerUnaryReactor* GetClusterStatus(grpc::CallbackServerContext* context,
                                             const v1::GetClusterStatusRequest* request,
                                             v1::GetClusterStatusResponse* /*response*/) override {
    return UnaryTask::Start(
        context, *request, &executor_, absl::Seconds(60),
        [](const base::Cancellation& /*cancellation*/, const base::TraceContext& identity) {
          return absl::DataLossError(identity.request_id());
        });
  }

 private:
  base::Executor executor_{1, 8};
};

class RequestContextTest : public ::testing::Test {
 protected:
  RequestContextTest() {
    grpc::ServerBuilder builder;
    ConfigureServer(&builder);
    builder.RegisterService(&service_);
    server_ = builder.BuildAndStart();
    stub_ = v1::ClusterService::NewStub(server_->InProcessChannel(MakeChannelArguments()));
  }

  // The request id of a call with these values of traceparent.
  std::string Ask(const std::vector<std::string>& traceparents) {
    grpc::ClientContext context;
    for (const std::string& value : traceparents) {
      context.AddMetadata(kTraceparentKey, value);
    }
    v1::GetCapabilitiesResponse response;
    EXPECT_TRUE(stub_->GetCapabilities(&context, {}, &response).ok());
    return RequestIdOf(context);
  }

  Service service_;
  std::unique_ptr<grpc::Server> server_;
  std::unique_ptr<v1::ClusterService::Stub> stub_;
};

TEST_F(RequestContextTest, AnAnswerHasTheTraceIdOfTheCallAsItsRequestId) {
  EXPECT_EQ(Ask({kTraceparent}), kTraceId);
}

TEST_F(RequestContextTest, ANewIdStandsInForAMissingMalformedOrDoubleOne) {
  for (const std::vector<std::string>& values :
       std::vector<std::vector<std::string>>{{}, {"nonsense"}, {kTraceparent, kTraceparent}}) {
    const std::string id = Ask(values);
    EXPECT_EQ(id.size(), 32u);
    EXPECT_THAT(id, Ne(kTraceId));
  }
}

TEST_F(RequestContextTest, AnErrorHasItToo) {
  grpc::ClientContext context;
  SetTraceparent(*base::TraceContext::Parse(kTraceparent), &context);
  v1::GetClusterStatusResponse response;
  const grpc::Status status = stub_->GetClusterStatus(&context, {}, &response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::DATA_LOSS);
  EXPECT_THAT(status.error_message(), Eq(kTraceId));
  EXPECT_THAT(RequestIdOf(context), Eq(kTraceId));
}

}  // namespace
}  // namespace isoscope::rpc
