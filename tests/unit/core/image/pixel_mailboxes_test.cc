#include "core/image/pixel_mailboxes.h"

#include <memory>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::image {
namespace {

DrawnPixels PixelsOf(int width) {
  return {.image = FrameImage(width, 1), .layers = {}, .memory = nullptr};
}

TEST(PixelMailboxesTest, PixelsComeOutOfTheirMailboxInOrder) {
  const auto mailboxes = PixelMailboxes::Make();
  const auto first = mailboxes->Open();
  const auto second = mailboxes->Open();
  EXPECT_GT(first->number(), 0);
  EXPECT_NE(first->number(), second->number());
  EXPECT_TRUE(mailboxes->Put(first->number(), PixelsOf(1)));
  EXPECT_TRUE(mailboxes->Put(second->number(), PixelsOf(2)));
  EXPECT_TRUE(mailboxes->Put(first->number(), PixelsOf(3)));
  EXPECT_EQ(first->Take()->image.width, 1);
  EXPECT_EQ(first->Take()->image.width, 3);
  EXPECT_EQ(first->Take(), std::nullopt);
  EXPECT_EQ(second->Take()->image.width, 2);
}

TEST(PixelMailboxesTest, NothingCanBePutIntoAMailboxThatIsNotOpen) {
  const auto mailboxes = PixelMailboxes::Make();
  auto mailbox = mailboxes->Open();
  const std::int64_t number = mailbox->number();
  EXPECT_FALSE(mailboxes->Put(number + 1, PixelsOf(1)));
  EXPECT_FALSE(mailboxes->Put(0, PixelsOf(1)));
  mailbox.reset();
  EXPECT_FALSE(mailboxes->Put(number, PixelsOf(1)));
  EXPECT_NE(mailboxes->Open()->number(), number) << "a late agent would reach another frame";
}

TEST(PixelMailboxesTest, WhatIsNotTakenIsFreedWithTheMailbox) {
  const auto mailboxes = PixelMailboxes::Make();
  auto mailbox = mailboxes->Open();
  auto memory = std::make_shared<const int>(7);
  const std::weak_ptr<const int> life = memory;
  DrawnPixels pixels = PixelsOf(1);
  pixels.memory = std::move(memory);
  EXPECT_TRUE(mailboxes->Put(mailbox->number(), std::move(pixels)));
  EXPECT_FALSE(life.expired());
  mailbox.reset();
  EXPECT_TRUE(life.expired()) << "a cancelled frame keeps its memory";
}

TEST(PixelMailboxesTest, AMailboxOutlivesTheLastOtherReference) {
  auto mailboxes = PixelMailboxes::Make();
  const auto mailbox = mailboxes->Open();
  EXPECT_TRUE(mailboxes->Put(mailbox->number(), PixelsOf(5)));
  mailboxes.reset();
  EXPECT_EQ(mailbox->Take()->image.width, 5);
}

TEST(PixelMailboxesTest, ThreadsNeverGetEachOthersPixels) {
  const auto mailboxes = PixelMailboxes::Make();
  std::vector<std::thread> threads;
  for (int thread = 1; thread <= 4; ++thread) {
    threads.emplace_back([&mailboxes, thread] {
      for (int i = 0; i < 200; ++i) {
        const auto mailbox = mailboxes->Open();
        ASSERT_TRUE(mailboxes->Put(mailbox->number(), PixelsOf(thread)));
        ASSERT_EQ(mailbox->Take()->image.width, thread);
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
}

}  // namespace
}  // namespace isoscope::image
