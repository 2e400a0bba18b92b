#include "server/access/access_control.h"

#include <atomic>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/time/clock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "core/base/retry_delay.h"
#include "server/cluster/dataset_catalog.h"
#include "tests/support/certificates.h"
#include "tests/support/metric_values.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::server {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::IsOk;
using ::testing::Not;
using testing::StatusIs;

rpc::Peer WithRole(const std::string& role) {
  rpc::Peer peer;
  peer.has_certificate = true;
  peer.name = role;
  peer.roles = {role};
  return peer;
}
rpc::Peer WithToken(const std::string& token) {
  rpc::Peer peer;
  peer.authorization = "Bearer " + token;
  return peer;
}
AccessToken WithRate(double frames_per_second) {
  AccessToken token;
  token.name = "n";
  token.max_frames_per_second = frames_per_second;
  return token;
}

std::string Entry(const std::string& token, const std::string& datasets,
                  const std::string& more = "") {
  return absl::StrCat(R"({"name": "of )", token, R"(", "sha256": ")",
                      absl::BytesToHexString(DigestOfToken(token)), R"(", "datasets": [")",
                      datasets, R"("])", more, "}");
}

class AccessControlTest : public ::testing::Test {
 protected:
  void Write(const std::vector<std::string>& entries) {
    testing::ReplaceFile(path(),
                         absl::StrCat(R"({"tokens": [)", absl::StrJoin(entries, ","), "]}"));
  }
  [[nodiscard]] std::string path() const { return folder_.Sub("tokens.json"); }
  std::unique_ptr<AccessControl> Make(bool has_tls, bool has_tokens) {
    absl::StatusOr<std::unique_ptr<AccessControl>> access = AccessControl::Make(
        {.has_tls = has_tls, .token_file = has_tokens ? path() : std::string()});
    EXPECT_THAT(access, IsOk());
    return *std::move(access);
  }

  testing::TempDir folder_;
};

TEST_F(AccessControlTest, WithoutTlsAndTokensEveryoneMayDoEverything) {
  const auto access = Make(false, false);
  for (const rpc::Peer& peer : {rpc::Peer(), WithToken("anything"), WithRole("agent")}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Caller caller, access->Identify(peer));
    EXPECT_TRUE(caller.sees_all_datasets());
    EXPECT_THAT(caller.CheckViewport(1 << 20, 1 << 20), IsOk());
    EXPECT_THAT(caller.TakeFrame(false), IsOk());
  }
}

TEST_F(AccessControlTest, WithTlsTheRoleDecides) {
  const auto access = Make(true, false);
  for (const char* role : {"client", "gateway"}) {
    EXPECT_THAT(access->Identify(WithRole(role)), IsOk()) << role;
    EXPECT_THAT(access->CheckCapabilities(WithRole(role)), IsOk()) << role;
  }
  for (const char* role : {"agent", "coordinator", "admin"}) {
    EXPECT_THAT(access->Identify(WithRole(role)),
                StatusIs(absl::StatusCode::kPermissionDenied, HasSubstr(role)));
    EXPECT_THAT(access->CheckCapabilities(WithRole(role)),
                StatusIs(absl::StatusCode::kPermissionDenied));
  }
  EXPECT_THAT(access->Identify({}), StatusIs(absl::StatusCode::kUnauthenticated));
  EXPECT_THAT(access->Identify(WithToken("unasked")), StatusIs(absl::StatusCode::kUnauthenticated));
}

TEST_F(AccessControlTest, ATokenSeesItsDatasetsAndCountsForMoreThanTheCertificate) {
  Write({Entry("t1", "head"), Entry("t2", "*")});
  for (const bool has_tls : {false, true}) {
    const auto access = Make(has_tls, true);
    rpc::Peer gateway = WithRole("gateway");
    gateway.authorization = "bearer t1 ";
    rpc::Peer client = WithRole("client");
    client.authorization = "Bearer t1";
    for (const rpc::Peer& peer : {WithToken("t1"), gateway, client}) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Caller caller, access->Identify(peer));
      EXPECT_EQ(caller.name(), "of t1");
      EXPECT_TRUE(caller.MaySee("head"));
      EXPECT_FALSE(caller.MaySee("Head"));
      EXPECT_FALSE(caller.MaySee(""));
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Caller all, access->Identify(WithToken("t2")));
    EXPECT_TRUE(all.MaySee("anything"));
    for (const char* wrong : {"Bearer t3", "Bearer ", "t1", "Basic dDE6", "Bearer t1 t1"}) {
      client.authorization = wrong;
      EXPECT_THAT(access->Identify(client), StatusIs(absl::StatusCode::kUnauthenticated)) << wrong;
    }
    EXPECT_THAT(access->Identify({}),
                StatusIs(absl::StatusCode::kUnauthenticated, HasSubstr("--token-file")));
  }
}

