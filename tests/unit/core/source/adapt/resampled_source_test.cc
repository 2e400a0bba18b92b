#include "core/source/adapt/resampled_source.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/adapt/adjusted_source.h"
#include "core/source/adapt/placed_source.h"
#include "core/source/bytes/raw_file.h"
#include "core/source/volume_source.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::BytesOf;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::ValuesOf;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr math::Index3 kDims{4, 3, 4};
const std::vector<double> kX{0, 1, 4, 5};
const std::vector<double> kY{0, 3, 4};
const std::vector<double> kZ{0, 2, 3, 6};

class ResampledSourceTest : public ::testing::Test {
 protected:
  template <typename T>
  std::unique_ptr<VolumeSource> Open(const std::vector<T>& values, volume::ScalarType type) {
    testing::WriteFile(dir_.Sub("a.raw"), BytesOf(values));
    return MoveSource(
        OpenRawFile(dir_.Sub("a.raw"), {.dims = kDims, .type = type}).value(),
        {.sample_dims = kDims, .spacing = {0.5, 1, 2}, .origin = {10, 20, 30}, .direction = {}});
  }
  // Linear in the places of the samples, so that linear interpolation is exact.
  template <typename T>
  std::vector<T> Linear() {
    std::vector<T> values;
    for (const double z : kZ) {
      for (const double y : kY) {
        for (const double x : kX) {
          values.push_back(static_cast<T>(x + 10 * y + 100 * z));
        }
      }
    }
    return values;
  }
  testing::TempDir dir_;
};

TEST_F(ResampledSourceTest, LinearFieldsStayWhatTheyAreInAnyOrderOfRows) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto even,
      ResampleSource(Open(Linear<std::int16_t>(), volume::ScalarType::kInt16), {kX, kY, kZ}, {}));
  ASSERT_EQ(even->info().geometry.sample_dims, (math::Index3{6, 5, 7}));
  EXPECT_EQ(even->info().geometry.spacing, (math::Vec3d{1, 1, 1}));
  EXPECT_EQ(even->info().geometry.origin, (math::Vec3d{10, 20, 30}));
  EXPECT_EQ(even->info().type, volume::ScalarType::kFloat32);
  EXPECT_TRUE(even->info().is_resampled);
  EXPECT_THAT(even->info().note,
              HasSubstr("axis x was resampled: 4 samples, 1 to 3 apart, became 6, 1 "
                        "apart; axis y was"));
  for (const std::int64_t planes : {1, 3, 7}) {
    const auto values = ValuesOf<float>(ReadAll(*even, planes).value());
    ASSERT_EQ(values.size(), 6U * 5 * 7);
    for (std::size_t i = 0; i < values.size(); ++i) {
      const std::size_t x = i % 6;
      const std::size_t y = i / 6 % 5;
      const std::size_t z = i / 30;
      ASSERT_NEAR(values[i], static_cast<double>(x + 10 * y + 100 * z), 1e-4) << i;
    }
  }
  // Backwards, a row at a time.
  std::string row(6 * sizeof(float), '\0');
  for (std::int64_t r = 34; r >= 0; --r) {
    ASSERT_TRUE(even->ReadRows(r, r + 1, row.data()).ok());
    ASSERT_NEAR(ValuesOf<float>(row)[5], 5 + static_cast<double>(10 * (r % 5) + 100 * (r / 5)),
                1e-4);
  }
}

TEST_F(ResampledSourceTest, OneAxisLeavesTheOthersAlone) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto even,
      ResampleSource(Open(Linear<std::int32_t>(), volume::ScalarType::kInt32), {{{}, {}, kZ}}, {}));
  EXPECT_EQ(even->info().geometry.sample_dims, (math::Index3{4, 3, 7}));
  EXPECT_EQ(even->info().geometry.spacing, (math::Vec3d{0.5, 1, 1}));
  EXPECT_EQ(even->info().type, volume::ScalarType::kFloat64);
  const auto values = ValuesOf<double>(ReadAll(*even, 2).value());
  EXPECT_EQ(values[3 * 12 + 11], 5 + 40 + 300);  // a slice of the source, with its own places in x
  EXPECT_EQ(values[1 * 12 + 11], 5 + 40 + 100);
  EXPECT_EQ(
      even->info().memory_bytes,
      2 * 12 * 4 + Open(Linear<std::int32_t>(), volume::ScalarType::kInt32)->info().memory_bytes);
}

