#include "rpc/host_port.h"

#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::rpc {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::StartsWith;

TEST(HostPortTest, AddressesHaveHostAndPort) {
  for (const char* text : {"localhost:50051", "127.0.0.1:0", "[::1]:65535", "agents.svc:1"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string address, ParseHostPort(text));
    EXPECT_EQ(address, text);
  }
  for (const std::string text : {"", "localhost", ":50051", "localhost:", "localhost:65536",
                                 "localhost:-1", "localhost:http", "::1:50051", "local host:1"}) {
    EXPECT_THAT(ParseHostPort(text).status(),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         StartsWith("'" + text + "' is not HOST:PORT")));
  }
}

TEST(HostPortTest, OnlyHostsGetADefaultPort) {
  EXPECT_EQ(WithDefaultPort("node3", 50052), "node3:50052");
  EXPECT_EQ(WithDefaultPort("[::1]", 50052), "[::1]:50052");
  for (const char* text : {"", "70000", "node3:1", "[::1]:1", "unix:/run/agent", "file:agents.txt",
                           "dns:///agents", "::1"}) {
    EXPECT_EQ(WithDefaultPort(text, 50052), text);
  }
}

TEST(HostPortTest, ACoordinatorsPortMayBeLeftOut) {
  EXPECT_EQ(*ParseCoordinatorAddress("localhost"), "localhost:50051");
  EXPECT_EQ(*ParseCoordinatorAddress("10.1.2.3"), "10.1.2.3:50051");
  EXPECT_EQ(*ParseCoordinatorAddress("[::1]"), "[::1]:50051");
  EXPECT_EQ(*ParseCoordinatorAddress("localhost:7"), "localhost:7");
  EXPECT_EQ(*ParseCoordinatorAddress("[::1]:7"), "[::1]:7");
  for (const char* text : {"", ":", ":7", "::1", "local host", "localhost:", "localhost:http"}) {
    EXPECT_THAT(ParseCoordinatorAddress(text).status(),
                StatusIs(absl::StatusCode::kInvalidArgument))
        << text;
  }
}

}  // namespace
}  // namespace isoscope::rpc
