#include "core/volume/cell_samples.h"

#include <cmath>
#include <limits>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"

namespace isoscope::volume {
namespace {

using ::testing::ElementsAre;

constexpr math::IndexBox kStored{{2, 3, 4}, {5, 7, 6}};  // 3 x 4 x 2 samples

// 100 z + 10 y + x of the volume.
template <typename T>
std::string Stored() {
  std::string bytes;
  for (std::int64_t z = kStored.begin.z; z < kStored.end.z; ++z) {
    for (std::int64_t y = kStored.begin.y; y < kStored.end.y; ++y) {
      for (std::int64_t x = kStored.begin.x; x < kStored.end.x; ++x) {
        base::AppendLittleEndian(static_cast<T>(100 * z + 10 * y + x), &bytes);
      }
    }
  }
  return bytes;
}

TEST(CellSamplesTest, CornersAreThoseOfTheCellWhateverTheType) {
  const auto expected = ElementsAre(453, 454, 463, 464, 553, 554, 563, 564);
  const std::string shorts = Stored<std::int16_t>();
  EXPECT_THAT(SamplesOfCell({0, ScalarType::kInt16, shorts.data()}, kStored, {3, 5, 4}), expected);
  const std::string doubles = Stored<double>();
  EXPECT_THAT(SamplesOfCell({0, ScalarType::kFloat64, doubles.data()}, kStored, {3, 5, 4}),
              expected);
}

TEST(CellSamplesTest, TheValueIsTrilinearAndThatOfTheNearestPointOutside) {
  const std::string bytes = Stored<float>();
  const auto corners = SamplesOfCell({0, ScalarType::kFloat32, bytes.data()}, kStored, {3, 5, 4});
  const struct {
    math::Vec3d position;
    double value;
  } cases[] = {{{3, 5, 4}, 453},
               {{4, 6, 5}, 564},
               {{3.25, 5.5, 4.75}, 453 + 0.25 + 5 + 75},
               {{2.5, 5, 4}, 453},
               {{9, 9, 9}, 564}};
  for (const auto& c : cases) {
    EXPECT_DOUBLE_EQ(ValueInCell(corners, {3, 5, 4}, c.position), c.value);
  }
}

TEST(CellSamplesTest, CornersOfWeightZeroDoNotCount) {
  std::array<double, 8> corners{};
  corners[7] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(ValueInCell(corners, {0, 0, 0}, {1, 1, 0}), 0);
  EXPECT_TRUE(std::isnan(ValueInCell(corners, {0, 0, 0}, {0.5, 0.5, 0.5})));
}

}  // namespace
}  // namespace isoscope::volume