TEST_F(ResampledSourceTest, SamplesOfTheSourceAreTakenAsTheyAre) {
  constexpr float kInf = std::numeric_limits<float>::infinity();
  std::vector<float> values(48, 0.1F);
  values[0] = 1e30F;                                     // at (0, 0, 0)
  values[12] = std::numeric_limits<float>::quiet_NaN();  // the slice at 2
  values[24] = kInf;                                     // the slice at 3
  values[36] = kInf;                                     // the slice at 6
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto even,
      ResampleSource(Open(values, volume::ScalarType::kFloat32), {{{}, {}, kZ}}, {}));
  const auto read = ValuesOf<float>(ReadAll(*even, 1).value());
  EXPECT_EQ(read[0], 1e30F);
  EXPECT_TRUE(std::isnan(read[12]));      // between 0 and the NaN at 2
  EXPECT_TRUE(std::isnan(read[2 * 12]));  // the NaN
  for (const std::size_t z : {3U, 4U, 5U, 6U}) {
    EXPECT_EQ(read[z * 12], kInf);  // the NaN has no share
  }
  EXPECT_EQ(read[1], 0.1F);
  EXPECT_EQ(read[13], 0.1F);  // between equal samples
}

TEST_F(ResampledSourceTest, FillBecomesNaNBeforeItIsMixedAndOnlyThen) {
  std::vector<std::int16_t> values(48, -1);
  values[12] = 0;  // the fill value
  values[36] = 1;  // between -1 at 3 and 1 at 6 lies no 0, but 4.5 would
  values[47] = 3;  // between -1 and 3: -1, 1/3, 5/3, 3
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      auto even, ResampleSource(Open(values, volume::ScalarType::kInt16), {{{}, {}, kZ}}, 0.0));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(even, AdjustSource(std::move(even), {.fill = 1}));
  const auto read = ValuesOf<float>(ReadAll(*even, 1).value());
  EXPECT_TRUE(std::isnan(read[12]));
  EXPECT_TRUE(std::isnan(read[24]));
  EXPECT_EQ(read[36], -1);
  EXPECT_EQ(read[6 * 12], 1);  // AdjustSource does not fill again
}

TEST(EvenSamplesTest, StepIsTheSmallestDistanceUpToFourForOne) {
  const auto samples = [](const std::vector<double>& distances) {
    const EvenSamples even = EvenSamplesFor(distances);
    EXPECT_DOUBLE_EQ(even.step * static_cast<double>(even.count - 1), distances.back());
    return even.count;
  };
  EXPECT_EQ(samples({0, 2, 4, 6}), 4);
  EXPECT_EQ(samples({0, 2, 3, 6}), 7);
  EXPECT_EQ(samples({0, 2, 3.0001, 6}), 7);  // of 0.9999, by their number
  EXPECT_EQ(samples({0, 2.5, 4.5, 7}), 5);   // 7 / 2 is no whole number: 1.75
  EXPECT_EQ(samples({0, 0.001, 1000}), 9);   // 4 for each of 2 gaps
  EXPECT_EQ(samples({0, 1e-300, 1e300}), 9);
}

TEST_F(ResampledSourceTest, PlacesThatDoNotAscendAreRefused) {
  const auto error = [&](const std::vector<double>& y) {
    return ResampleSource(Open(Linear<std::int16_t>(), volume::ScalarType::kInt16), {{{}, y, {}}},
                          {})
        .status();
  };
  EXPECT_THAT(error({0, 3, 3}), StatusIs(kInvalid, HasSubstr("sample 2 of axis y lies at 3")));
  EXPECT_THAT(error({1, 2, 3}), StatusIs(kInvalid, HasSubstr("the first 0")));
  EXPECT_THAT(error({0, 3}), StatusIs(kInvalid, HasSubstr("2 places of samples on axis y")));
  EXPECT_THAT(error({0, 3, std::numeric_limits<double>::infinity()}),
              StatusIs(kInvalid, HasSubstr("ascend")));
  EXPECT_THAT(error({0, 1e-40, 2e-40}), StatusIs(kInvalid, HasSubstr("after --resample")));
}

TEST_F(ResampledSourceTest, EvenSourcesStayAsTheyAre) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto same,
      ResampleSource(Open(Linear<std::int16_t>(), volume::ScalarType::kInt16), {}, 7.0));
  EXPECT_EQ(same->info().type, volume::ScalarType::kInt16);
  EXPECT_FALSE(same->info().is_resampled);
  EXPECT_EQ(same->info().note, "");
}

}  // namespace
}  // namespace isoscope::source
