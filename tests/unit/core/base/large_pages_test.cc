#include "core/base/large_pages.h"

#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <new>
#include <numeric>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/memory_info.h"

namespace isoscope::base {
namespace {

TEST(LargePageVectorTest, HoldsWhatIsPutInWhateverItsSize) {
  for (const std::size_t size : {std::size_t{1}, std::size_t{1000}, kLargePageBytes / 8 - 1,
                                 kLargePageBytes / 8, 3 * kLargePageBytes / 8 + 5}) {
    LargePageVector<std::uint64_t> numbers(size, 7);
    EXPECT_EQ(numbers.front(), 7U);
    EXPECT_EQ(numbers.back(), 7U);
    std::iota(numbers.begin(), numbers.end(), std::uint64_t{0});
    const LargePageVector<std::uint64_t> copy = numbers;
    numbers.assign(size + kLargePageBytes, 1);
    EXPECT_EQ(copy.back(), size - 1);
    EXPECT_NE(copy, numbers);
  }
}

TEST(LargePageVectorTest, LargeOnesBeginAtALargePage) {
  const LargePageVector<char> bytes(kLargePageBytes);
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(bytes.data()) % kLargePageBytes, 0U);
}

// Symptom: agents grew beyond their limit, frame by frame, by images that they had freed.
TEST(LargePageVectorTest, WhatIsFreedGoesBackToTheSystemWhateverLiesBesideIt) {
  constexpr std::size_t kCount = std::size_t{1} << 20;  // 8 MiB
  const std::size_t before = ResidentBytes();
  std::vector<std::unique_ptr<char[]>> beside;
  for (int i = 0; i < 40; ++i) {
    const LargePageVector<std::uint64_t> one(kCount, 1);
    const LargePageVector<std::uint32_t> two(kCount, 1);
    beside.push_back(std::make_unique<char[]>(100'000));
    EXPECT_EQ(one.back() + two.back(), 2U);
  }
  EXPECT_LT(ResidentBytes(), before + 4 * kCount * sizeof(std::uint64_t));
}

// Symptom: images a little above 2 MiB took 4, and a process exceeded its limit by them.
TEST(LargePageVectorTest, TheRestOfTheLastLargePageIsNotResident) {
  const std::size_t before = ResidentBytes();
  std::vector<LargePageVector<char>> vectors;
  for (int i = 0; i < 20; ++i) {
    vectors.emplace_back(kLargePageBytes + 5, 'x');
  }
  EXPECT_LT(ResidentBytes(), before + vectors.size() * kLargePageBytes * 5 / 4);
}

TEST(LargePageVectorTest, MoreThanCanBeAddressedThrows) {
  LargePageAllocator<std::uint64_t> allocator;
  EXPECT_THROW(allocator.allocate(std::numeric_limits<std::size_t>::max() / 8), std::bad_alloc);
}

}  // namespace
}  // namespace isoscope::base
