#include "server/frame/unresolved_counts.h"

#include <optional>
#include <set>
#include <string>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "tests/support/metric_values.h"

namespace isoscope::server {
namespace {

using volume::InsideRule;

TEST(UnresolvedCountsTest, KeysTellDatasetsSurfacesAndLevelsApart) {
  const std::set<std::string> keys = {
      UnresolvedCounts::KeyOf("a", InsideRule::OfIsovalue(1), 1),
      UnresolvedCounts::KeyOf("b", InsideRule::OfIsovalue(1), 1),
      UnresolvedCounts::KeyOf("a", InsideRule::OfIsovalue(2), 1),
      UnresolvedCounts::KeyOf("a", InsideRule::OfIsovalue(1), 2),
      UnresolvedCounts::KeyOf("a", InsideRule::OfLabels({1}), 1),
      UnresolvedCounts::KeyOf("a", InsideRule::OfLabels({1, 2}), 1)};
  EXPECT_EQ(keys.size(), 6U);
  EXPECT_EQ(UnresolvedCounts::KeyOf("a", InsideRule::OfLabels({1, 2}), 1),
            UnresolvedCounts::KeyOf("a", InsideRule::OfLabels({1, 2}, /*smooths=*/true), 1))
      << "smooth surfaces pass the same cells";
}

TEST(UnresolvedCountsTest, CountsAreKeptAlsoThatThereAreNone) {
  UnresolvedCounts counts;
  EXPECT_EQ(counts.Find("a"), std::nullopt);
  counts.Insert("a", 7);
  counts.Insert("b", 0);
  EXPECT_EQ(counts.Find("a"), 7);
  EXPECT_EQ(counts.Find("b"), 0);
  base::MetricFamily lookups;
  lookups.name = "lookups";
  counts.AppendSamples(&lookups);
  auto values = testing::ValuesOf({lookups});
  EXPECT_EQ(values["lookups cache=unresolved_counts result=hit"], 2);
  EXPECT_EQ(values["lookups cache=unresolved_counts result=miss"], 1);
}

TEST(UnresolvedCountsTest, TheOldestGoFirst) {
  UnresolvedCounts counts;
  const std::string padding(1000, 'x');
  for (int i = 0; i < 1000; ++i) {
    counts.Insert(absl::StrCat(i, padding), i);
    EXPECT_EQ(counts.Find(absl::StrCat(i, padding)), i);
  }
  EXPECT_EQ(counts.Find(absl::StrCat(0, padding)), std::nullopt);
}

}  // namespace
}  // namespace isoscope::server
