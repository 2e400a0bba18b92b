#include "wire/histogram_convert.h"

#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::wire {
namespace {

namespace internal = isoscope::internal::v1;
namespace v1 = isoscope::v1;
using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Optional;

constexpr std::int64_t kHuge = std::numeric_limits<std::int64_t>::max();

volume::HistogramPart Example() {
  const volume::HistogramBins bins{.exponent = -2, .first = -8, .count = 5};
  return {.groups = {.bins = bins, .begin = 1, .size = 2, .count = 2},
          .active_block_counts = {3, 4},
          .active_block_bytes = {3000, 4000},
          .estimated_triangle_counts = {540, 720},
          .samples = volume::SampleHistogram{bins, {1, 2, 3, 4, 5}, 6, 7, 8},
          .value_range = {-2, std::numeric_limits<double>::infinity()}};
}

TEST(HistogramQueryTest, DefaultsAndValuesAreTaken) {
  v1::GetHistogramRequest request;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(HistogramQuery query, HistogramQueryFromProto(request));
  EXPECT_EQ(query.max_bin_count, 256);
  EXPECT_FALSE(query.value_range.has_value());
  EXPECT_EQ(query.max_label_value_count, 0U);
  request.set_max_bin_count(4096);
  request.set_max_label_value_count(65536);
  request.mutable_value_range()->set_min(-1);
  request.mutable_value_range()->set_max(-1);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(query, HistogramQueryFromProto(request));
  EXPECT_EQ(query.max_bin_count, 4096);
  EXPECT_EQ(query.max_label_value_count, 65536U);
  EXPECT_EQ(*query.value_range, (volume::ScalarSpan{-1, -1}));
}

TEST(HistogramQueryTest, EveryHostileValueIsNamed) {
  constexpr double kInf = std::numeric_limits<double>::infinity();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const int count :
       {-1, 4097, std::numeric_limits<int>::max(), std::numeric_limits<int>::min()}) {
    v1::GetHistogramRequest request;
    request.set_max_bin_count(count);
    EXPECT_THAT(HistogramQueryFromProto(request),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         HasSubstr("max_bin_count is " + std::to_string(count))));
  }
  for (const int count : {-1, 65537}) {
    v1::GetHistogramRequest request;
    request.set_max_label_value_count(count);
    EXPECT_THAT(HistogramQueryFromProto(request),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         HasSubstr("max_label_value_count is " + std::to_string(count))));
  }
  for (const auto& [min, max] : {std::pair(nan, 1.0), std::pair(0.0, nan), std::pair(-kInf, 1.0),
                                 std::pair(0.0, kInf), std::pair(2.0, 1.0)}) {
    v1::GetHistogramRequest request;
    request.mutable_value_range()->set_min(min);
    request.mutable_value_range()->set_max(max);
    EXPECT_THAT(HistogramQueryFromProto(request),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("value_range")));
    internal::GetShardHistogramRequest shard_request;
    *shard_request.mutable_value_range() = request.value_range();
    EXPECT_FALSE(HistogramQueryFromProto(shard_request).ok());
  }
}

TEST(HistogramPartTest, ComesBackFromTheWire) {
  volume::HistogramPart part = Example();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::HistogramPart back,
                                HistogramPartFromProto(ToProto(part)));
  EXPECT_EQ(back.groups, part.groups);
  EXPECT_EQ(back.active_block_counts, part.active_block_counts);
  EXPECT_EQ(back.active_block_bytes, part.active_block_bytes);
  EXPECT_EQ(back.estimated_triangle_counts, part.estimated_triangle_counts);
  EXPECT_EQ(back.samples, part.samples);
  EXPECT_EQ(back.value_range, part.value_range);
  EXPECT_FALSE(back.label_values.has_value());
  part.label_values = volume::LabelValues::Of({-2, 0, 0x1p53}, true, 0.5);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::HistogramPart labels,
                                HistogramPartFromProto(ToProto(part)));
  EXPECT_THAT(labels.label_values->values(), ElementsAre(-2, 0, 0x1p53));
  EXPECT_TRUE(labels.label_values->has_more());
  EXPECT_THAT(labels.label_values->other_value(), Optional(0.5));
  part.label_values = volume::LabelValues::Of({}, false, std::nullopt);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::HistogramPart none,
                                HistogramPartFromProto(ToProto(part)));
  EXPECT_THAT(none.label_values->values(), IsEmpty());
  EXPECT_FALSE(none.label_values->has_more());
  EXPECT_FALSE(none.label_values->other_value().has_value());
  part.samples.reset();
  part.value_range = {};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::HistogramPart without,
                                HistogramPartFromProto(ToProto(part)));
  EXPECT_FALSE(without.samples.has_value());
  EXPECT_EQ(without.value_range, volume::ScalarSpan());
}

