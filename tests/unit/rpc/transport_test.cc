#include "rpc/transport.h"

#include <string>

#include "gtest/gtest.h"

#include "core/io/file.h"
#include "tests/support/certificates.h"
#include "tests/support/status_matchers.h"

namespace isoscope::rpc {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::IsOk;
using testing::StatusIs;
using testing::TestAuthority;

TEST(TransportTest, OnlyAddressesOfThisMachineAreLoopback) {
  for (const char* target : {"127.0.0.1:1", "127.9.8.7", "localhost:1", "LOCALHOST:1",
                             "a.localhost:1", "[::1]:1", "::1", "unix:/tmp/s", "unix-abstract:s",
                             "dns:///localhost:1", "dns:localhost:1", "dns://8.8.8.8/localhost:1",
                             "ipv4:127.0.0.1:1", "ipv4:127.0.0.1:1,127.0.0.2:1", "ipv6:[::1]:1"}) {
    EXPECT_TRUE(IsLoopbackTarget(target)) << target;
  }
  for (const char* target :
       {"0.0.0.0:1", "[::]:1", "10.0.0.1:1", "127.evil.org:1", "127.0.0.1.evil.org:1", "node:1",
        "localhost.evil.org:1", "dns:///agents:1", "ipv4:127.0.0.1:1,10.0.0.1:1", "", ":1",
        "[fe80::1]:1", "dns:///127.0.0.1.nip.io:1"}) {
    EXPECT_FALSE(IsLoopbackTarget(target)) << target;
  }
}

TEST(TransportTest, PlaintextBeyondThisMachineNeedsAWord) {
  EXPECT_THAT(CheckListen({}, "127.0.0.1:1"), IsOk());
  EXPECT_THAT(CheckListen({}, ""), IsOk());  // in-process only
  EXPECT_THAT(CheckListen({}, "0.0.0.0:1"),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("0.0.0.0:1"), HasSubstr("--insecure"))));
  EXPECT_THAT(CheckListen({.is_insecure = true}, "0.0.0.0:1"), IsOk());
  EXPECT_THAT(CheckDial({}, "the agent", "node:1"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("the agent node:1")));
  EXPECT_THAT(CheckDial({.is_insecure = true}, "the agent", "node:1"), IsOk());
  EXPECT_THAT(CheckDial({.ca_file = "ca"}, "the agent", "node:1"), IsOk());
}

TEST(TransportTest, FilesThatBelongTogetherComeTogether) {
  const TransportFlags all{.certificate_file = "c", .key_file = "k", .ca_file = "a"};
  EXPECT_THAT(CheckListen(all, "0.0.0.0:1"), IsOk());
  for (std::string TransportFlags::*file :
       {&TransportFlags::certificate_file, &TransportFlags::key_file, &TransportFlags::ca_file}) {
    TransportFlags some = all;
    (some.*file).clear();
    EXPECT_THAT(CheckListen(some, "127.0.0.1:1"),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("all three")));
  }
  EXPECT_THAT(CheckDialFlags({.certificate_file = "c", .ca_file = "a"}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--tls-key")));
  EXPECT_THAT(CheckDialFlags({.certificate_file = "c", .key_file = "k"}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--tls-ca")));
  EXPECT_THAT(CheckDialFlags({.server_name = "n"}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--tls-server-name")));
  EXPECT_THAT(CheckDialFlags({.ca_file = "a"}), IsOk());
}

TEST(TransportTest, FilesAreCheckedBeforeAnythingStarts) {
  const TestAuthority authority;
  const TransportFlags good = authority.IssueRole("agent");
  EXPECT_THAT(CheckFiles(good, kAgentRole), IsOk());
  EXPECT_THAT(CheckFiles(good, ""), IsOk());
  EXPECT_THAT(CheckFiles(good, kCoordinatorRole),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       AllOf(HasSubstr("the role agent"), HasSubstr("isoscope:role:coordinator"))));

  TransportFlags absent = good;
  absent.key_file = authority.Path("absent");
  EXPECT_THAT(CheckFiles(absent, ""),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("--tls-key")));
  TransportFlags swapped = good;
  std::swap(swapped.certificate_file, swapped.key_file);
  EXPECT_THAT(CheckFiles(swapped, ""),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no certificate in PEM")));
  TransportFlags no_key = good;
  no_key.key_file = good.ca_file;
  EXPECT_THAT(CheckFiles(no_key, ""),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no private key")));
  TransportFlags other_key = good;
  other_key.key_file = authority.IssueRole("client").key_file;
  EXPECT_THAT(CheckFiles(other_key, ""),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("is not that of")));
  EXPECT_THAT(CheckFiles(authority.Issue({.name = "old", .role = "agent", .days = -1}), ""),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("expired on 2")));
  EXPECT_THAT(CheckFiles(authority.Issue({.name = "none"}), kAgentRole),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("has no role")));
}

TEST(TransportTest, TheFirstNameIsADnsName) {
  const TestAuthority authority;
  EXPECT_EQ(
      FirstNameOf(authority.Issue({.name = "a", .alternative_names = "IP:10.0.0.1,DNS:one,DNS:two"})
                      .certificate_file),
      "one");
  EXPECT_EQ(
      FirstNameOf(
          authority.Issue({.name = "b", .alternative_names = "IP:10.0.0.1"}).certificate_file),
      "");
  EXPECT_EQ(FirstNameOf("/absent"), "");
}

TEST(TransportTest, WithoutTlsThereAreNoCredentials) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto server, MakeServerCredentials({}, kAgentRole, PeerCertificate::kRequired, ""));
  EXPECT_EQ(server, nullptr);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Dialing dialing, MakeDialing({}, ""));
  EXPECT_EQ(dialing.credentials, nullptr);
}

}  // namespace
}  // namespace isoscope::rpc
