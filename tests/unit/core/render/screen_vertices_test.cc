// Vertices of a block against one vertex at a time, and against the definition in doubles.

#include "core/render/screen_vertices.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/random.h"
#include "hwy/targets.h"

namespace isoscope::render {
namespace {

using Bits = std::array<std::int64_t, 3>;
// -1 stands for no vertex.
Bits BitsOf(const std::optional<ScreenVertex>& v) {
  return v ? Bits{v->x, v->y, std::bit_cast<std::uint32_t>(v->z)} : Bits{0, 0, -1};
}

// Clip coordinates are index coordinates, with w = 1 or, for perspective, w = 4 - z.
Projection MakeProjection(bool is_perspective, std::int32_t origin_x, double guard_band_px) {
  return {.clip_from_index = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, is_perspective ? -1.0 : 0.0,  //
                              0, 0, 0, is_perspective ? 4.0 : 1.0},
          .width_px = 333,
          .height_px = 77,
          .origin_x = origin_x,
          .origin_y = -3,
          .guard_band_px = guard_band_px};
}

TEST(ScreenVerticesTest, EveryInstructionSetAndOneVertexGiveTheSameBits) {
  for (const bool is_perspective : {false, true}) {
    for (const std::int32_t origin_x : {0, 100}) {
      const Projection projection = MakeProjection(is_perspective, origin_x, kGuardBandPx);
      for (std::uint64_t count = 1; count <= 18; ++count) {
        std::vector<math::Vec3f> positions;
        for (std::uint64_t i = 0; i < 3 * count; i += 3) {
          const auto random = [&](std::uint64_t k) {
            return static_cast<float>(2 * base::RandomUnit(count, i + k) - 1);
          };
          positions.push_back({random(0), random(1), random(2)});
        }
        for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
          SCOPED_TRACE(std::string(hwy::TargetName(target)) + ", " + std::to_string(count));
          hwy::SetSupportedTargetsForTest(target);
          ScreenVertices vertices;
          const ScreenBounds bounds = TransformVertices(projection, positions, &vertices);
          hwy::SetSupportedTargetsForTest(0);
          ASSERT_TRUE(bounds.is_valid);
          ASSERT_EQ(vertices.count, count);
          for (std::size_t i = 0; i < count; ++i) {
            ASSERT_EQ(BitsOf(vertices[i]),
                      BitsOf(ToScreen(projection, ToClip(projection, positions[i]))));
          }
          const auto [min_x, max_x] = std::minmax_element(
              vertices.x.begin(), vertices.x.begin() + static_cast<std::ptrdiff_t>(count));
          const auto [min_y, max_y] = std::minmax_element(
              vertices.y.begin(), vertices.y.begin() + static_cast<std::ptrdiff_t>(count));
          EXPECT_EQ(bounds.min_x, *min_x);
          EXPECT_EQ(bounds.min_y, *min_y);
          EXPECT_EQ(bounds.max_x, *max_x);
          EXPECT_EQ(bounds.max_y, *max_y);
        }
      }
    }
  }
}

TEST(ScreenVerticesTest, CoordinatesAreRoundedToEvenAndVerticesToClipAreToldApart) {
  struct Case {
    math::Vec3f position;
    std::optional<ScreenVertex> expected;  // none: must be clipped
    bool is_perspective = false;
  };
  const float nan = std::nanf("");
  // x: (position + 1) * 512 + 0 subpixels; y: (1 - position) * 512; z: (position + 1) / 2.
  const std::vector<Case> cases{
      {{0, 0, 0}, ScreenVertex{512, 512, 0.5F}},
      {{-1, 1, -1}, ScreenVertex{0, 0, 0}},
      {{0x1p-10F, 0x3p-10F, 1}, ScreenVertex{512, 510, 1}},  // 512.5 and 510.5
      {{0x3p-10F, 0x1p-10F, 1}, ScreenVertex{514, 512, 1}},  // 513.5 and 511.5
      {{0, 0, 100}, ScreenVertex{512, 512, kMaxVertexDepth}},
      {{0, 0, -1.001F}, std::nullopt},                 // in front of the near plane
      {{0, 0, 4}, std::nullopt, true},                 // w is 0
      {{0, 0, 5}, std::nullopt, true},                 // behind the eye
      {{15, -15, 0}, ScreenVertex{8192, 8192, 0.5F}},  // on the guard band
      {{15.01F, 0, 0}, std::nullopt},
      {{-17.01F, 0, 0}, std::nullopt},
      {{0, -15.01F, 0}, std::nullopt},
      {{0, 17.01F, 0}, std::nullopt},
      {{nan, 0, 0}, std::nullopt},
  };
  for (std::size_t i = 0; i < cases.size(); ++i) {
    SCOPED_TRACE(i);
    Projection projection = MakeProjection(cases[i].is_perspective, 0, 32);
    projection.width_px = projection.height_px = 4;
    projection.origin_y = 0;
    ScreenVertices vertices;
    const std::array positions{cases[0].position, cases[i].position};
    const ScreenBounds bounds = TransformVertices(projection, positions, &vertices);
    EXPECT_EQ(bounds.is_valid, cases[i].expected.has_value());
    EXPECT_EQ(BitsOf(ToScreen(projection, ToClip(projection, cases[i].position))),
              BitsOf(cases[i].expected));
  }
}

}  // namespace
}  // namespace isoscope::render
