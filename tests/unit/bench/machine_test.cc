#include "bench/machine.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::bench {
namespace {

using ::testing::HasSubstr;

TEST(MachineTest, HasCoresMemoryAndNames) {
  const Machine machine = DescribeMachine();
  EXPECT_GE(machine.core_count, 1);
  EXPECT_GT(machine.memory_gib, 0);
  EXPECT_NE(machine.processor, "");
  EXPECT_THAT(machine.system, HasSubstr("Linux"));
  EXPECT_EQ(ToString({.processor = "P", .core_count = 2, .memory_gib = 7.75, .system = "S"}),
            "P, 2 cores, 7.8 GiB, S");
  EXPECT_EQ(ToString({.processor = "P", .core_count = 1, .memory_gib = 1, .system = "S"}),
            "P, 1 core, 1.0 GiB, S");
}

}  // namespace
}  // namespace isoscope::bench
