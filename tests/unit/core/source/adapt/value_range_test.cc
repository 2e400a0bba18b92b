#include "core/source/adapt/value_range.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/memory_source.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

volume::GridGeometry GeometryOf(const math::Index3& dims) {
  volume::GridGeometry geometry;
  geometry.sample_dims = dims;
  return geometry;
}

template <typename T>
std::unique_ptr<VolumeSource> SourceOf(const math::Index3& dims, volume::ScalarType type,
                                       const std::vector<T>& samples) {
  std::string bytes(samples.size() * sizeof(T), '\0');
  std::memcpy(bytes.data(), samples.data(), bytes.size());
  return testing::MakeMemorySource(GeometryOf(dims), type, std::move(bytes), "memory");
}

TEST(FindValueRangeTest, IsTheLeastAndTheGreatestSampleOfEveryType) {
  const math::Index3 dims{13, 5, 7};
  for (const volume::ScalarType type :
       {volume::ScalarType::kUint8, volume::ScalarType::kInt8, volume::ScalarType::kUint16,
        volume::ScalarType::kInt16, volume::ScalarType::kUint32, volume::ScalarType::kInt32,
        volume::ScalarType::kFloat32, volume::ScalarType::kFloat64}) {
    SCOPED_TRACE(volume::NameOf(type));
    const std::string bytes = testing::Noise(dims, type);
    const auto source = testing::MakeMemorySource(GeometryOf(dims), type, bytes, "memory");
    volume::ScalarSpan expected;
    volume::VisitScalarType(type, [&]<typename T>() {
      for (std::size_t i = 0; i < bytes.size(); i += sizeof(T)) {
        T sample;
        std::memcpy(&sample, bytes.data() + i, sizeof(T));
        expected.min = std::min(expected.min, static_cast<double>(sample));
        expected.max = std::max(expected.max, static_cast<double>(sample));
      }
    });
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ValueRange range,
                                  FindValueRange(source.get(), nullptr, base::Cancellation()));
    EXPECT_EQ(range.span, expected);
    EXPECT_EQ(range.infinite_count, 0);
  }
}

TEST(FindValueRangeTest, LeavesOutNanAndInfinitiesAndCountsTheLatter) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInf = std::numeric_limits<float>::infinity();
  const auto range_of = [](const std::vector<float>& samples) {
    return *FindValueRange(SourceOf<float>({2, 2, 2}, volume::ScalarType::kFloat32, samples).get(),
                           nullptr, base::Cancellation());
  };
  EXPECT_EQ(range_of({kNan, 3, kNan, -2, kNan, kNan, kNan, kNan}), (ValueRange{{-2, 3}, 0}));
  EXPECT_EQ(range_of({kNan, 3, -kInf, 2, kInf, 1, 1, 1}), (ValueRange{{1, 3}, 2}));
  EXPECT_EQ(range_of(std::vector<float>(8, kNan)), ValueRange());
  EXPECT_EQ(range_of(std::vector<float>(8, -kInf)), (ValueRange{{}, 8}));
}

TEST(FindValueRangeTest, FewIntegersAreCountedAndOthersAreNot) {
  const auto few_of = [](const std::unique_ptr<VolumeSource>& source) {
    std::optional<volume::SampleHistogram> few;
    EXPECT_TRUE(FindValueRange(source.get(), nullptr, base::Cancellation(), &few).ok());
    return few;
  };
  const auto few = few_of(
      SourceOf<std::int16_t>({2, 2, 2}, volume::ScalarType::kInt16, {-3, -3, 5, 0, 0, 0, 5, -3}));
  ASSERT_TRUE(few.has_value());
  EXPECT_EQ(few->bins, (volume::HistogramBins{.exponent = 0, .first = -3, .count = 9}));
  EXPECT_EQ(few->counts, (std::vector<std::int64_t>{3, 0, 0, 3, 0, 0, 0, 0, 2}));
  EXPECT_FALSE(
      few_of(SourceOf<float>({2, 2, 2}, volume::ScalarType::kFloat32, {0, 1, 0, 1, 0, 1, 0, 1})));
  EXPECT_FALSE(few_of(
      SourceOf<std::int32_t>({2, 2, 2}, volume::ScalarType::kInt32, {0, 9000, 0, 1, 0, 1, 0, 1})))
      << "the bins are not exact";
  std::vector<std::uint8_t> many(256);
  for (std::size_t i = 0; i < many.size(); ++i) {
    many[i] = static_cast<std::uint8_t>(i);
  }
  EXPECT_FALSE(few_of(SourceOf<std::uint8_t>({8, 8, 4}, volume::ScalarType::kUint8, many)));
}

