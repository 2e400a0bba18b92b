#include "core/source/remote/core_files.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>

#include "gtest/gtest.h"
#include <sys/resource.h>

#include "tests/support/skips.h"

namespace isoscope::source {
namespace {

// Ends the child of a death test with its filter and its limit in the message.
[[noreturn]] void TellLimits(const char* full, rlim_t most) {
  setenv("ISOSCOPE_FULL_CORES", full, 1);  // NOLINT(concurrency-mt-unsafe)
  rlimit limit{.rlim_cur = most, .rlim_max = most};
  setrlimit(RLIMIT_CORE, &limit);
  ForbidCores();
  ForbidCores();
  getrlimit(RLIMIT_CORE, &limit);
  std::ifstream file("/proc/self/coredump_filter");
  std::string filter;
  file >> filter;
  std::fprintf(stderr, "filter %s, limit %s.", filter.c_str(),
               std::to_string(limit.rlim_cur).c_str());
  std::_Exit(3);
}

// address_program_test.py aborts programs, and looks for cores.
TEST(CoreFilesTest, ThereAreNoneUnlessTheyAreWanted) {
  std::ifstream file("/proc/self/coredump_filter");
  std::string before;
  if (!(file >> before)) {
    ISOSCOPE_SKIP("cores", "this system has no /proc/self/coredump_filter");
  }
  rlimit limit{};
  ASSERT_EQ(getrlimit(RLIMIT_CORE, &limit), 0);
  const rlim_t most = limit.rlim_max;
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto told = [](const std::string& filter, rlim_t most_bytes) {
    return "filter " + filter + ", limit " + std::to_string(most_bytes) + "\\.";
  };
  const std::string none = told("00000000", std::min<rlim_t>(most, 1));
  EXPECT_EXIT(TellLimits("", most), ::testing::ExitedWithCode(3), none);
  EXPECT_EXIT(TellLimits("0", most), ::testing::ExitedWithCode(3), none);
  EXPECT_EXIT(TellLimits("1", most), ::testing::ExitedWithCode(3), told(before, most));
  // Who may write none keeps that limit.
  EXPECT_EXIT(TellLimits("", 0), ::testing::ExitedWithCode(3), told("00000000", 0));
}

}  // namespace
}  // namespace isoscope::source
