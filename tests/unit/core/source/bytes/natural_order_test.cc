#include "core/source/bytes/natural_order.h"

#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace isoscope::source {
namespace {

TEST(NaturalLessTest, NumbersCountAsNumbersAndTheOrderIsStrict) {
  const std::vector<std::string> sorted = {
      "", "a", "a1", "a01", "a2", "a09", "a9b", "a10", "a99999999999999999999", "b"};
  for (std::size_t i = 0; i < sorted.size(); ++i) {
    for (std::size_t j = 0; j < sorted.size(); ++j) {
      if (sorted[i] == "a1" || sorted[i] == "a01" || sorted[j] == "a1" || sorted[j] == "a01") {
        continue;  // equal numbers: below
      }
      EXPECT_EQ(NaturalLess(sorted[i], sorted[j]), i < j) << sorted[i] << " " << sorted[j];
    }
  }
  EXPECT_NE(NaturalLess("a1", "a01"), NaturalLess("a01", "a1"));
}

}  // namespace
}  // namespace isoscope::source