TEST(HistogramPartTest, TheFirstBinLiesWhereNumbersAreWhole) {
  for (const std::int64_t sign : {-1, 1}) {
    internal::GetShardHistogramResponse proto = ToProto(Example());
    proto.set_first_bin(sign * (std::int64_t{1} << 53));
    ISOSCOPE_EXPECT_OK(HistogramPartFromProto(proto).status());
    proto.set_first_bin(proto.first_bin() + sign);
    EXPECT_THAT(HistogramPartFromProto(proto), StatusIs(absl::StatusCode::kInvalidArgument));
  }
}

TEST(HistogramPartTest, WhatNoAgentOfOursSendsIsRefused) {
  using Proto = internal::GetShardHistogramResponse;
  const std::vector<std::function<void(Proto*)>> spoil = {
      [](Proto* p) { p->set_bin_exponent(-1001); },
      [](Proto* p) { p->set_bin_exponent(1015); },
      [](Proto* p) { p->set_first_bin(kHuge); },
      [](Proto* p) { p->set_first_bin(-kHuge); },
      [](Proto* p) { p->set_stored_bin_count(-1); },
      [](Proto* p) { p->set_stored_bin_count(4097); },
      [](Proto* p) { p->set_stored_bin_count(3); },  // fewer than the groups need
      [](Proto* p) { p->set_group_begin(-1); },
      [](Proto* p) { p->set_group_begin(6); },
      [](Proto* p) { p->set_bins_per_group_count(0); },
      [](Proto* p) { p->set_bins_per_group_count(-2); },
      [](Proto* p) { p->set_bins_per_group_count(std::numeric_limits<int>::max()); },
      [](Proto* p) { p->add_active_block_counts(1); },
      [](Proto* p) { p->set_active_block_counts(0, -1); },
      [](Proto* p) { p->add_active_block_bytes(1); },
      [](Proto* p) { p->set_active_block_bytes(0, kHuge); },
      [](Proto* p) { p->clear_estimated_triangle_counts(); },
      [](Proto* p) { p->mutable_samples()->add_counts(1); },
      [](Proto* p) { p->mutable_samples()->set_counts(2, -5); },
      [](Proto* p) { p->mutable_samples()->set_counts(2, kHuge); },
      [](Proto* p) { p->mutable_label_values()->add_values(0.5); },
      [](Proto* p) {
        p->mutable_label_values()->add_values(3);
        p->mutable_label_values()->add_values(3);
      },
      [](Proto* p) { p->mutable_label_values()->mutable_values()->Resize(65537, 1); },
      [](Proto* p) { p->mutable_samples()->set_nan_count(-1); },
      [](Proto* p) { p->mutable_samples()->set_positive_infinity_count(kHuge); },
      [](Proto* p) { p->mutable_samples()->set_negative_infinity_count(std::int64_t{1} << 46); },
      [](Proto* p) { p->mutable_value_range()->set_max(-10); },
      [](Proto* p) { p->mutable_value_range()->set_min(std::nan("")); }};
  for (std::size_t i = 0; i < spoil.size(); ++i) {
    Proto proto = ToProto(Example());
    spoil[i](&proto);
    EXPECT_THAT(HistogramPartFromProto(proto), StatusIs(absl::StatusCode::kInvalidArgument)) << i;
  }
}

