#include "core/source/adapt/rescale.h"

#include <cstdint>
#include <vector>

#include "gtest/gtest.h"

#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::BytesOf;
using ::isoscope::testing::ValuesOf;

TEST(RescaleTest, WidensInPlace) {
  std::string out = std::string(6, 'x') + BytesOf<std::int16_t>({-3, 0, 700});
  Rescale(volume::ScalarType::kInt16, 3, 0.5, 2, out.data() + 6, out.data());
  EXPECT_EQ(ValuesOf<float>(out), (std::vector<float>{0.5F, 2, 352}));
}

TEST(RescaleTest, WideIntegersStayExact) {
  EXPECT_EQ(RescaledType(volume::ScalarType::kUint8), volume::ScalarType::kFloat32);
  EXPECT_EQ(RescaledType(volume::ScalarType::kFloat32), volume::ScalarType::kFloat32);
  EXPECT_EQ(RescaledType(volume::ScalarType::kInt32), volume::ScalarType::kFloat64);
  EXPECT_EQ(RescaledType(volume::ScalarType::kFloat64), volume::ScalarType::kFloat64);
  std::string out = std::string(4, 'x') + BytesOf<std::int32_t>({2147483647});
  Rescale(volume::ScalarType::kInt32, 1, 1, 1, out.data() + 4, out.data());
  EXPECT_EQ(ValuesOf<double>(out), std::vector<double>{2147483648.0});
}

}  // namespace
}  // namespace isoscope::source
