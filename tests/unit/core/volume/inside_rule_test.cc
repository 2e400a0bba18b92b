// A rule against its definition, sample by sample; and what keys and texts are made of it.

#include "core/volume/inside_rule.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>
#include <vector>

#include "absl/hash/hash.h"
#include "gtest/gtest.h"

namespace isoscope::volume {
namespace {

constexpr double kInf = std::numeric_limits<double>::infinity();

TEST(InsideRuleTest, AnIsovalueIsInsideAndSoIsAllAbove) {
  const InsideRule rule = InsideRule::OfIsovalue(3.5);
  EXPECT_FALSE(rule.has_labels());
  EXPECT_TRUE(rule.IsInside(3.5));
  EXPECT_TRUE(rule.IsInside(kInf));
  EXPECT_FALSE(rule.IsInside(std::nextafter(3.5, 0)));
  EXPECT_FALSE(rule.IsInside(std::nan("")));
}

TEST(InsideRuleTest, OnlySamplesThatAreALabelAreInside) {
  const InsideRule rule = InsideRule::OfLabels({7, -2, 3});
  EXPECT_TRUE(rule.has_labels());
  for (const double label : {-2.0, 3.0, 7.0}) {
    EXPECT_TRUE(rule.IsInside(label));
    EXPECT_FALSE(rule.IsInside(std::nextafter(label, kInf)));
    EXPECT_FALSE(rule.IsInside(std::nextafter(label, -kInf)));
  }
  for (const double other : {0.0, 5.0, 8.0, kInf, -kInf, std::nan("")}) {
    EXPECT_FALSE(rule.IsInside(other)) << other;
  }
}

TEST(InsideRuleTest, ActiveSpansOfAnIsovalueAreThoseOfScalarSpan) {
  const InsideRule rule = InsideRule::OfIsovalue(2);
  for (int min = 0; min < 5; ++min) {
    for (int max = 0; max < 5; ++max) {
      const ScalarSpan span{static_cast<double>(min), static_cast<double>(max)};
      EXPECT_EQ(rule.IsActive(span), IsActive(span, 2)) << min << ", " << max;
    }
  }
  EXPECT_FALSE(rule.IsActive(ScalarSpan{}));
}

// A span of integers is active iff it may hold a sample that is a label and one that is not, or two
// that are: the ends are samples, the rest is unknown.
TEST(InsideRuleTest, ActiveSpansOfLabelsHoldALabelAndAnotherValue) {
  const InsideRule rule = InsideRule::OfLabels({2, 5, 6});
  for (int min = 0; min < 9; ++min) {
    for (int max = 0; max < 9; ++max) {
      bool expected = false;
      for (const int label : {2, 5, 6}) {
        expected |= min <= label && label <= max && min < max;
      }
      EXPECT_EQ(rule.IsActive(min, max), expected) << min << ", " << max;
    }
  }
  EXPECT_FALSE(rule.IsActive(ScalarSpan{}));
  EXPECT_TRUE(rule.IsActive(-kInf, kInf));
  EXPECT_FALSE(rule.IsActive(2.5, 4.5));
}

TEST(InsideRuleTest, ASpanMayHaveSomethingInsideIfARuleReachesIntoIt) {
  const InsideRule isovalue = InsideRule::OfIsovalue(2);
  EXPECT_TRUE(isovalue.MayHaveInside({0, 2}));
  EXPECT_TRUE(isovalue.MayHaveInside({2, 2}));
  EXPECT_FALSE(isovalue.MayHaveInside({0, 1.5}));
  EXPECT_FALSE(isovalue.MayHaveInside(ScalarSpan{}));
  const InsideRule labels = InsideRule::OfLabels({2, 5});
  EXPECT_TRUE(labels.MayHaveInside({2, 2}));
  EXPECT_TRUE(labels.MayHaveInside({3, 5}));
  EXPECT_TRUE(labels.MayHaveInside({0, 9}));
  EXPECT_FALSE(labels.MayHaveInside({3, 4}));
  EXPECT_FALSE(labels.MayHaveInside({6, 9}));
  EXPECT_FALSE(labels.MayHaveInside(ScalarSpan{}));
}

TEST(InsideRuleTest, EqualLabelsAreEqualRulesInAnyOrder) {
  EXPECT_EQ(InsideRule::OfLabels({3, 7, 3}), InsideRule::OfLabels({7, 3}));
  EXPECT_EQ(InsideRule::OfLabels({-0.0}), InsideRule::OfLabels({0.0}));
  EXPECT_FALSE(std::signbit(InsideRule::OfLabels({-0.0}).labels[0]));
  EXPECT_NE(InsideRule::OfLabels({3}), InsideRule::OfLabels({3, 7}));
  // Label 3 is not isovalue 3, nor is label 0 the isovalue 0 that rules of labels have.
  EXPECT_NE(InsideRule::OfLabels({3}), InsideRule::OfIsovalue(3));
  EXPECT_NE(InsideRule::OfLabels({0}), InsideRule::OfIsovalue(0));
}

TEST(InsideRuleTest, RulesAreKeysOfAMap) {
  const std::array<InsideRule, 6> rules{InsideRule::OfIsovalue(-1), InsideRule::OfIsovalue(0),
                                        InsideRule::OfIsovalue(3),  InsideRule::OfLabels({0}),
                                        InsideRule::OfLabels({3}),  InsideRule::OfLabels({3, 7})};
  std::map<InsideRule, std::size_t> map;
  for (std::size_t i = 0; i < rules.size(); ++i) {
    map[rules[i]] = i;
  }
  EXPECT_EQ(map.size(), rules.size());
  for (std::size_t i = 0; i < rules.size(); ++i) {
    EXPECT_EQ(map.at(rules[i]), i);
  }
}

TEST(InsideRuleTest, TextNamesTheIsovalueOrTheLabels) {
  EXPECT_EQ(InsideRule::OfIsovalue(3.5).Text(), "isovalue 3.5");
  EXPECT_EQ(InsideRule::OfLabels({7}).Text(), "label 7");
  EXPECT_EQ(InsideRule::OfLabels({7, 3}).Text(), "labels 3, 7");
  std::vector<double> many(20);
  for (std::size_t i = 0; i < many.size(); ++i) {
    many[i] = static_cast<double>(i);
  }
  EXPECT_EQ(InsideRule::OfLabels(many).Text(), "labels 0, 1, 2, 3, 4, 5, 6, 7 and 12 more");
}

TEST(InsideRuleTest, ASmoothRuleIsAnotherOneWithTheSameInside) {
  const InsideRule rough = InsideRule::OfLabels({7, 3});
  const InsideRule smooth = InsideRule::OfLabels({7, 3}, /*smooths=*/true);
  EXPECT_NE(rough, smooth);
  EXPECT_TRUE((rough < smooth) != (smooth < rough));
  EXPECT_NE(absl::Hash<InsideRule>()(rough), absl::Hash<InsideRule>()(smooth));
  for (const double sample : {0.0, 3.0, 5.0, 7.0}) {
    EXPECT_EQ(rough.IsInside(sample), smooth.IsInside(sample));
  }
  EXPECT_EQ(smooth.Text(), "smooth labels 3, 7");
  EXPECT_EQ(InsideRule::OfLabels({3}, /*smooths=*/true).Text(), "smooth label 3");
}

}  // namespace
}  // namespace isoscope::volume