TEST_F(AccessControlTest, AGatewayByItselfLearnsTheCapabilitiesOnly) {
  Write({Entry("t", "*")});
  const auto access = Make(true, true);
  EXPECT_THAT(access->Identify(WithRole("gateway")), StatusIs(absl::StatusCode::kUnauthenticated));
  EXPECT_THAT(access->CheckCapabilities(WithRole("gateway")), IsOk());
  rpc::Peer peer = WithRole("gateway");
  peer.authorization = "Bearer wrong";
  EXPECT_THAT(access->CheckCapabilities(peer), StatusIs(absl::StatusCode::kUnauthenticated));
  EXPECT_THAT(access->Identify(WithRole("client")), IsOk());
}

TEST_F(AccessControlTest, HiddenDatasetsAreAsIfTheyWereNotThere) {
  Write({Entry("t", "head")});
  const auto access = Make(false, true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Caller caller, access->Identify(WithToken("t")));
  std::map<std::string, DatasetState> datasets;
  for (const char* name : {"head", "secret"}) {
    datasets[name].dataset.set_name(name);
  }
  EXPECT_THAT(FindDataset(datasets, "", "", caller), IsOk()) << "the only one that it sees";
  EXPECT_THAT(FindDataset(datasets, "", ""), StatusIs(absl::StatusCode::kInvalidArgument));
  const absl::Status hidden = FindDataset(datasets, "secret", "", caller).status();
  const absl::Status absent = FindDataset(datasets, "absent", "", caller).status();
  EXPECT_THAT(hidden, StatusIs(absl::StatusCode::kNotFound, Not(HasSubstr("secret\","))));
  EXPECT_EQ(hidden.code(), absent.code());
  EXPECT_THAT(absent, StatusIs(absl::StatusCode::kNotFound,
                               AllOf(HasSubstr("head"), Not(HasSubstr("secret")))));
}

TEST_F(AccessControlTest, FramesAreCountedAndMovingOnesLeaveOne) {
  const base::MonotonicTime start = base::MonotonicNow();
  AccessGrant grant(WithRate(4), start);
  for (int i = 0; i < 3; ++i) {
    EXPECT_THAT(grant.TakeFrame(1, start), IsOk());
  }
  EXPECT_THAT(grant.TakeFrame(1, start), StatusIs(absl::StatusCode::kResourceExhausted));
  EXPECT_THAT(grant.TakeFrame(0, start), IsOk());
  EXPECT_THAT(grant.TakeFrame(0, start),
              StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("retry in 250 ms")));
  EXPECT_EQ(base::RetryDelayOf(grant.TakeFrame(0, start)), absl::Milliseconds(250));
  EXPECT_THAT(grant.TakeFrame(0, start - absl::Hours(1)),
              StatusIs(absl::StatusCode::kResourceExhausted))
      << "a clock that goes back gives nothing";
  EXPECT_THAT(grant.TakeFrame(0, start + absl::Milliseconds(251)), IsOk());
  EXPECT_THAT(grant.TakeFrame(0, start + absl::Milliseconds(252)), Not(IsOk()));
  int taken = 0;
  while (grant.TakeFrame(0, start + absl::Hours(9)).ok()) {
    ++taken;
  }
  EXPECT_EQ(taken, 4) << "a pause saves up no more than a second";
}

TEST_F(AccessControlTest, ASlowRateStillAllowsOneFrameAtATime) {
  AccessGrant grant(WithRate(0.1), base::MonotonicTime());
  EXPECT_THAT(grant.TakeFrame(1, base::MonotonicTime()), IsOk());
  EXPECT_THAT(grant.TakeFrame(0, base::MonotonicTime()), IsOk());
  EXPECT_THAT(grant.TakeFrame(0, base::MonotonicTime() + absl::Seconds(9)), Not(IsOk()));
  EXPECT_THAT(grant.TakeFrame(0, base::MonotonicTime() + absl::Seconds(11)), IsOk());
}

TEST_F(AccessControlTest, RefusalsOfATokenAreCountedByLimit) {
  Write({Entry("a", "head", R"(, "max_streams": 1)")});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto access, AccessControl::Make({.token_file = path()}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Caller caller, access->Identify(WithToken("a")));
  const auto first = caller.Begin(CallerUse::kStream);
  ISOSCOPE_ASSERT_OK(first);
  EXPECT_THAT(caller.Begin(CallerUse::kStream).status(), Not(IsOk()));
  std::vector<base::MetricFamily> families;
  access->AppendMetrics(&families);
  auto values = testing::ValuesOf(families);
  EXPECT_EQ(values["isoscope_token_refusals_total limit=streams"], 1);
  EXPECT_EQ(values["isoscope_token_refusals_total limit=frames"], 0);
}

