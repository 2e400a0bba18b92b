#include "core/base/memory_info.h"

#include <unistd.h>

#include <cstddef>
#include <memory>

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

}  // namespace
}  // namespace isoscope::base
