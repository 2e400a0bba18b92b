#include "core/volume/label_values.h"

#include <cmath>
#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::volume {
namespace {

using ::testing::ElementsAre;
using ::testing::Optional;

LabelValues ListOf(const std::vector<double>& values, std::size_t max_count = 4) {
  LabelValues list(max_count);
  for (const double value : values) {
    list.Add(value);
  }
  return list;
}

TEST(LabelValuesTest, WholeNumbersThatADoubleTellsApartMayBeLabels) {
  for (const double value : {0.0, -0.0, 3.0, -7.0, 0x1p53, -0x1p53, 9007199254740991.0}) {
    EXPECT_TRUE(MayBeLabel(value)) << value;
  }
  for (const double value : {0.5, -1e-300, 0x1p53 + 2, -0x1p60, 4503599627370495.5,
                             std::numeric_limits<double>::infinity(), std::nan("")}) {
    EXPECT_FALSE(MayBeLabel(value)) << value;
  }
}

TEST(LabelValuesTest, ValuesAreListedOnceInTheirOrder) {
  const LabelValues list = ListOf({7, 0, -3, 7, -0.0, 0, 7});
  EXPECT_THAT(list.values(), ElementsAre(-3, 0, 7));
  EXPECT_FALSE(std::signbit(ListOf({-0.0}).values()[0]));
  EXPECT_FALSE(list.has_more());
  EXPECT_FALSE(list.is_done());
}

TEST(LabelValuesTest, MissingAndInfiniteSamplesAreNoValues) {
  constexpr double kInf = std::numeric_limits<double>::infinity();
  const LabelValues list = ListOf({std::nan(""), kInf, 2, -kInf});
  EXPECT_THAT(list.values(), ElementsAre(2));
  EXPECT_FALSE(list.other_value().has_value());
}

TEST(LabelValuesTest, MoreThanTheMostAreOnlyKnownToBeMore) {
  EXPECT_FALSE(ListOf({1, 2, 3, 4, 4, 1}).has_more());
  const LabelValues list = ListOf({1, 2, 3, 4, 5});
  EXPECT_TRUE(list.has_more());
  EXPECT_TRUE(list.is_done());
  EXPECT_THAT(list.values(), ElementsAre(1, 2, 3, 4));
}

TEST(LabelValuesTest, TheLeastValueThatIsNoLabelIsKept) {
  const LabelValues list = ListOf({2, 1.5, 0.5, 0.75});
  EXPECT_TRUE(list.is_done());
  EXPECT_THAT(list.other_value(), Optional(0.5));
  EXPECT_THAT(list.values(), ElementsAre(2));
}

TEST(LabelValuesTest, ListsAddUp) {
  LabelValues sum = ListOf({1, 5});
  sum.Add(ListOf({5, 3}));
  EXPECT_THAT(sum.values(), ElementsAre(1, 3, 5));
  EXPECT_FALSE(sum.is_done());
  LabelValues with_other = sum;
  with_other.Add(ListOf({0.5}));
  EXPECT_THAT(with_other.other_value(), Optional(0.5));
  LabelValues with_more = sum;
  with_more.Add(ListOf({6, 7}));
  EXPECT_TRUE(with_more.has_more());
  LabelValues sum_with_more = sum;
  sum_with_more.Add(ListOf({1, 2}, 1));
  EXPECT_TRUE(sum_with_more.has_more());
  const LabelValues same = LabelValues::Of({1, 3}, true, 0.25);
  EXPECT_THAT(same.values(), ElementsAre(1, 3));
  EXPECT_TRUE(same.has_more());
  EXPECT_THAT(same.other_value(), Optional(0.25));
}

}  // namespace
}  // namespace isoscope::volume
