// The interrupt that readers find, and what goes with a process that ends at once.

#include "core/base/process_interrupt.h"

#include <filesystem>
#include <fstream>
#include <memory>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::base {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

TEST(ProcessInterruptTest, NeverFiresUnlessOneIsSet) {
  EXPECT_FALSE(ProcessInterrupt().is_cancelled());
  Cancellation interrupt;
  SetProcessInterrupt(&interrupt);
  ISOSCOPE_EXPECT_OK(CheckProcessInterrupt());
  interrupt.Cancel();
  EXPECT_TRUE(ProcessInterrupt().is_cancelled());
  EXPECT_THAT(CheckProcessInterrupt(),
              StatusIs(absl::StatusCode::kCancelled, HasSubstr("interrupted")));
  SetProcessInterrupt(nullptr);
  ISOSCOPE_EXPECT_OK(CheckProcessInterrupt());
}

TEST(UnfinishedPathTest, UnfinishedFilesAndFoldersAreRemovedAndOthersStay) {
  const testing::TempDir dir;
  std::filesystem::create_directories(dir.Sub("folder/inner"));
  for (const char* const name : {"folder/inner/a", "file", "finished", "other"}) {
    std::ofstream(dir.Sub(name)) << "x";
  }
  const UnfinishedPath folder(dir.Sub("folder"));
  const UnfinishedPath file(dir.Sub("file"));
  const UnfinishedPath absent(dir.Sub("absent"));
  auto finished = std::make_unique<UnfinishedPath>(dir.Sub("finished"));
  finished.reset();
  RemoveUnfinishedPaths(absl::Minutes(2));
  EXPECT_FALSE(std::filesystem::exists(dir.Sub("folder")));
  EXPECT_FALSE(std::filesystem::exists(dir.Sub("file")));
  EXPECT_TRUE(std::filesystem::exists(dir.Sub("finished")));
  EXPECT_TRUE(std::filesystem::exists(dir.Sub("other")));
}

TEST(UnfinishedPathTest, APathThatIsNamedTwiceIsUnfinishedUntilBothAreGone) {
  const testing::TempDir dir;
  std::ofstream(dir.Sub("file")) << "x";
  const UnfinishedPath first(dir.Sub("file"));
  auto second = std::make_unique<UnfinishedPath>(dir.Sub("file"));
  second.reset();
  RemoveUnfinishedPaths(absl::Minutes(2));
  EXPECT_FALSE(std::filesystem::exists(dir.Sub("file")));
}

TEST(OrderlyEndTest, IsUnderWayWhileOneLivesWhoseTimeIsNotOver) {
  EXPECT_FALSE(OrderlyEnd::IsUnderWay());
  {
    const OrderlyEnd first(absl::Hours(1));
    EXPECT_TRUE(OrderlyEnd::IsUnderWay());
    const OrderlyEnd shorter(absl::ZeroDuration());
    EXPECT_TRUE(OrderlyEnd::IsUnderWay()) << "the longest counts";
  }
  EXPECT_FALSE(OrderlyEnd::IsUnderWay());
}

TEST(OrderlyEndTest, EndsByItsTime) {
  const OrderlyEnd over(-absl::Seconds(1));
  EXPECT_FALSE(OrderlyEnd::IsUnderWay());
}

}  // namespace
}  // namespace isoscope::base
