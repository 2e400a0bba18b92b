#include "core/base/memory_info.h"

#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/memory_pool.h"

namespace isoscope::base {
namespace {

TEST(MemoryInfoTest, ResidentBytesAreWhatThisProcessTouches) {
  constexpr std::size_t kBytes = std::size_t{96} << 20;
  const std::size_t before = ResidentBytes();
  EXPECT_GT(before, std::size_t{1} << 20);
  const auto pool = MemoryPool::Make();
  pool->Populate(kBytes);
  const std::size_t grown = ResidentBytes() - before;
  EXPECT_GT(grown, kBytes / 4 * 3);
  EXPECT_LT(grown, kBytes / 4 * 5);
}

TEST(MemoryInfoTest, UsableBytesAreMoreThanThisProcessHasAndNoMoreThanTheMachine) {
  EXPECT_GT(UsableBytes(), ResidentBytes());
  EXPECT_LE(UsableBytes(), static_cast<std::size_t>(::sysconf(_SC_PHYS_PAGES)) *
                               static_cast<std::size_t>(::sysconf(_SC_PAGESIZE)));
}

TEST(MemoryInfoTest, WhatWasFreedGoesBackToTheKernelWhenAsked) {
  // Small pieces with a kept one behind: malloc can't give them back by itself.
  constexpr std::size_t kPieces = 64 << 10;
  constexpr std::size_t kPieceBytes = 1 << 10;
  std::vector<std::unique_ptr<char[]>> pieces(kPieces);
  for (std::unique_ptr<char[]>& piece : pieces) {
    piece = std::make_unique<char[]>(kPieceBytes);
  }
  const auto kept = std::make_unique<char[]>(kPieceBytes);
  pieces.clear();
  [[maybe_unused]] const std::size_t before = ResidentBytes();
  ReturnFreedMemory();
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // they have their own malloc
  EXPECT_LT(ResidentBytes(), before - kPieces * kPieceBytes / 2);
#endif
}

TEST(MemoryInfoTest, ReturnedPagesAreFreeAndTheirNeighboursStay) {
  constexpr std::size_t kBytes = std::size_t{32} << 20;
  std::vector<char> buffer(kBytes, 'a');
  const std::size_t before = ResidentBytes();
  constexpr std::size_t kBegin = 12'345;
  constexpr std::size_t kEnd = kBytes - 54'321;
  ReturnPages(buffer.data() + kBegin, kEnd - kBegin);
  EXPECT_LT(ResidentBytes() + kBytes / 4 * 3, before);
  EXPECT_EQ(std::count(buffer.begin(), buffer.begin() + kBegin, 'a'), std::ptrdiff_t{kBegin});
  EXPECT_EQ(std::count(buffer.begin() + kEnd, buffer.end(), 'a'), std::ptrdiff_t{kBytes - kEnd});
  std::fill(buffer.begin(), buffer.end(), 'b');
  EXPECT_EQ(buffer[kBytes / 2], 'b');
}

TEST(MemoryInfoTest, LessThanAPageIsNotReturned) {
  std::vector<char> buffer(20'000, 'a');
  const auto page = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  for (const std::size_t size : {std::size_t{0}, std::size_t{1}, page - 1}) {
    ReturnPages(buffer.data() + 1, size);
  }
  EXPECT_EQ(std::count(buffer.begin(), buffer.end(), 'a'), std::ptrdiff_t{20'000});
}

TEST(MemoryInfoTest, ProcessorTimeGrowsWithWork) {
  const absl::Duration before = ProcessorTime();
  volatile int sum = 0;
  while (ProcessorTime() - before < absl::Milliseconds(2)) {
    sum = sum + 1;
  }
  EXPECT_GT(before, absl::ZeroDuration());
}

TEST(RestWatchTest, RestAfterWorkIsToldOnce) {
  RestWatch watch;
  constexpr absl::Duration kWork = absl::Seconds(3);
  constexpr absl::Duration kPolls = absl::Milliseconds(20);
  absl::Duration used = kWork;
  EXPECT_FALSE(watch.HasComeToRest(used)) << "it starts";
  EXPECT_TRUE(watch.HasComeToRest(used += kPolls));
  EXPECT_FALSE(watch.HasComeToRest(used += kPolls)) << "it still rests";
  EXPECT_FALSE(watch.HasComeToRest(used += kWork));
  EXPECT_FALSE(watch.HasComeToRest(used += kWork));
  EXPECT_TRUE(watch.HasComeToRest(used += kPolls));
  EXPECT_FALSE(watch.HasComeToRest(used));
}

}  // namespace
}  // namespace isoscope::base