TEST(HistogramResponseTest, BinsHaveTheirEdgesAndSums) {
  const v1::GetHistogramResponse response =
      ToProto(Example(), {{.method = volume::SuggestionMethod::kOnePercent,
                           .isovalue = 2.5,
                           .inside_fraction = 0.01}});
  ASSERT_EQ(response.bins_size(), 2);
  EXPECT_EQ(response.bins(0).min(), -1.75);
  EXPECT_EQ(response.bins(0).max(), -1.25);
  EXPECT_EQ(response.bins(1).max(), -0.75);
  EXPECT_EQ(response.bins(0).sample_count(), 2 + 3);
  EXPECT_EQ(response.bins(1).sample_count(), 4 + 5);
  EXPECT_EQ(response.bins(1).active_block_count(), 4);
  EXPECT_EQ(response.bins(1).active_block_bytes(), 4000);
  EXPECT_EQ(response.bins(1).estimated_triangle_count(), 720);
  EXPECT_TRUE(response.has_sample_counts());
  EXPECT_EQ(response.nan_count(), 6);
  EXPECT_EQ(response.negative_infinity_count(), 7);
  EXPECT_EQ(response.positive_infinity_count(), 8);
  EXPECT_FALSE(response.has_label_values());
  volume::HistogramPart labels = Example();
  labels.label_values = volume::LabelValues::Of({3, 4}, false, std::nullopt);
  EXPECT_THAT(ToProto(labels, {}).label_values().values(), ElementsAre(3, 4));
  EXPECT_TRUE(response.suggested_labels().empty());
  EXPECT_THAT(ToProto(Example(), {}, {2, 7}).suggested_labels(), ElementsAre(2, 7));
  ASSERT_EQ(response.suggestions_size(), 1);
  EXPECT_EQ(response.suggestions(0).method(), v1::IsovalueSuggestion::METHOD_ONE_PERCENT);
  EXPECT_EQ(response.suggestions(0).isovalue(), 2.5);
}

TEST(ActiveBoxTest, ComesBackAndOnesOutsideTheVolumeAreRefused) {
  const volume::BlockLayout layout = volume::BlockLayout::Make({9, 9, 9}, {4, 4, 4}).value();
  const math::IndexBox cells{{0, 4, 0}, {4, 8, 8}};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto box, ActiveBoxFromProto(ToProto(3, cells), layout));
  EXPECT_EQ(*box, cells);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto none, ActiveBoxFromProto(ToProto(0, {}), layout));
  EXPECT_FALSE(none.has_value());
  for (const math::IndexBox& hostile :
       {math::IndexBox{{-1, 0, 0}, {4, 4, 4}}, math::IndexBox{{0, 0, 0}, {4, 4, 9}},
        math::IndexBox{{4, 0, 0}, {4, 4, 4}}, math::IndexBox{{0, 0, 0}, {4, kHuge, 4}}}) {
    EXPECT_THAT(ActiveBoxFromProto(ToProto(3, hostile), layout),
                StatusIs(absl::StatusCode::kInvalidArgument));
  }
}

TEST(CellBoxTest, ComesBackAndOnesOutsideTheVolumeAreRefused) {
  const volume::BlockLayout layout = volume::BlockLayout::Make({9, 9, 9}, {4, 4, 4}).value();
  const math::IndexBox cells{{0, 3, 7}, {1, 8, 8}};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto box, CellBoxFromProto(ToProto(cells), layout));
  EXPECT_EQ(*box, cells);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto none,
                                CellBoxFromProto(ToProto(math::IndexBox()), layout));
  EXPECT_FALSE(none.has_value());
  isoscope::internal::v1::GetCellBoxResponse half = ToProto(cells);
  half.clear_end_cell();
  EXPECT_THAT(CellBoxFromProto(half, layout), StatusIs(absl::StatusCode::kInvalidArgument));
  isoscope::internal::v1::GetCellBoxResponse hostile = ToProto(cells);
  for (const std::int64_t end : {std::int64_t{-1}, std::int64_t{0}, std::int64_t{9}, kHuge}) {
    hostile.mutable_end_cell()->set_x(end);
    EXPECT_THAT(CellBoxFromProto(hostile, layout), StatusIs(absl::StatusCode::kInvalidArgument));
  }
}

}  // namespace
}  // namespace isoscope::wire
