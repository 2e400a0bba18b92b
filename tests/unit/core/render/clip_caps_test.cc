// The caps of a volume whose samples are x + 100 z, so that the surface on a cut is known:
//
// - each pixel of a cut gets one fragment, of the surface with the highest isovalue;
// - the margin around the rim, also across blocks;
// - colours, normals and samples;
// - blocks and pixels that need nothing.

#include "core/render/clip_caps.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/random.h"
#include "core/image/normal_and_step.h"
#include "core/image/normal_code.h"
#include "core/render/pass_resources.h"
#include "core/render/shade_kernel.h"
#include "tests/support/block_cutter.h"
#include "tests/support/status_matchers.h"

namespace isoscope::render {
namespace {

constexpr math::Index3 kDims{33, 33, 33};

volume::GridGeometry Geometry() {
  volume::GridGeometry geometry;
  geometry.sample_dims = kDims;
  return geometry;
}

// Samples x + 100 z, as uint16: the slice at z does not depend on the blocks.
struct Volume {
  volume::BlockLayout layout = volume::BlockLayout::Make(kDims, {8, 8, 8}).value();
  std::string samples;
  volume::RangeTable ranges{volume::ScalarType::kUint16, layout.block_count()};
};

Volume Ramp() {
  Volume volume;
  for (std::int64_t z = 0; z < kDims.z; ++z) {
    for (std::int64_t y = 0; y < kDims.y; ++y) {
      for (std::int64_t x = 0; x < kDims.x; ++x) {
        base::AppendLittleEndian(static_cast<std::uint16_t>(x + 100 * z), &volume.samples);
      }
    }
  }
  for (std::int64_t id = 0; id < volume.layout.block_count(); ++id) {
    const math::IndexBox own = volume.layout.OwnSamplesOf(static_cast<volume::BlockId>(id));
    volume.ranges.Set(static_cast<volume::BlockId>(id),
                      {static_cast<double>(own.begin.x + 100 * own.begin.z),
                       static_cast<double>(own.end.x - 1 + 100 * (own.end.z - 1))});
  }
  return volume;
}

// From +z, a pixel for each sample: pixel (x, y) shows (x + 0.5 - 4, 36 - y - 0.5).
view::View FromAbove() {
  view::Camera camera;
  camera.eye = {16, 16, 200};
  camera.target = {16, 16, 0};
  camera.up = {0, 1, 0};
  camera.projection = view::Projection::kOrthographic;
  camera.view_height = 40;
  return view::View::Make(camera, {40, 40}, Geometry()).value();
}

frame::FrameSpec CutAt(double z, double isovalue) {
  frame::FrameSpec spec;
  spec.surfaces = {{.rule = {.isovalue = isovalue}, .appearance = {}}};
  spec.viewport = {40, 40};
  spec.clip.half_spaces = {{{0, 0, -1}, -z}};
  spec.caps.emplace();
  return spec;
}

// All caps of the volume, with samples only where they are needed.
//
// field: of float32 samples, which the second surface shows; may be empty
std::vector<CapFragment> PaintAll(const CapPainter& painter, const Volume& volume,
                                  int* sample_count = nullptr, const std::string& field = "") {
  std::vector<CapFragment> fragments;
  volume::BlockSpans spans(volume.ranges);
  for (std::int64_t i = 0; i < volume.layout.block_count(); ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    const CapPainter::Need need = painter.NeedOf(id, &spans);
    if (need == CapPainter::Need::kNothing) {
      continue;
    }
    const std::string block =
        testing::CutBlock(volume.layout, volume::ScalarType::kUint16, volume.samples, id);
    const volume::BlockSamples samples{id, volume::ScalarType::kUint16, block.data()};
    if (sample_count != nullptr && need == CapPainter::Need::kSamples) {
      ++*sample_count;
    }
    std::string of_field;
    std::vector<volume::BlockSamples> fields(2);
    if (!field.empty()) {
      of_field = testing::CutBlock(volume.layout, volume::ScalarType::kFloat32, field, id);
      fields[1] = {id, volume::ScalarType::kFloat32, of_field.data()};
    }
    painter.Paint(
        id, spans.Get(id), need == CapPainter::Need::kSamples ? &samples : nullptr, fields,
        [](int, int, float) { return false; },
        [&](const CapFragment& fragment) { fragments.push_back(fragment); });
  }
  return fragments;
}

TEST(CapPainterTest, ACutThroughTheInsideIsFilledOnceAndFacesTheEye) {
  const Volume volume = Ramp();
  const view::View view = FromAbove();
  const frame::FrameSpec spec = CutAt(20.5, 1000);  // z <= 20.5; inside from z = 10 on
  const CapPainter painter(view, volume.layout, spec, frame::BackEnd::kCpu, nullptr);
  int sample_count = 0;
  const std::vector<CapFragment> fragments = PaintAll(painter, volume, &sample_count);
  EXPECT_EQ(fragments.size(), 32U * 32U) << "the volume is 32 pixels wide";
  EXPECT_EQ(sample_count, 0) << "spans tell that all of it is inside";
  std::vector<char> is_seen(std::size_t{40} * 40, 0);
  const std::vector<image::Rgba8> table = MakeShadeTable(spec.surfaces[0].appearance);
  for (const CapFragment& fragment : fragments) {
    char& seen = is_seen[static_cast<std::size_t>(fragment.y * 40 + fragment.x)];
    EXPECT_EQ(seen, 0);
    seen = 1;
    EXPECT_EQ(fragment.color, table[kShadeSteps]);
    EXPECT_TRUE(fragment.x >= 4 && fragment.x < 36 && fragment.y >= 4 && fragment.y < 36);
  }
}

TEST(CapPainterTest, TheHighestIsovalueThatHoldsThePointShows) {
  const Volume volume = Ramp();
  frame::FrameSpec spec = CutAt(20, 1000);
  spec.surfaces.resize(4);
  spec.surfaces[1].rule.isovalue = 2010.25;  // x >= 10.25 on the cut
  spec.surfaces[2].rule.isovalue = 2020.75;
  spec.surfaces[2].opacity = 0.5F;  // no solid
  spec.surfaces[3].rule.isovalue = 2010.25;
  const CapPainter painter(FromAbove(), volume.layout, spec, frame::BackEnd::kCpu, nullptr);
  const image::FragmentOrder order{.block_count =
                                       static_cast<std::uint32_t>(volume.layout.block_count())};
  const std::vector<CapFragment> fragments = PaintAll(painter, volume);
  EXPECT_EQ(fragments.size(), 32U * 32U);
  for (const CapFragment& fragment : fragments) {
    EXPECT_EQ(order.SurfaceOf(image::OwnerOf(fragment.key)),
              fragment.x + 0.5 - 4 >= 10.25 ? 1U : 0U)
        << fragment.x;
  }
}

TEST(CapPainterTest, APointBesideTheRimCountsWithinTheMargin) {
  const Volume volume = Ramp();
  // On the cut the surface lies at x = 10.5 + offset, and pixel 14 shows x = 10.5.
  const auto first_x = [&](double offset, frame::BackEnd back_end) {
    const CapPainter painter(FromAbove(), volume.layout, CutAt(20, 2010.5 + offset), back_end,
                             nullptr);
    int least = 99;
    for (const CapFragment& fragment : PaintAll(painter, volume)) {
      least = std::min(least, fragment.x);
    }
    return least;
  };
  EXPECT_EQ(first_x(-0.001, frame::BackEnd::kCpu), 14);
  EXPECT_EQ(first_x(0.01, frame::BackEnd::kCpu), 14) << "less than 1/64 pixel beside it";
  EXPECT_EQ(first_x(0.02, frame::BackEnd::kCpu), 15);
  EXPECT_EQ(first_x(0.1, frame::BackEnd::kEgl), 14) << "less than 1/8 pixel beside it";
  EXPECT_EQ(first_x(0.15, frame::BackEnd::kEgl), 15);
  // The same where the cell of the point is outside, and its block.
  const auto first_x_across = [&](double cut_x) {
    Volume steps = Ramp();
    frame::FrameSpec spec = CutAt(20, 2000 + cut_x);
    view::Camera camera = FromAbove().camera();
    camera.eye.x += 0.495;  // pixel 19 shows x = 15.995, and 16 begins a block
    camera.target.x += 0.495;
    const view::View view = view::View::Make(camera, {40, 40}, Geometry()).value();
    const CapPainter painter(view, steps.layout, spec, frame::BackEnd::kCpu, nullptr);
    int least = 99;
    for (const CapFragment& fragment : PaintAll(painter, steps)) {
      least = std::min(least, fragment.x);
    }
    return least;
  };
  EXPECT_EQ(first_x_across(16.005), 19);
  EXPECT_EQ(first_x_across(16.05), 20);
}

// Their vertices depend on samples beyond the cell, which blocks store for their own cells alone.
TEST(CapPainterTest, CapsOfSmoothLabelsAreThoseOfAnyBlocks) {
  std::string samples;
  for (std::int64_t i = 0; i < math::Volume(kDims); ++i) {
    base::AppendLittleEndian(
        static_cast<std::uint16_t>(base::RandomBits(5, static_cast<std::uint64_t>(i) / 2) % 3),
        &samples);
  }
  frame::FrameSpec spec = CutAt(0, 0);
  spec.clip.half_spaces = {{{0.3, 0.2, -1}, -8}};
  const auto painted = [&](const math::Index3& block_cells, bool smooths) {
    spec.surfaces = {{.rule = volume::InsideRule::OfLabels({1}, smooths), .appearance = {}},
                     {.rule = volume::InsideRule::OfLabels({2}, smooths), .appearance = {}}};
    Volume volume{.layout = volume::BlockLayout::Make(kDims, block_cells).value(),
                  .samples = samples};
    for (std::int64_t id = 0; id < volume.layout.block_count(); ++id) {
      volume.ranges.Set(static_cast<volume::BlockId>(id), {0, 2});
    }
    const CapPainter painter(FromAbove(), volume.layout, spec, frame::BackEnd::kCpu, nullptr);
    const image::FragmentOrder order{.block_count =
                                         static_cast<std::uint32_t>(volume.layout.block_count())};
    std::vector<std::array<std::uint64_t, 4>> fragments;
    for (const CapFragment& fragment : PaintAll(painter, volume)) {
      fragments.push_back({static_cast<std::uint64_t>(fragment.x),
                           static_cast<std::uint64_t>(fragment.y), fragment.key >> 32,
                           order.SurfaceOf(image::OwnerOf(fragment.key))});
    }
    std::sort(fragments.begin(), fragments.end());
    return fragments;
  };
  const auto smooth = painted({8, 8, 8}, true);
  EXPECT_GT(smooth.size(), 400U);
  EXPECT_NE(smooth, painted({8, 8, 8}, false));
  for (const math::Index3& block_cells :
       {math::Index3{5, 7, 4}, math::Index3{3, 3, 3}, math::Index3{32, 32, 32}}) {
    EXPECT_EQ(painted(block_cells, true), smooth) << block_cells.x;
  }
}

TEST(CapPainterTest, SamplesShowThroughTheirColorsAndNormalsLeadToWhatIsDropped) {
  const Volume volume = Ramp();
  frame::FrameSpec spec = CutAt(20.5, 1000);
  spec.caps->map = frame::ColorMap::kGrey;
  const SampleColor color = [](double value) {
    return image::Rgba8{static_cast<std::uint8_t>(value - 2000), 0, 0, 255};
  };
  const auto count = static_cast<std::uint32_t>(volume.layout.block_count());
  for (const bool sends_normals : {false, true}) {
    spec.sends_normals = sends_normals;
    const CapPainter painter(FromAbove(), volume.layout, spec, frame::BackEnd::kCpu, color);
    const std::vector<CapFragment> fragments = PaintAll(painter, volume);
    EXPECT_EQ(fragments.size(), 32U * 32U);
    for (const CapFragment& fragment : fragments) {
      EXPECT_EQ(fragment.color.r, fragment.x - 4 + 50) << "x + 0.5 - 4 + 100 * 20.5";
      EXPECT_EQ(image::OwnerOf(fragment.key) / count, sends_normals ? 1U : 0U);
    }
  }
  spec.caps->map.reset();
  const CapPainter painter(FromAbove(), volume.layout, spec, frame::BackEnd::kCpu, nullptr);
  for (const CapFragment& fragment : PaintAll(painter, volume)) {
    EXPECT_EQ(fragment.color, image::EncodeNormal({0, 0, 1}));
    EXPECT_LT(image::OwnerOf(fragment.key), count);
  }
}

TEST(CapPainterTest, CapsOfASurfaceThatShowsAFieldShowItUnlessTheyHaveAMap) {
  const Volume volume = Ramp();
  std::string field;  // 3 x - y, and NaN in a corner
  for (std::int64_t z = 0; z < kDims.z; ++z) {
    for (std::int64_t y = 0; y < kDims.y; ++y) {
      for (std::int64_t x = 0; x < kDims.x; ++x) {
        const auto value = static_cast<float>(3 * x - y);
        base::AppendLittleEndian(x + y == 0 ? std::numeric_limits<float>::quiet_NaN() : value,
                                 &field);
      }
    }
  }
  frame::FrameSpec spec = CutAt(20.5, 100'000);
  spec.surfaces.resize(2);
  spec.surfaces[1].rule.isovalue = 1000;
  spec.surfaces[1].color_by = frame::ColorBy{.quantity = frame::ColorBy::Quantity::kField,
                                             .range = frame::ColorRange{-32, 96}};
  spec.sends_normals = true;
  EXPECT_FALSE(
      CapPainter(FromAbove(), volume.layout, spec, frame::BackEnd::kCpu, nullptr).ShowsField(1))
      << "no steps are sent";
  spec.sends_map_steps = true;
  const CapPainter painter(FromAbove(), volume.layout, spec, frame::BackEnd::kCpu, nullptr);
  EXPECT_FALSE(painter.ShowsField(0));
  EXPECT_TRUE(painter.ShowsField(1));
  const std::vector<CapFragment> fragments = PaintAll(painter, volume, nullptr, field);
  EXPECT_EQ(fragments.size(), 32U * 32U);
  const image::Rgba8 up = image::EncodeNormal({0, 0, 1});
  int missing_count = 0;
  for (const CapFragment& fragment : fragments) {
    const double x = fragment.x - 3.5;
    const double y = 35.5 - fragment.y;
    // The samples of the cell have weights that are not 0, so one that is NaN makes the value NaN.
    const bool is_missing = x < 1 && y < 1;
    EXPECT_EQ(fragment.color, is_missing ? image::EncodeNormalWithoutStep(up)
                                         : image::EncodeNormalAndStep(
                                               up, static_cast<std::uint8_t>((3 * x - y + 32) * 2)))
        << x << ", " << y;
    missing_count += is_missing ? 1 : 0;
  }
  EXPECT_EQ(missing_count, 1);
  spec.surfaces[1].opacity = 0.5F;
  EXPECT_FALSE(
      CapPainter(FromAbove(), volume.layout, spec, frame::BackEnd::kCpu, nullptr).ShowsField(1))
      << "it has no caps";
  spec.surfaces[1].opacity = 1;
  const CapPainter with_map(
      FromAbove(), volume.layout, spec, frame::BackEnd::kCpu, [](double value) {
        return image::Rgba8{static_cast<std::uint8_t>(value / 100), 0, 0, 255};
      });
  EXPECT_FALSE(with_map.ShowsField(1));
  for (const CapFragment& fragment : PaintAll(with_map, volume)) {
    EXPECT_EQ(fragment.color.r, 20) << "samples of the volume that is drawn";
  }
}

TEST(CapPainterTest, BlocksAwayFromTheCutAndOutsideNeedNothing) {
  const Volume volume = Ramp();
  const CapPainter painter(FromAbove(), volume.layout, CutAt(20.5, 3100), frame::BackEnd::kCpu,
                           nullptr);
  volume::BlockSpans spans(volume.ranges);
  for (std::int64_t id = 0; id < volume.layout.block_count(); ++id) {
    const std::int64_t z = volume.layout.IndexOf(static_cast<volume::BlockId>(id)).z;
    const CapPainter::Need need = painter.NeedOf(static_cast<volume::BlockId>(id), &spans);
    // The block behind has the surface, so a point beside a ray may be in it.
    EXPECT_EQ(need, z == 2 ? CapPainter::Need::kSamples : CapPainter::Need::kNothing) << id;
  }
  EXPECT_TRUE(PaintAll(painter, volume).empty());
  frame::FrameSpec translucent = CutAt(20.5, 1000);
  translucent.surfaces[0].opacity = 0.5F;
  EXPECT_TRUE(
      PaintAll(CapPainter(FromAbove(), volume.layout, translucent, frame::BackEnd::kCpu, nullptr),
               volume)
          .empty());
}

TEST(CapPainterTest, WhatIsHiddenIsLeftOut) {
  const Volume volume = Ramp();
  const CapPainter painter(FromAbove(), volume.layout, CutAt(20.5, 1000), frame::BackEnd::kCpu,
                           nullptr);
  int count = 0;
  volume::BlockSpans spans(volume.ranges);
  for (std::int64_t i = 0; i < volume.layout.block_count(); ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    if (painter.NeedOf(id, &spans) == CapPainter::Need::kSpan) {
      painter.Paint(
          id, spans.Get(id), nullptr, {}, [](int x, int, float) { return x != 20; },
          [&](const CapFragment& fragment) {
            EXPECT_EQ(fragment.x, 20);
            ++count;
          });
    }
  }
  EXPECT_EQ(count, 32);
}

}  // namespace
}  // namespace isoscope::render
