#include "server/frame/frame_ticket.h"

#include <memory>
#include <optional>

#include "absl/synchronization/notification.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/task_arena.h"
#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

using isoscope::testing::StatusIs;
using ::testing::HasSubstr;

// The rest of a frame needs agents: isosurface_service_test and planes_test.
CoordinatorStateOptions Options() {
  CoordinatorStateOptions options;
  options.max_concurrent_frames = 1;
  options.max_queued_frames = 1;
  options.arena = std::make_shared<base::TaskArena>(1);
  options.memory_limit_bytes = CoordinatorMemory::kMinLimitBytes;
  return options;
}

frame::FrameSpec SpecOf(int side) {
  frame::FrameSpec spec;
  spec.viewport = {side, side};
  return spec;
}

class FrameTicketTest : public ::testing::Test {
 protected:
  // A frame of `client` whose response may have any size.
  std::unique_ptr<FrameTicket> Ticket(const char* client = "ipv4:192.0.2.1:1") {
    return std::make_unique<FrameTicket>(
        &state_, CallOrigin{.request = base::TraceContext::Random(), .client = client},
        FrameClaim{.delivery = Delivery::kParts});
  }

  CoordinatorState state_{Options()};
};

TEST_F(FrameTicketTest, APlaceIsFreeAgainWhenItIsGivenBack) {
  const auto first = Ticket();
  ISOSCOPE_ASSERT_OK(first->TakePlace(SpecOf(64)));
  {
    const auto second = Ticket();
    ISOSCOPE_ASSERT_OK(second->TakePlace(SpecOf(64)));
    EXPECT_EQ(state_.CountFrames().queued, 2);
    EXPECT_THAT(Ticket()->TakePlace(SpecOf(64)),
                StatusIs(absl::StatusCode::kResourceExhausted,
                         HasSubstr("limits: 1 and 1; --max-concurrent-frames")));
  }
  ISOSCOPE_EXPECT_OK(Ticket()->TakePlace(SpecOf(64)));
}

TEST_F(FrameTicketTest, AFrameAboveTheMemoryLimitTakesNoPlace) {
  for (int i = 0; i < 5; ++i) {
    EXPECT_THAT(Ticket()->TakePlace(SpecOf(16384)),
                StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("16384 x 16384")));
  }
  ISOSCOPE_EXPECT_OK(Ticket()->TakePlace(SpecOf(64)));
}

TEST_F(FrameTicketTest, ScheduledWorkRuns) {
  const auto ticket = Ticket();
  ISOSCOPE_ASSERT_OK(ticket->TakePlace(SpecOf(64)));
  absl::Notification ran;
  ticket->Schedule([&] {
    EXPECT_EQ(state_.frames.counts().waiting_clients, 0);
    ran.Notify();
  });
  ran.WaitForNotification();
}

TEST_F(FrameTicketTest, RefusalsAreCountedByReason) {
  const auto first = Ticket();
  ISOSCOPE_ASSERT_OK(first->TakePlace(SpecOf(64)));
  const auto second = Ticket();
  ISOSCOPE_ASSERT_OK(second->TakePlace(SpecOf(64)));
  EXPECT_FALSE(Ticket("b")->TakePlace(SpecOf(64)).ok());
  EXPECT_FALSE(Ticket("b")->TakePlace(SpecOf(16384)).ok());
  EXPECT_EQ(state_.frame_metrics.refused.value(), 1);
  EXPECT_EQ(state_.frame_metrics.too_large.value(), 1);
  EXPECT_EQ(state_.frames.counts().outside_clients, 1);
}

}  // namespace
}  // namespace isoscope::server
