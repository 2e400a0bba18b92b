#include "rpc/health_probe.h"

#include <memory>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "gtest/gtest.h"
#include <grpcpp/health_check_service_interface.h>

#include "rpc/channel.h"
#include "tests/support/status_matchers.h"

namespace isoscope::rpc {
namespace {

using ::testing::HasSubstr;
using testing::IsOk;
using testing::StatusIs;

constexpr absl::Duration kLong = absl::Seconds(60);

TEST(HealthProbeTest, TellsServingFromNotServingAndFromNobody) {
  EnableServerPlugins();
  grpc::ServerBuilder builder;
  ConfigureServer(&builder);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(RunningServer running, StartServer(&builder, "127.0.0.1:0"));
  const std::string address = absl::StrCat("127.0.0.1:", running.port);
  EXPECT_THAT(ProbeHealth(address, {}, kLong), IsOk());
  running.server->GetHealthCheckService()->SetServingStatus(false);
  EXPECT_THAT(ProbeHealth(address, {}, kLong),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr("does not serve")));
  running.server.reset();
  EXPECT_THAT(ProbeHealth(address, {}, kLong), StatusIs(absl::StatusCode::kUnavailable));
}

TEST(HealthProbeTest, AServerOnAllAddressesIsAskedOnLoopback) {
  EXPECT_EQ(OwnAddress("0.0.0.0:50051"), "127.0.0.1:50051");
  EXPECT_EQ(OwnAddress("[::]:50051"), "[::1]:50051");
  EXPECT_EQ(OwnAddress("10.0.0.7:1"), "10.0.0.7:1");
}

}  // namespace
}  // namespace isoscope::rpc
