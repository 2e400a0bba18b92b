#include "core/http/peer_address.h"

#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::http {
namespace {

using ::testing::HasSubstr;
using testing::IsOk;
using testing::StatusIs;

TEST(PeerKeyTest, AnAddressOfIpv4CountsByItself) {
  EXPECT_EQ(PeerKey("192.0.2.7"), "192.0.2.7");
  EXPECT_NE(PeerKey("192.0.2.7"), PeerKey("192.0.2.8"));
  EXPECT_EQ(PeerKey("::ffff:192.0.2.7"), "192.0.2.7") << "of a socket of IPv6";
}

TEST(PeerKeyTest, AHostOfIpv6HasAllAddressesOfItsNetwork) {
  EXPECT_EQ(PeerKey("2001:db8:1:2:3:4:5:6"), "2001:db8:1:2::/64");
  EXPECT_EQ(PeerKey("2001:db8:1:2::9"), PeerKey("2001:db8:1:2:ffff:ffff:ffff:ffff"));
  EXPECT_NE(PeerKey("2001:db8:1:2::9"), PeerKey("2001:db8:1:3::9"));
  EXPECT_EQ(PeerKey("::1"), "::/64");
}

TEST(PeerKeyTest, OtherTextsStay) {
  EXPECT_EQ(PeerKey(""), "");
  EXPECT_EQ(PeerKey("unknown"), "unknown");
}

TEST(TrustedProxiesTest, NetworksAreOfBothKinds) {
  TrustedProxies proxies;
  EXPECT_FALSE(proxies.Contains("192.0.2.7"));
  for (const char* text : {"192.0.2.7", "10.1.0.0/15", "2001:db8::/33", "::1"}) {
    EXPECT_THAT(proxies.Add(text), IsOk()) << text;
  }
  for (const char* inside :
       {"192.0.2.7", "::ffff:192.0.2.7", "10.0.0.0", "10.1.255.255", "2001:db8:7fff::", "::1"}) {
    EXPECT_TRUE(proxies.Contains(inside)) << inside;
  }
  for (const char* outside : {"192.0.2.6", "192.0.2.8", "9.255.255.255", "10.2.0.0",
                              "2001:db8:8000::", "2001:db7::", "::2", "", "x"}) {
    EXPECT_FALSE(proxies.Contains(outside)) << outside;
  }
  EXPECT_THAT(proxies.Add("0.0.0.0/0"), IsOk());
  EXPECT_TRUE(proxies.Contains("9.255.255.255"));
  EXPECT_FALSE(proxies.Contains("2001:db7::")) << "all of IPv4 is not all";
}

TEST(TrustedProxiesTest, WhatIsNoNetworkIsRefused) {
  TrustedProxies proxies;
  for (const char* text :
       {"", "proxy.example", "192.0.2", "192.0.2.7/33", "192.0.2.7/-1", "192.0.2.7/",
        "192.0.2.7/8/8", "2001:db8::/129", "[::1]", "1.2.3.4:80"}) {
    EXPECT_THAT(proxies.Add(text),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("ADDRESS/BITS")))
        << text;
  }
}

TEST(TrustedProxiesTest, OnlyAProxyIsBelieved) {
  TrustedProxies proxies;
  EXPECT_EQ(proxies.CallerOf("198.51.100.1", "192.0.2.7"), "198.51.100.1") << "no proxy is known";
  ASSERT_THAT(proxies.Add("198.51.100.1"), IsOk());
  EXPECT_EQ(proxies.CallerOf("198.51.100.1", "192.0.2.7"), "192.0.2.7");
  EXPECT_EQ(proxies.CallerOf("198.51.100.2", "192.0.2.7"), "198.51.100.2");
  EXPECT_EQ(proxies.CallerOf("198.51.100.1", ""), "198.51.100.1");
}

TEST(TrustedProxiesTest, ACallersOwnInventionsAreNotBelieved) {
  TrustedProxies proxies;
  ASSERT_THAT(proxies.Add("198.51.100.0/24"), IsOk());
  const std::string peer = "198.51.100.1";
  EXPECT_EQ(proxies.CallerOf(peer, "1.1.1.1, 2.2.2.2 ,192.0.2.7"), "192.0.2.7");
  EXPECT_EQ(proxies.CallerOf(peer, "1.1.1.1, 192.0.2.7, 198.51.100.9"), "192.0.2.7")
      << "through two proxies";
  EXPECT_EQ(proxies.CallerOf(peer, "198.51.100.8, 198.51.100.9"), "198.51.100.8");
  EXPECT_EQ(proxies.CallerOf(peer, "192.0.2.7, unknown"), peer);
  EXPECT_EQ(proxies.CallerOf(peer, "192.0.2.7, evil, 198.51.100.9"), "198.51.100.9");
}

TEST(TrustedProxiesTest, PortsOfSomeProxiesAreLeftOut) {
  TrustedProxies proxies;
  ASSERT_THAT(proxies.Add("198.51.100.1"), IsOk());
  EXPECT_EQ(proxies.CallerOf("198.51.100.1", "192.0.2.7:4711"), "192.0.2.7");
  EXPECT_EQ(proxies.CallerOf("198.51.100.1", "[2001:db8::1]:4711"), "2001:db8::1");
  EXPECT_EQ(proxies.CallerOf("198.51.100.1", "2001:db8::1"), "2001:db8::1");
}

}  // namespace
}  // namespace isoscope::http
