#include "tests/support/jumping_clock.h"

#include <fcntl.h>
#include <unistd.h>

#include <cstdint>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

namespace isoscope::testing {
namespace {

constexpr char kFile[] = "date_offset";

}  // namespace

std::vector<std::string> JumpingClock::environment() const {
  return {absl::StrCat("LD_PRELOAD=", ISOSCOPE_TEST_DATE_FUNCTIONS),
          absl::StrCat("ISOSCOPE_TEST_DATE_OFFSET=", dir_.path(), "/", kFile)};
}

void JumpingClock::SetOffset(absl::Duration offset) {
  const std::int64_t seconds = absl::ToInt64Seconds(offset);
  const std::string path = absl::StrCat(dir_.path(), "/", kFile);
  const int file = open(path.c_str(), O_CREAT | O_WRONLY | O_CLOEXEC, 0600);
  EXPECT_EQ(pwrite(file, &seconds, sizeof(seconds), 0), ssize_t{sizeof(seconds)}) << path;
  close(file);
}

}  // namespace isoscope::testing
