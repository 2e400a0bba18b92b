#include "core/source/adapt/adjusted_source.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/adapt/placed_source.h"
#include "core/source/bytes/raw_file.h"
#include "core/source/grid/affine_grid.h"
#include "core/source/volume_source.h"
#include "tests/support/only_volume.h"
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
constexpr math::Index3 kDims{10, 7, 6};

// The value of a sample tells where it is.
template <typename T>
T ValueAt(std::int64_t x, std::int64_t y, std::int64_t z) {
  return static_cast<T>(x + 10 * y + 70 * z);
}

class AdjustedSourceTest : public ::testing::Test {
 protected:
  template <typename T>
  std::unique_ptr<VolumeSource> Open(volume::ScalarType type) {
    std::vector<T> values;
    for (std::int64_t z = 0; z < kDims.z; ++z) {
      for (std::int64_t y = 0; y < kDims.y; ++y) {
        for (std::int64_t x = 0; x < kDims.x; ++x) {
          values.push_back(ValueAt<T>(x, y, z));
        }
      }
    }
    testing::WriteFile(dir_.Sub("a.raw"), BytesOf(values));
    return MoveSource(
        OpenRawFile(dir_.Sub("a.raw"), {.dims = kDims, .type = type}).value(),
        {.sample_dims = kDims, .spacing = {0.5, 1, 2}, .origin = {10, 20, 30}, .direction = {}});
  }
  testing::TempDir dir_;
};

TEST_F(AdjustedSourceTest, BoxesAndStridesKeepPositionsAndValues) {
  for (const SampleBox& box : {SampleBox{{0, 0, 0}, kDims}, SampleBox{{2, 1, 3}, {9, 7, 6}},
                               SampleBox{{4, 0, 0}, {10, 3, 6}}}) {
    for (const std::int64_t stride : {1, 2}) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto part,
                                    AdjustSource(Open<std::int16_t>(volume::ScalarType::kInt16),
                                                 {.crop = box, .stride = stride}));
      const math::Index3 dims = part->info().geometry.sample_dims;
      EXPECT_EQ(part->info().type, volume::ScalarType::kInt16);
      for (const std::int64_t planes : {1, 2, 6}) {
        const auto values = ValuesOf<std::int16_t>(ReadAll(*part, planes).value());
        std::size_t at = 0;
        for (std::int64_t z = box.begin.z; z < box.end.z; z += stride) {
          for (std::int64_t y = box.begin.y; y < box.end.y; y += stride) {
            for (std::int64_t x = box.begin.x; x < box.end.x; x += stride) {
              ASSERT_LT(at, values.size());
              ASSERT_EQ(values[at++], ValueAt<std::int16_t>(x, y, z));
            }
          }
        }
        EXPECT_EQ(at, values.size());
      }
      const math::Mat4d to_world = part->info().geometry.world_from_index();
      const math::Vec3d last = math::TransformPoint(
          to_world, {static_cast<double>(dims.x - 1), static_cast<double>(dims.y - 1),
                     static_cast<double>(dims.z - 1)});
      const auto index = [&](int axis) {
        return static_cast<double>(box.begin[axis] + (dims[axis] - 1) * stride);
      };
      EXPECT_EQ(last, (math::Vec3d{10 + 0.5 * index(0), 20 + index(1), 30 + 2 * index(2)}));
    }
  }
}

TEST_F(AdjustedSourceTest, FillValuesBecomeNaN) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto part, AdjustSource(Open<std::int16_t>(volume::ScalarType::kInt16), {.fill = 73}));
  ASSERT_EQ(part->info().type, volume::ScalarType::kFloat32);
  const auto values = ValuesOf<float>(ReadAll(*part, 1).value());
  for (std::size_t i = 0; i < values.size(); ++i) {
    ASSERT_TRUE(i == 73 ? std::isnan(values[i]) : values[i] == static_cast<float>(i)) << i;
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto wide, AdjustSource(Open<std::int32_t>(volume::ScalarType::kInt32), {.fill = 0.5}));
  EXPECT_EQ(wide->info().type, volume::ScalarType::kFloat64);
  EXPECT_EQ(ValuesOf<double>(ReadAll(*wide, 1).value())[0], 0);  // 0 is not 0.5
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto real, AdjustSource(Open<float>(volume::ScalarType::kFloat32), {.fill = 5}));
  EXPECT_TRUE(std::isnan(ValuesOf<float>(ReadAll(*real, 1).value())[5]));
}