TEST_F(AccessControlTest, BytesAreCountedAfterwardsAndAnExcessIsWaitedFor) {
  AccessToken token;
  token.name = "n";
  token.max_bytes_per_second = 100;
  const base::MonotonicTime start = base::MonotonicTime();
  AccessGrant grant(token, start);
  grant.CountBytes(999, start);  // ten seconds' worth may come at once
  EXPECT_THAT(grant.CheckBytes(start), IsOk());
  grant.CountBytes(501, start);
  const absl::Status refused = grant.CheckBytes(start);
  EXPECT_THAT(refused, StatusIs(absl::StatusCode::kResourceExhausted,
                                HasSubstr("100 bytes a second and was sent more")));
  EXPECT_EQ(base::RetryDelayOf(refused), absl::Milliseconds(5010));
  EXPECT_THAT(grant.CheckBytes(start + absl::Seconds(5)), Not(IsOk()));
  EXPECT_THAT(grant.CheckBytes(start + absl::Milliseconds(5010)), IsOk());
}

TEST_F(AccessControlTest, AFrameThatIsGivenBackMayComeAgainAndNoMoreThanThat) {
  AccessGrant grant(WithRate(2), base::MonotonicTime());
  grant.ReturnFrame();
  EXPECT_THAT(grant.TakeFrame(0, base::MonotonicTime()), IsOk());
  EXPECT_THAT(grant.TakeFrame(0, base::MonotonicTime()), IsOk());
  EXPECT_THAT(grant.TakeFrame(0, base::MonotonicTime()), Not(IsOk()));
  grant.ReturnFrame();
  EXPECT_THAT(grant.TakeFrame(0, base::MonotonicTime()), IsOk());
}

TEST_F(AccessControlTest, ConnectionsOfAHostAreOneCallerForWhatStaysOpen) {
  const Caller anybody;
  EXPECT_EQ(anybody.HostKey("ipv4:10.0.0.1:5000"), anybody.HostKey("ipv4:10.0.0.1:5001"));
  EXPECT_NE(anybody.HostKey("ipv4:10.0.0.1:5000"), anybody.HostKey("ipv4:10.0.0.2:5000"));
  EXPECT_EQ(anybody.HostKey("ipv6:%5B::1%5D:5000"), anybody.HostKey("ipv6:%5B::1%5D:5001"));
  EXPECT_NE(anybody.HostKey("ipv6:%5B::1%5D:5000"), anybody.HostKey("ipv6:%5B::2%5D:5000"));
  EXPECT_NE(anybody.HostKey("unix:/a:1"), anybody.HostKey("unix:/a:2"));
  EXPECT_NE(anybody.QueueKey("ipv4:10.0.0.1:5000"), anybody.QueueKey("ipv4:10.0.0.1:5001"));
}

