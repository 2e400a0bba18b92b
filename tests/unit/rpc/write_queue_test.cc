#include "rpc/write_queue.h"

#include <atomic>
#include <string>
#include <thread>
#include <vector>

#include "absl/time/clock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::rpc {
namespace {

struct Message {
  std::string text;
  [[nodiscard]] std::size_t ByteSizeLong() const { return text.size(); }
};

class WriteQueueTest : public ::testing::Test {
 protected:
  std::vector<std::string> written_;
  std::vector<absl::Status> finished_;
  WriteQueue<Message> queue_{4,
                             [this](const Message* message) { written_.push_back(message->text); },
                             [this](const absl::Status& status) { finished_.push_back(status); }};
};

TEST_F(WriteQueueTest, OneWriteIsInFlightAndOrderIsKept) {
  ASSERT_TRUE(queue_.Push({"a"}));
  ASSERT_TRUE(queue_.Push({"b"}));
  ASSERT_TRUE(queue_.Push({"c"}));
  EXPECT_EQ(written_, std::vector<std::string>({"a"}));
  queue_.OnWriteDone(true);
  EXPECT_EQ(written_, std::vector<std::string>({"a", "b"}));
  queue_.OnWriteDone(true);
  queue_.OnWriteDone(true);
  EXPECT_EQ(written_, std::vector<std::string>({"a", "b", "c"}));
}

TEST_F(WriteQueueTest, AMessageForAnIdleQueueIsMadeOnlyForOne) {
  int made = 0;
  const auto make = [&made] { return Message{std::to_string(++made)}; };
  queue_.PushIfIdle(make);
  queue_.PushIfIdle(make);  // the first is in flight
  queue_.OnWriteDone(true);
  ASSERT_TRUE(queue_.Push({"a"}));
  queue_.PushIfIdle(make);
  queue_.OnWriteDone(true);
  queue_.PushIfIdle(make);
  EXPECT_EQ(written_, std::vector<std::string>({"1", "a", "2"}));
  queue_.OnWriteDone(true);
  queue_.Finish(absl::OkStatus());
  queue_.PushIfIdle(make);
  EXPECT_EQ(made, 2) << "the stream has ended";
}

TEST_F(WriteQueueTest, AClosedQueueTakesNoMessageThoughItIsIdle) {
  queue_.Close();
  queue_.PushIfIdle([] { return Message{"a"}; });
  EXPECT_TRUE(written_.empty());
}

TEST_F(WriteQueueTest, FinishWithOkWaitsForAllThatIsQueued) {
  ASSERT_TRUE(queue_.Push({"a"}));
  ASSERT_TRUE(queue_.Push({"b"}));
  queue_.Finish(absl::OkStatus());
  queue_.OnWriteDone(true);
  EXPECT_TRUE(finished_.empty());
  queue_.OnWriteDone(true);
  ASSERT_EQ(finished_.size(), 1u);
  EXPECT_TRUE(finished_[0].ok());
}

TEST_F(WriteQueueTest, FinishWithAnErrorDropsTheQueueButNotTheWriteInFlight) {
  ASSERT_TRUE(queue_.Push({"a"}));
  ASSERT_TRUE(queue_.Push({"b"}));
  queue_.Finish(absl::DataLossError("x"));
  EXPECT_TRUE(finished_.empty());
  queue_.OnWriteDone(true);
  EXPECT_EQ(written_, std::vector<std::string>({"a"}));
  ASSERT_EQ(finished_.size(), 1u);
  EXPECT_TRUE(absl::IsDataLoss(finished_[0]));
}

TEST_F(WriteQueueTest, OnlyTheFirstFinishCounts) {
  queue_.Finish(absl::DataLossError("first"));
  queue_.Finish(absl::OkStatus());
  ASSERT_EQ(finished_.size(), 1u);
  EXPECT_TRUE(absl::IsDataLoss(finished_[0]));
  EXPECT_FALSE(queue_.Push({"late"}));
}

TEST_F(WriteQueueTest, AnErrorAfterTheEndEndsWhatStillWaits) {
  ASSERT_TRUE(queue_.Push({"a"}));
  ASSERT_TRUE(queue_.Push({"b"}));
  queue_.Finish(absl::OkStatus());
  queue_.Finish(absl::DataLossError("x"));
  queue_.Finish(absl::OkStatus());
  queue_.OnWriteDone(true);
  EXPECT_EQ(written_, std::vector<std::string>({"a"}));
  ASSERT_EQ(finished_.size(), 1u);
  EXPECT_TRUE(absl::IsDataLoss(finished_[0]));
}

TEST_F(WriteQueueTest, ABrokenStreamFailsLaterPushes) {
  ASSERT_TRUE(queue_.Push({"a"}));
  ASSERT_TRUE(queue_.Push({"b"}));
  queue_.OnWriteDone(false);
  EXPECT_FALSE(queue_.Push({"c"}));
  EXPECT_EQ(written_, std::vector<std::string>({"a"}));
  queue_.Finish(absl::CancelledError(""));
  EXPECT_EQ(finished_.size(), 1u);
}

TEST_F(WriteQueueTest, AFullQueueHoldsItsProducerUntilAWriteMakesRoom) {
  ASSERT_TRUE(queue_.Push({"in flight"}));
  ASSERT_TRUE(queue_.Push({"fills"}));
  std::atomic<bool> is_pushed{false};
  std::thread producer([&] {
    EXPECT_TRUE(queue_.Push({"waits"}));
    is_pushed.store(true);
  });
  absl::SleepFor(absl::Milliseconds(20));
  EXPECT_FALSE(is_pushed.load());
  queue_.OnWriteDone(true);
  producer.join();
  EXPECT_TRUE(is_pushed.load());
}

TEST_F(WriteQueueTest, ClosingWakesAProducerThatWaits) {
  ASSERT_TRUE(queue_.Push({"in flight"}));
  ASSERT_TRUE(queue_.Push({"fills"}));
  std::thread producer([&] { EXPECT_FALSE(queue_.Push({"waits"})); });
  absl::SleepFor(absl::Milliseconds(10));
  queue_.Close();
  producer.join();
}

}  // namespace
}  // namespace isoscope::rpc
