#include "core/source/remote/core_files.h"

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>

#include "gtest/gtest.h"

#include "tests/support/skips.h"

namespace isoscope::source {
namespace {

// Ends the child of a death test with its filter in the message.
[[noreturn]] void TellFilter(const char* full) {
  setenv("ISOSCOPE_FULL_CORES", full, 1);  // NOLINT(concurrency-mt-unsafe)
  LeaveMemoryOutOfCores();
  LeaveMemoryOutOfCores();
  std::ifstream file("/proc/self/coredump_filter");
  std::string filter;
  file >> filter;
  std::fprintf(stderr, "filter %s.", filter.c_str());
  std::_Exit(3);
}

// address_program_test.py looks into cores.
TEST(CoreFilesTest, MemoryIsLeftOutUnlessItIsWanted) {
  std::ifstream file("/proc/self/coredump_filter");
  std::string before;
  if (!(file >> before)) {
    ISOSCOPE_SKIP("cores", "this system has no /proc/self/coredump_filter");
  }
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  EXPECT_EXIT(TellFilter(""), ::testing::ExitedWithCode(3), "filter 00000000\\.");
  EXPECT_EXIT(TellFilter("0"), ::testing::ExitedWithCode(3), "filter 00000000\\.");
  EXPECT_EXIT(TellFilter("1"), ::testing::ExitedWithCode(3), "filter " + before + "\\.");
}

}  // namespace
}  // namespace isoscope::source