TEST(MiddleIsovalueTest, HasASurfaceAndAsFewDigitsAsThatTakes) {
  EXPECT_EQ(MiddleIsovalue({0, 255}), "127.5");
  EXPECT_EQ(MiddleIsovalue({-2, 3}), "0.5");
  EXPECT_EQ(MiddleIsovalue({1'000'000, 1'000'000.5}), "1000000.25");
  EXPECT_EQ(MiddleIsovalue({-1e308, 1.7e308}), "3.5e+307");
  EXPECT_EQ(MiddleIsovalue({7, 7}), "") << "all samples are equal";
  EXPECT_EQ(MiddleIsovalue({}), "");
  constexpr double kTiny = std::numeric_limits<double>::denorm_min();
  for (const auto& span :
       {volume::ScalarSpan{0, kTiny}, volume::ScalarSpan{1, std::nextafter(1.0, 2.0)},
        volume::ScalarSpan{-1.7e308, 1.7e308}, volume::ScalarSpan{-1e-310, 1e-310},
        volume::ScalarSpan{16'777'216, 16'777'217}}) {
    EXPECT_TRUE(volume::IsActive(span, std::strtod(MiddleIsovalue(span).c_str(), nullptr)))
        << MiddleIsovalue(span);
  }
}

TEST(FindValueRangeTest, ExtremesInTheFirstAndTheLastOfManyPortionsCount) {
  // 24 MB: three portions, the last one shorter, and rows that are no whole number of vectors.
  const math::Index3 dims{1001, 100, 120};
  std::vector<std::uint16_t> samples(static_cast<std::size_t>(math::Volume(dims)), 500);
  samples.front() = 7;
  samples.back() = 60000;
  const auto source = SourceOf(dims, volume::ScalarType::kUint16, samples);
  std::vector<std::pair<std::int64_t, std::int64_t>> told;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const ValueRange range,
      FindValueRange(
          source.get(),
          [&](std::int64_t done, std::int64_t total) { told.emplace_back(done, total); },
          base::Cancellation()));
  EXPECT_EQ(range.span, (volume::ScalarSpan{7, 60000}));
  ASSERT_GE(told.size(), 3U);
  EXPECT_TRUE(std::is_sorted(told.begin(), told.end()));
  EXPECT_EQ(told.back(), std::make_pair(2 * math::Volume(dims), 2 * math::Volume(dims)));
}

TEST(FindValueRangeTest, StopsWhenItIsCancelledAndReportsWhatCantBeRead) {
  base::Cancellation cancelled;
  cancelled.Cancel();
  const auto source =
      SourceOf<std::uint8_t>({2, 2, 2}, volume::ScalarType::kUint8, std::vector<std::uint8_t>(8));
  EXPECT_THAT(FindValueRange(source.get(), nullptr, cancelled).status(),
              StatusIs(absl::StatusCode::kCancelled));

  class Broken final : public VolumeSource {
   public:
    Broken()
        : VolumeSource({.name = "broken",
                        .geometry = GeometryOf({2, 2, 2}),
                        .type = volume::ScalarType::kUint8}) {}
    absl::Status ReadRows(std::int64_t /*begin*/, std::int64_t /*end*/, char* /*out*/) override {
      return absl::DataLossError("broken: row 1");
    }
  };
  Broken broken;
  EXPECT_THAT(FindValueRange(&broken, nullptr, base::Cancellation()).status(),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("row 1")));
}

}  // namespace
}  // namespace isoscope::source
