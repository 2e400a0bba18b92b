#include "web-gateway/connections.h"

#include <memory>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"

namespace isoscope::gateway {
namespace {

TEST(ConnectionsTest, APlaceComesBackWithItsLease) {
  Connections connections(2);
  std::shared_ptr<Connections::Lease> first = connections.TryAdd();
  const std::shared_ptr<Connections::Lease> second = connections.TryAdd();
  ASSERT_NE(first, nullptr);
  ASSERT_NE(second, nullptr);
  EXPECT_EQ(connections.TryAdd(), nullptr);
  first = nullptr;
  EXPECT_EQ(connections.count(), 1);
  EXPECT_NE(connections.TryAdd(), nullptr);
}

TEST(ConnectionsTest, ClosingReachesThoseThatAreThereAndThoseThatBecomeReadyLater) {
  Connections connections(4);
  std::vector<bool> closed;
  std::shared_ptr<Connections::Lease> early = connections.TryAdd();
  std::shared_ptr<Connections::Lease> late = connections.TryAdd();
  early->SetCloser([&](bool at_once) { closed.push_back(at_once); });
  connections.Close(/*at_once=*/false);
  EXPECT_EQ(closed, std::vector<bool>({false}));
  late->SetCloser([&](bool at_once) { closed.push_back(at_once); });
  EXPECT_EQ(closed, std::vector<bool>({false, false}));
  EXPECT_EQ(connections.TryAdd(), nullptr);
  EXPECT_FALSE(connections.AwaitNone(base::MonotonicNow()));
  connections.Close(/*at_once=*/true);
  EXPECT_EQ(closed, std::vector<bool>({false, false, true, true}));
  early = nullptr;
  late = nullptr;
  EXPECT_TRUE(connections.AwaitNone(base::MonotonicNow()));
}

TEST(ConnectionsTest, ACloserMayEndItsConnection) {
  Connections connections(1);
  std::shared_ptr<Connections::Lease> lease = connections.TryAdd();
  lease->SetCloser([&lease](bool) { lease = nullptr; });
  connections.Close(/*at_once=*/true);
  EXPECT_EQ(connections.count(), 0);
}

}  // namespace
}  // namespace isoscope::gateway