TEST_F(AdjustedSourceTest, ShearIsIgnoredBeforeTheBoxIsCut) {
  testing::WriteFile(dir_.Sub("tilted.nhdr"),
                     "NRRD0004\ntype: short\ndimension: 3\nspace dimension: 3\nsizes: 10 7 6\n"
                     "space directions: (2,0,0) (1.2,1.6,0) (0,0,3)\nspace origin: (1,2,3)\n"
                     "endian: little\nencoding: raw\ndata file: a.raw\n");
  Open<std::int16_t>(volume::ScalarType::kInt16);  // writes a.raw
  const auto open = [&] { return OpenVolumeFile(dir_.Sub("tilted.nhdr")).value(); };
  ASSERT_TRUE(
      FindShear(open()->info().geometry.direction).has_value());  // a tilted grid is drawn as it is
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto straight,
      AdjustSource(open(), {.crop = SampleBox{{1, 2, 3}, {5, 7, 6}}, .ignores_shear = true}));
  const volume::GridGeometry& grid = straight->info().geometry;
  EXPECT_FALSE(FindShear(grid.direction).has_value());
  EXPECT_LT(math::Length(grid.spacing - math::Vec3d{2, 2, 3}), 1e-14);
  // The axes meet at 53.13 degrees, so each turns by 18.43: cos is 3 and sin 1 of the root of 10.
  const double root = std::sqrt(10.0);
  EXPECT_LT(math::Length(grid.origin - math::Vec3d{1 + 1 * 6 / root + 2 * 2 / root,
                                                   2 - 1 * 2 / root + 2 * 6 / root, 3 + 9}),
            1e-12);
  EXPECT_THAT(straight->info().note, HasSubstr("axes x and y, which meet at 53.13 degrees"));
  EXPECT_EQ(ValuesOf<std::int16_t>(ReadAll(*straight, 1).value())[0],
            ValueAt<std::int16_t>(1, 2, 3));
  // Straight grids stay as they are, bit for bit.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto same,
      AdjustSource(Open<std::int16_t>(volume::ScalarType::kInt16), {.ignores_shear = true}));
  EXPECT_EQ(same->info().geometry, Open<std::int16_t>(volume::ScalarType::kInt16)->info().geometry);
  EXPECT_EQ(same->info().note, "");
}

TEST_F(AdjustedSourceTest, WhatDoesNotFitIsRefused) {
  const auto error = [&](const Adjustment& adjustment) {
    return AdjustSource(Open<std::int16_t>(volume::ScalarType::kInt16), adjustment).status();
  };
  EXPECT_THAT(error({.crop = SampleBox{{0, 0, 0}, {10, 8, 6}}}),
              StatusIs(kInvalid, HasSubstr("--crop 0:8 on axis y, which has 7 samples, 0 to 6")));
  EXPECT_THAT(error({.stride = 6}), StatusIs(kInvalid, HasSubstr("after --crop and --stride")));
}

TEST(SampleBoxTest, Parse) {
  constexpr std::int64_t kLast = std::numeric_limits<std::int64_t>::max();
  EXPECT_EQ(ParseSampleBox("1:2,3:40,5:6").value(), (SampleBox{{1, 3, 5}, {2, 40, 6}}));
  EXPECT_EQ(ParseSampleBox(":,3:,:6").value(), (SampleBox{{0, 3, 0}, {kLast, kLast, 6}}));
  for (const char* text : {"", "1:2", "1:2,3:4", "2:1,0:1,0:1", "a:b,0:1,0:1", "-1:2,0:1,0:1",
                           "1:2,3:4,5:6,7:8", "1,2,3", "1:2:3,0:1,0:1", "3:3,0:1,0:1"}) {
    EXPECT_THAT(ParseSampleBox(text), StatusIs(kInvalid, HasSubstr("X0:X1,Y0:Y1,Z0:Z1"))) << text;
  }
}

}  // namespace
}  // namespace isoscope::source
