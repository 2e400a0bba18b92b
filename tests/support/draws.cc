#include "tests/support/draws.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/check.h"
#include "core/io/read_queue.h"

namespace isoscope::testing {

std::size_t Dice::Size(std::size_t low, std::size_t high) {
  const double log_low = std::log(static_cast<double>(low));
  const double log_high = std::log(static_cast<double>(high));
  const double size = std::exp(log_low + (log_high - log_low) * Unit());
  return std::clamp(static_cast<std::size_t>(size), low, high);
}

std::uint64_t DrawSeed(absl::string_view salt) {
  std::uint64_t seed = 1;
  // NOLINTNEXTLINE(concurrency-mt-unsafe): nobody sets variables
  if (const char* const text = std::getenv("ISOSCOPE_DRAW_SEED"); text != nullptr) {
    ISOSCOPE_CHECK(absl::SimpleAtoi(text, &seed));
  }
  const ::testing::TestInfo* const test = ::testing::UnitTest::GetInstance()->current_test_info();
  const std::string name =
      test == nullptr ? "" : absl::StrCat(test->test_suite_name(), ".", test->name());
  for (const char c : absl::StrCat(name, "/", salt)) {
    seed = base::RandomBits(seed, static_cast<unsigned char>(c));
  }
  return seed;
}

std::size_t Limits::read_bytes() const {
  return std::min(memory_limit_bytes / 32, io::ReadQueueOptions().max_bytes);
}

std::ostream& operator<<(std::ostream& out, const Limits& limits) {
  out << limits.thread_count << (limits.thread_count == 1 ? " thread, " : " threads, ")
      << (limits.one_thread_a_step ? "one a step, " : "");
  if (limits.memory_limit_bytes == Limits::kNoMemoryLimit) {
    return out << "no memory limit";
  }
  return out << "a memory limit of " << limits.memory_limit_bytes << " bytes";
}

Limits DrawLimits(Dice* dice) {
  Limits limits;
  limits.thread_count = dice->OneOf(kThreadCounts);
  if (!dice->OneIn(4)) {
    limits.memory_limit_bytes = dice->Size(kLeastMemoryLimitBytes, Limits::kNoMemoryLimit);
  }
  limits.one_thread_a_step = dice->OneIn(2);
  return limits;
}

}  // namespace isoscope::testing
