// Tests are compiled with less optimisation than the product. An inline function that both have out
// of line is there once in a program, and must be the product's copy: what is tested is what ships.

#include "tests/unit/support/link_order.h"

#include "gtest/gtest.h"

namespace isoscope::testing {
namespace {

TEST(LinkOrderTest, InlineFunctionsAreTheProducts) {
  EXPECT_STREQ(WhoCompiledItForTheProduct(), "product");
  EXPECT_STREQ(WhoCompiledIt(), "product");
}

}  // namespace
}  // namespace isoscope::testing