// Nobody calls here: the file is looked at all the same.
TEST_F(AccessControlTest, AWithdrawnTokenTellsItsUsersOnceAndNotThoseWhoHaveLeft) {
  Write({Entry("old", "*"), Entry("kept", "*")});
  const auto access = Make(false, true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Caller old, access->Identify(WithToken("old")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Caller kept, access->Identify(WithToken("kept")));
  std::atomic<int> told{0};
  std::atomic<int> told_wrongly{0};
  const WithdrawalWatch watch = old.WhenWithdrawn([&] { ++told; });
  const WithdrawalWatch other = kept.WhenWithdrawn([&] { ++told_wrongly; });
  {
    const WithdrawalWatch left = old.WhenWithdrawn([&] { ++told_wrongly; });
  }
  Write({Entry("kept", "*")});
  const base::MonotonicTime end = base::MonotonicNow() + absl::Seconds(60);
  while (told.load() == 0 && base::MonotonicNow() < end) {
    absl::SleepFor(absl::Milliseconds(5));
  }
  const WithdrawalWatch late = old.WhenWithdrawn([&] { ++told; });
  EXPECT_EQ(told.load(), 2) << "one who comes late hears of it at once";
  EXPECT_EQ(told_wrongly.load(), 0);
}

TEST_F(AccessControlTest, ManyThreadsHaveNoMoreAtATimeThanTheTokenAllows) {
  constexpr int kThreads = 8;
  constexpr int kMost = 3;
  Write({Entry("a", "*", R"(, "max_exports": 3)"), Entry("b", "*")});
  const auto access = Make(false, true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Caller caller, access->Identify(WithToken("a")));
  std::atomic<int> held{0};
  std::atomic<int> refused{0};
  std::atomic<int> told{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < kThreads; ++i) {
    threads.emplace_back([&] {
      for (int turn = 0; turn < 2000; ++turn) {
        const WithdrawalWatch watch = caller.WhenWithdrawn([&] { ++told; });
        const absl::StatusOr<CallerSlot> slot = caller.Begin(CallerUse::kExport);
        if (slot.ok()) {
          EXPECT_LE(++held, kMost);
          std::this_thread::yield();
          --held;
        } else {
          ++refused;
        }
        caller.CountBytes(1);
      }
    });
  }
  Write({Entry("b", "*")});
  for (std::thread& thread : threads) {
    thread.join();
  }
  std::vector<absl::StatusOr<CallerSlot>> all;
  for (int i = 0; i <= kMost; ++i) {
    all.push_back(caller.Begin(CallerUse::kExport));
  }
  EXPECT_THAT(all[kMost - 1], IsOk()) << "all were given back";
  EXPECT_THAT(all[kMost], StatusIs(absl::StatusCode::kResourceExhausted,
                                   HasSubstr("may have 3 exports at a time")));
}

TEST_F(AccessControlTest, ViewportsAreLimitedByTheLongerSide) {
  Write({Entry("t", "*", R"(, "max_viewport_px": 100)")});
  const auto access = Make(false, true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Caller caller, access->Identify(WithToken("t")));
  EXPECT_THAT(caller.CheckViewport(100, 100), IsOk());
  EXPECT_THAT(caller.CheckViewport(101, 1),
              StatusIs(absl::StatusCode::kPermissionDenied, HasSubstr("101 x 1")));
  EXPECT_THAT(caller.CheckViewport(1, 101), Not(IsOk()));
}

TEST_F(AccessControlTest, AChangedFileCountsSoonAndOpenStreamsNotice) {
  Write({Entry("old", "*"), Entry("kept", "head")});
  const auto access = Make(false, true);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Caller old, access->Identify(WithToken("old")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Caller kept, access->Identify(WithToken("kept")));
  Write({Entry("kept", "head"), Entry("new", "*")});
  // Guards against a hang; it takes a kReloadInterval.
  const base::MonotonicTime limit = base::MonotonicNow() + absl::Seconds(60);
  while (access->CheckStillValid(old).ok() && base::MonotonicNow() < limit) {
    absl::SleepFor(absl::Milliseconds(20));
  }
  EXPECT_THAT(access->CheckStillValid(old),
              StatusIs(absl::StatusCode::kUnauthenticated, HasSubstr("withdrawn")));
  EXPECT_THAT(access->CheckStillValid(kept), IsOk());
  EXPECT_THAT(access->CheckStillValid(Caller()), IsOk());
  EXPECT_THAT(access->Identify(WithToken("old")), Not(IsOk()));
  EXPECT_THAT(access->Identify(WithToken("new")), IsOk());
  // A file that is being written, or is gone, changes nothing.
  testing::ReplaceFile(path(), R"({"tokens": [)");
  absl::SleepFor(AccessControl::kReloadInterval + absl::Milliseconds(50));
  EXPECT_THAT(access->Identify(WithToken("new")), IsOk());
}

TEST_F(AccessControlTest, AFileThatIsWrongAtTheStartIsAnError) {
  EXPECT_THAT(AccessControl::Make({.token_file = path()}), StatusIs(absl::StatusCode::kNotFound));
  testing::ReplaceFile(path(), "no JSON");
  EXPECT_THAT(AccessControl::Make({.token_file = path()}),
              StatusIs(absl::StatusCode::kInvalidArgument));
}

TEST_F(AccessControlTest, ManyThreadsAskWhileTheFileChanges) {
  Write({Entry("a", "*"), Entry("b", "*")});
  const auto access = Make(false, true);
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&] {
      const base::MonotonicTime end = base::MonotonicNow() + absl::Milliseconds(1500);
      while (base::MonotonicNow() < end) {
        const absl::StatusOr<Caller> caller = access->Identify(WithToken("a"));
        ASSERT_THAT(caller, IsOk());
        caller->TakeFrame(true).IgnoreError();
        ASSERT_THAT(access->CheckStillValid(*caller), IsOk());
      }
    });
  }
  Write({Entry("a", "*")});
  for (std::thread& thread : threads) {
    thread.join();
  }
}

}  // namespace
}  // namespace isoscope::server
