#include "core/http/connections.h"

#include <atomic>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"

namespace isoscope::http {
namespace {

using Lease = std::shared_ptr<Connections::Lease>;

constexpr ConnectionLimits kSmall = {
    .max_count = 4, .max_entering = 4, .max_strangers = 3, .max_of_address = 2};

// Connections with names, which note when they are dropped.
class Crowd {
 public:
  explicit Crowd(const ConnectionLimits& limits) : connections_(limits) {}

  Lease Add(const std::string& name, const std::string& address) {
    Lease lease = connections_.TryAdd(address);
    if (lease != nullptr) {
      lease->SetCloser(
          [this, name](bool at_once) { dropped.push_back(at_once ? name : "softly"); });
    }
    return lease;
  }
  Connections& connections() { return connections_; }

  std::vector<std::string> dropped;

 private:
  Connections connections_;
};

TEST(ConnectionsTest, APlaceComesBackWithItsLease) {
  Connections connections(kSmall);
  Lease first = connections.TryAdd("a");
  const Lease second = connections.TryAdd("a");
  ASSERT_NE(first, nullptr);
  ASSERT_NE(second, nullptr);
  EXPECT_EQ(connections.count(), 2);
  first = nullptr;
  EXPECT_EQ(connections.count(), 1);
}

TEST(ConnectionsTest, WhoWaitsLongestOfTheAddressThatHasMostMakesRoom) {
  Crowd crowd(kSmall);
  std::vector<Lease> leases;
  for (const char* name : {"b1", "a1", "a2", "b2", "a3", "c1", "b3", "a4"}) {
    leases.push_back(crowd.Add(name, std::string(1, name[0])));
  }
  EXPECT_TRUE(crowd.dropped.empty());
  leases.push_back(crowd.Add("d1", "d"));
  EXPECT_EQ(crowd.dropped, std::vector<std::string>({"a1"}));
  // Now a and b have three each.
  leases.push_back(crowd.Add("e1", "e"));
  EXPECT_EQ(crowd.dropped, std::vector<std::string>({"a1", "b1"}));
  EXPECT_EQ(crowd.connections().count(), 8);
  EXPECT_EQ(crowd.connections().dropped_count(), 2);
}

TEST(ConnectionsTest, AFloodOfOneAddressDropsItsOwnAlone) {
  Crowd crowd(kSmall);
  const Lease other = crowd.Add("other", "o");
  std::vector<Lease> flood;
  for (int i = 0; i < 1000; ++i) {
    flood.push_back(crowd.Add(absl::StrCat("f", i), "f"));
    ASSERT_NE(flood.back(), nullptr);
  }
  EXPECT_EQ(crowd.dropped.size(), 1001U - 8U);
  EXPECT_EQ(crowd.dropped.front(), "f0");
  for (const std::string& name : crowd.dropped) {
    EXPECT_NE(name, "other");
  }
  EXPECT_EQ(other->BeginWork(Caller::kKnown, "o"), Placement::kTaken);
  EXPECT_EQ(crowd.connections().count(), 8);
}

TEST(ConnectionsTest, ADroppedConnectionBeginsNoWorkAndFreesItsPlaceOnce) {
  Crowd crowd(kSmall);
  std::vector<Lease> leases;
  for (int i = 0; i < 9; ++i) {
    leases.push_back(crowd.Add(absl::StrCat(i), "a"));
  }
  ASSERT_EQ(crowd.dropped, std::vector<std::string>({"0"}));
  EXPECT_EQ(leases[0]->BeginWork(Caller::kKnown, "a"), Placement::kDropped);
  leases[0]->EndWork();
  EXPECT_EQ(leases[0]->BeginWork(Caller::kKnown, "a"), Placement::kDropped);
  leases[0] = nullptr;
  EXPECT_EQ(crowd.connections().count(), 8);
}

// Between the victim's choice and its SetCloser.
TEST(ConnectionsTest, AConnectionThatIsDroppedBeforeItHasACloserIsClosedThen) {
  Connections connections(kSmall);
  std::vector<Lease> leases;
  for (int i = 0; i < 9; ++i) {
    leases.push_back(connections.TryAdd("a"));
  }
  bool is_closed = false;
  leases[0]->SetCloser([&](bool at_once) { is_closed = at_once; });
  EXPECT_TRUE(is_closed);
  leases[1]->SetCloser([&](bool) { ADD_FAILURE(); });
}

TEST(ConnectionsTest, WorkIsNotDroppedAndKnownCallersAreTheLastToMakeRoom) {
  Crowd crowd(kSmall);
  const Lease working = crowd.Add("working", "w");
  ASSERT_EQ(working->BeginWork(Caller::kStranger, "w"), Placement::kTaken);
  const Lease known = crowd.Add("known", "k");
  ASSERT_EQ(known->BeginWork(Caller::kKnown, "k"), Placement::kTaken);
  known->EndWork();
  std::vector<Lease> others;
  for (int i = 0; i < 6; ++i) {
    others.push_back(crowd.Add("other", absl::StrCat(i)));
  }
  for (int i = 0; i < 6; ++i) {
    Lease newcomer = crowd.Add("newcomer", absl::StrCat("n", i));
    ASSERT_NE(newcomer, nullptr);
    const Placement placement =
        newcomer->BeginWork(i < 2 ? Caller::kStranger : Caller::kHealth, "n");
    ASSERT_EQ(placement, i < 4 ? Placement::kTaken : Placement::kAddressFull);
    others.push_back(newcomer);
  }
  EXPECT_EQ(crowd.dropped, std::vector<std::string>(6, "other"));
  // Two newcomers found no work, so they wait: they go before the known one.
  others.push_back(crowd.Add("x", "x"));
  others.push_back(crowd.Add("y", "y"));
  EXPECT_EQ(crowd.dropped, std::vector<std::string>({"other", "other", "other", "other", "other",
                                                     "other", "newcomer", "newcomer"}));
}

TEST(ConnectionsTest, KnownCallersOfAnAddressDoNotCountAgainstItsStrangers) {
  Crowd crowd(kSmall);
  std::vector<Lease> leases;
  for (int i = 0; i < 3; ++i) {
    leases.push_back(crowd.Add("known", "a"));
    ASSERT_EQ(leases.back()->BeginWork(Caller::kKnown, "a"), Placement::kTaken);
    leases.back()->EndWork();
  }
  for (const char* name : {"a1", "b1", "b2", "c1", "d1"}) {
    leases.push_back(crowd.Add(name, std::string(1, name[0])));
  }
  leases.push_back(crowd.Add("e1", "e"));
  EXPECT_EQ(crowd.dropped, std::vector<std::string>({"b1"}));
}

TEST(ConnectionsTest, StrangersLeavePlacesToKnownCallersAndToOtherAddresses) {
  Crowd crowd(kSmall);
  std::vector<Lease> leases;
  const auto begin = [&](Caller caller, const std::string& address) {
    leases.push_back(crowd.Add("", address));
    return leases.back()->BeginWork(caller, address);
  };
  EXPECT_EQ(begin(Caller::kStranger, "a"), Placement::kTaken);
  EXPECT_EQ(begin(Caller::kStranger, "a"), Placement::kTaken);
  EXPECT_EQ(begin(Caller::kStranger, "a"), Placement::kAddressFull);
  EXPECT_EQ(begin(Caller::kStranger, "b"), Placement::kTaken);
  EXPECT_EQ(begin(Caller::kStranger, "c"), Placement::kFull);
  EXPECT_EQ(begin(Caller::kKnown, "a"), Placement::kTaken);
  EXPECT_EQ(begin(Caller::kKnown, "d"), Placement::kFull) << "max_count";
  leases[0]->EndWork();
  EXPECT_EQ(begin(Caller::kStranger, "a"), Placement::kTaken);
  leases[3] = nullptr;  // in the middle of its work
  EXPECT_EQ(begin(Caller::kStranger, "c"), Placement::kTaken);
}

TEST(ConnectionsTest, TheAddressOfTheCallerCountsForWorkAndNotThatOfTheProxy) {
  Crowd crowd(kSmall);
  std::vector<Lease> leases;
  const auto begin = [&](const std::string& caller) {
    leases.push_back(crowd.Add("", "proxy"));
    return leases.back()->BeginWork(Caller::kStranger, caller);
  };
  EXPECT_EQ(begin("a"), Placement::kTaken);
  EXPECT_EQ(begin("a"), Placement::kTaken);
  EXPECT_EQ(begin("a"), Placement::kAddressFull);
  EXPECT_EQ(begin("b"), Placement::kTaken);
}

TEST(ConnectionsTest, HealthFindsAPlaceWhenAllAreTakenAndTakesNoneForGood) {
  Crowd crowd(kSmall);
  std::vector<Lease> leases;
  const auto begin = [&](Caller caller) {
    leases.push_back(crowd.Add("", absl::StrCat(leases.size())));
    return leases.back() == nullptr ? Placement::kDropped : leases.back()->BeginWork(caller, "x");
  };
  for (int i = 0; i < 4; ++i) {
    ASSERT_EQ(begin(Caller::kKnown), Placement::kTaken);
  }
  EXPECT_EQ(begin(Caller::kHealth), Placement::kTaken);
  EXPECT_EQ(begin(Caller::kHealth), Placement::kTaken);
  EXPECT_EQ(begin(Caller::kHealth), Placement::kFull) << "half of max_entering";
  leases[4]->EndWork();
  EXPECT_EQ(begin(Caller::kHealth), Placement::kTaken);
  // However many ask for health, a newcomer can still say who it is.
  for (int i = 0; i < 20; ++i) {
    EXPECT_NE(begin(Caller::kHealth), Placement::kDropped);
  }
}

TEST(ConnectionsTest, ThreadsComeAndGo) {
  Connections connections(kSmall);
  std::atomic<int> dropped_count{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&, address = absl::StrCat(i)] {
      std::vector<Lease> leases;
      for (int round = 0; round < 500; ++round) {
        Lease lease = connections.TryAdd(address);
        if (lease == nullptr) {
          leases.clear();
          continue;
        }
        lease->SetCloser([&](bool) { ++dropped_count; });
        if (lease->BeginWork(round % 3 == 0 ? Caller::kKnown : Caller::kStranger, address) ==
            Placement::kTaken) {
          lease->EndWork();
        }
        leases.push_back(std::move(lease));
        if (round % 7 == 0) {
          leases.erase(leases.begin());
        }
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_EQ(connections.count(), 0);
  EXPECT_EQ(connections.dropped_count(), dropped_count);
  EXPECT_TRUE(connections.AwaitNone(base::MonotonicNow()));
}

TEST(ConnectionsTest, ClosingReachesThoseThatAreThereAndThoseThatBecomeReadyLater) {
  Connections connections(kSmall);
  std::vector<bool> closed;
  Lease early = connections.TryAdd("a");
  Lease late = connections.TryAdd("a");
  early->SetCloser([&](bool at_once) { closed.push_back(at_once); });
  connections.Close(/*at_once=*/false);
  EXPECT_TRUE(connections.is_closing());
  EXPECT_EQ(closed, std::vector<bool>({false}));
  late->SetCloser([&](bool at_once) { closed.push_back(at_once); });
  EXPECT_EQ(closed, std::vector<bool>({false, false}));
  EXPECT_EQ(connections.TryAdd("a"), nullptr);
  EXPECT_FALSE(connections.AwaitNone(base::MonotonicNow()));
  connections.Close(/*at_once=*/true);
  EXPECT_EQ(closed, std::vector<bool>({false, false, true, true}));
  early = nullptr;
  late = nullptr;
  EXPECT_TRUE(connections.AwaitNone(base::MonotonicNow()));
}

TEST(ConnectionsTest, ACloserMayEndItsConnection) {
  Connections connections(kSmall);
  Lease lease = connections.TryAdd("a");
  lease->SetCloser([&lease](bool) { lease = nullptr; });
  connections.Close(/*at_once=*/true);
  EXPECT_EQ(connections.count(), 0);
}

}  // namespace
}  // namespace isoscope::http
