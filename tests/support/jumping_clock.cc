#include "tests/support/jumping_clock.h"

#include <fcntl.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <string>

#include "gtest/gtest.h"

namespace isoscope::testing {
namespace {

constexpr char kPreload[] = "LD_PRELOAD";
constexpr char kOffsetFile[] = "ISOSCOPE_TEST_DATE_OFFSET";
constexpr char kFile[] = "date_offset";

}  // namespace

// NOLINTBEGIN(concurrency-mt-unsafe): before the test has threads that read the environment
JumpingClock::JumpingClock() {
  SetOffset(absl::ZeroDuration());
  setenv(kPreload, ISOSCOPE_TEST_DATE_FUNCTIONS, /*overwrite=*/1);
  setenv(kOffsetFile, dir_.Sub(kFile).c_str(), /*overwrite=*/1);
}

JumpingClock::~JumpingClock() {
  unsetenv(kPreload);
  unsetenv(kOffsetFile);
}
// NOLINTEND(concurrency-mt-unsafe)

void JumpingClock::SetOffset(absl::Duration offset) {
  const std::int64_t seconds = absl::ToInt64Seconds(offset);
  const std::string path = dir_.Sub(kFile);
  const int file = open(path.c_str(), O_CREAT | O_WRONLY | O_CLOEXEC, 0600);
  EXPECT_EQ(pwrite(file, &seconds, sizeof(seconds), 0), ssize_t{sizeof(seconds)}) << path;
  close(file);
}

}  // namespace isoscope::testing
