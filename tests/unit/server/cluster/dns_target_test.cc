#include "server/cluster/dns_target.h"

#include <optional>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

using testing::StatusIs;

TEST(DnsTargetTest, NamesAreTakenApartAndOtherTargetsAreNone) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(std::optional<DnsName> name,
                                ParseDnsTarget("dns:///agents.local:50052"));
  ASSERT_TRUE(name.has_value());
  EXPECT_EQ(name->host, "agents.local");
  EXPECT_EQ(name->port, "50052");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(name, ParseDnsTarget("dns:///[::1]:50052"));
  ASSERT_TRUE(name.has_value());
  EXPECT_EQ(name->host, "::1");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(name, ParseDnsTarget("dns:///agents.local"));
  ASSERT_TRUE(name.has_value());
  EXPECT_EQ(name->port, "50052");
  for (const char* other : {"localhost:50052", "unix:/run/agent", "dns:host:1"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(name, ParseDnsTarget(other));
    EXPECT_FALSE(name.has_value()) << other;
  }
}

TEST(DnsTargetTest, MalformedTargetsAreRefused) {
  for (const char* bad : {"", "dns:///", "dns:///:1", "dns:///host:"}) {
    EXPECT_THAT(ParseDnsTarget(bad), StatusIs(absl::StatusCode::kInvalidArgument)) << bad;
  }
}

TEST(DnsTargetTest, NumericHostsResolveToThemselves) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<std::string> addresses,
                                ResolveAddresses({"127.0.0.1", "50052"}));
  EXPECT_EQ(addresses, std::vector<std::string>({"127.0.0.1:50052"}));
}

}  // namespace
}  // namespace isoscope::server
