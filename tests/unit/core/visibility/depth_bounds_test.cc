// The bounds hold what is drawn: random volumes, cuts, views, clip regions and caps, drawn block by
// block without culling. Each fragment of the picture must lie between the bounds of its pixel.
// ISOSCOPE_DEPTH_BOUNDS_FRAMES=10000 draws as many frames (default: 400).
//
// Besides: the parts and their order do not show; a single block by hand; blocks that are clipped,
// near the eye, or only filled by a cap.

#include "core/visibility/depth_bounds.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/base/coding.h"
#include "core/base/random.h"
#include "core/extract/block_extractor.h"
#include "core/frame/frame_spec.h"
#include "core/image/fragment.h"
#include "core/mesh/compact_mesh.h"
#include "core/render/clip_caps.h"
#include "core/render/cpu_renderer.h"
#include "core/visibility/occluder_selection.h"
#include "core/volume/block_spans.h"
#include "core/volume/range_table.h"
#include "tests/support/block_cutter.h"
#include "tests/support/draws.h"
#include "tests/support/status_matchers.h"

namespace isoscope::visibility {
namespace {

using isoscope::testing::Dice;
using math::Vec3d;

// Samples of uint8 in memory, cut into blocks.
struct Volume {
  volume::GridGeometry geometry;
  volume::BlockLayout layout;
  std::string samples;
  volume::RangeTable ranges;
};

volume::RangeTable RangesOf(const volume::BlockLayout& layout, const std::string& samples) {
  volume::RangeTable ranges(volume::ScalarType::kUint8, layout.block_count());
  const math::Index3& dims = layout.sample_dims();
  for (std::int64_t i = 0; i < layout.block_count(); ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    const math::IndexBox own = layout.OwnSamplesOf(id);
    int min = 255;
    int max = 0;
    for (std::int64_t z = own.begin.z; z < own.end.z; ++z) {
      for (std::int64_t y = own.begin.y; y < own.end.y; ++y) {
        for (std::int64_t x = own.begin.x; x < own.end.x; ++x) {
          const int sample = static_cast<unsigned char>(
              samples[static_cast<std::size_t>(x + dims.x * (y + dims.y * z))]);
          min = std::min(min, sample);
          max = std::max(max, sample);
        }
      }
    }
    ranges.Set(id, {static_cast<double>(min), static_cast<double>(max)});
  }
  return ranges;
}

Volume MakeVolume(const volume::GridGeometry& geometry, const math::Index3& block_cells,
                  std::string samples) {
  Volume made{.geometry = geometry,
              .layout = volume::BlockLayout::Make(geometry.sample_dims, block_cells).value(),
              .samples = std::move(samples),
              .ranges = {}};
  made.ranges = RangesOf(made.layout, made.samples);
  return made;
}

// A rotation about a random axis.
math::Mat3d RandomRotation(Dice* dice) {
  const Vec3d axis =
      math::Normalized(Vec3d{dice->Unit() - 0.5, dice->Unit() - 0.5, dice->Unit() - 0.5 + 1e-3});
  const Vec3d other = math::Normalized(math::Cross(axis, Vec3d{0.3, 1, 0.2}));
  return {{axis, other, math::Cross(axis, other)}};
}

// Noise: a few lone samples, or half of them, so that some blocks are active and others not.
Volume RandomVolume(Dice* dice) {
  volume::GridGeometry geometry;
  math::Index3 block_cells;
  for (int axis = 0; axis < 3; ++axis) {
    geometry.sample_dims[axis] = dice->Whole(3, 16);
    geometry.spacing[axis] = std::exp2(4 * dice->Unit() - 2);
    geometry.origin[axis] = dice->OneIn(4) ? 1000 * (dice->Unit() - 0.5) : 0;
    block_cells[axis] = dice->Whole(1, 6);
  }
  if (dice->OneIn(2)) {
    geometry.direction = RandomRotation(dice);
  }
  std::string samples(static_cast<std::size_t>(math::Volume(geometry.sample_dims)), '\0');
  const double share = dice->OneIn(2) ? 0.01 : 0.5;
  for (char& sample : samples) {
    sample = static_cast<char>(dice->Unit() < share ? dice->Whole(1, 255) : 0);
  }
  return MakeVolume(geometry, block_cells, std::move(samples));
}

// From outside, inside, or beside the volume, towards a point of it.
view::Camera RandomCamera(const math::Box3d& bounds, Dice* dice) {
  const double radius = bounds.Radius();
  const auto point = [&](double reach) {
    return bounds.Center() +
           Vec3d{2 * dice->Unit() - 1, 2 * dice->Unit() - 1, 2 * dice->Unit() - 1} *
               (reach * radius);
  };
  view::Camera camera;
  camera.eye = point(dice->OneIn(3) ? 0.5 : std::exp2(5 * dice->Unit()));
  camera.target = point(0.5);
  camera.up = Vec3d{0.1, 0.2, 1};
  if (dice->OneIn(3)) {
    camera.projection = view::Projection::kOrthographic;
    camera.view_height = radius * std::exp2(4 * dice->Unit() - 2);
  } else {
    camera.fov_y_radians = 0.05 + 2.5 * dice->Unit();
  }
  return camera;
}

// An isovalue, labels, or smooth labels; one surface in three is translucent.
frame::Surface RandomSurface(Dice* dice) {
  frame::Surface surface;
  if (dice->OneIn(2)) {
    surface.rule = volume::InsideRule::OfIsovalue(static_cast<double>(dice->Whole(1, 255)));
  } else {
    std::vector<double> labels;
    for (std::int64_t i = dice->Whole(1, 200); i > 0; --i) {
      labels.push_back(static_cast<double>(dice->Whole(1, 255)));
    }
    surface.rule = volume::InsideRule::OfLabels(std::move(labels), dice->OneIn(2));
  }
  surface.opacity = dice->OneIn(3) ? 0.5F : 1.0F;
  return surface;
}

frame::FrameSpec RandomSpec(const math::Box3d& bounds, Dice* dice) {
  frame::FrameSpec spec;
  for (std::int64_t i = dice->Whole(1, 2); i > 0; --i) {
    spec.surfaces.push_back(RandomSurface(dice));
  }
  spec.camera = RandomCamera(bounds, dice);
  spec.viewport = {static_cast<int>(dice->Whole(1, 40)), static_cast<int>(dice->Whole(1, 40))};
  if (dice->OneIn(4)) {
    const auto x = static_cast<int>(dice->Whole(0, spec.viewport.width_px - 1));
    const auto y = static_cast<int>(dice->Whole(0, spec.viewport.height_px - 1));
    spec.region = view::Region{x, y, static_cast<int>(dice->Whole(1, spec.viewport.width_px - x)),
                               static_cast<int>(dice->Whole(1, spec.viewport.height_px - y))};
  }
  for (std::int64_t i = dice->Whole(-2, 2); i > 0; --i) {
    const Vec3d normal =
        math::Normalized(Vec3d{dice->Unit() - 0.5, dice->Unit() - 0.5, dice->Unit() - 0.5 + 1e-3});
    const Vec3d at = bounds.min + Vec3d{dice->Unit() * (bounds.max.x - bounds.min.x),
                                        dice->Unit() * (bounds.max.y - bounds.min.y),
                                        dice->Unit() * (bounds.max.z - bounds.min.z)};
    spec.clip.half_spaces.push_back({normal, math::Dot(normal, at)});
  }
  if (!spec.clip.half_spaces.empty() && dice->OneIn(2)) {
    spec.caps.emplace();
  }
  return spec;
}

std::vector<volume::BlockId> MembersIn(const volume::BlockSet& blocks, volume::BlockId begin,
                                       volume::BlockId end) {
  std::vector<volume::BlockId> members = blocks.Ids();
  std::erase_if(members, [&](volume::BlockId id) { return id < begin || id >= end; });
  return members;
}

// The bounds of some parts of the blocks, each by itself, united in the order of `parts`.
DepthBounds BoundsOf(const Volume& volume, const view::View& view, const frame::FrameSpec& spec,
                     const std::vector<std::pair<volume::BlockId, volume::BlockId>>& parts) {
  const view::Clipper clipper(spec.clip, volume.geometry);
  volume::BlockSet active(volume.layout.block_count());
  volume::BlockSet with_inside(volume.layout.block_count());
  for (const frame::Surface& surface : spec.surfaces) {
    for (std::int64_t i = 0; i < volume.layout.block_count(); ++i) {
      const auto id = static_cast<volume::BlockId>(i);
      const volume::ScalarSpan span = volume.ranges.Get(id);
      if (surface.rule.IsActive(span)) {
        active.Insert(id);
      }
      if (spec.caps.has_value() && !surface.is_translucent() && surface.rule.MayHaveInside(span)) {
        with_inside.Insert(id);
      }
    }
  }
  AddNeighbours(volume.layout.block_dims(), &with_inside);
  const view::Viewport size = view.image_size();
  DepthBounds all(size.width_px, size.height_px);
  for (const auto& [begin, end] : parts) {
    DepthBounds of_part(size.width_px, size.height_px);
    const std::vector<volume::BlockId> of_surface = MembersIn(active, begin, end);
    const std::vector<volume::BlockId> near_inside = MembersIn(with_inside, begin, end);
    BoundedBlocks blocks{
        .view = &view, .layout = &volume.layout, .clipper = &clipper, .ids = of_surface};
    AddSurfaceBlocks(blocks, &of_part);
    blocks.ids = near_inside;
    AddCapBlocks(blocks, &of_part);
    all.UniteWith(of_part);
  }
  return all;
}

DepthBounds BoundsOf(const Volume& volume, const view::View& view, const frame::FrameSpec& spec) {
  return BoundsOf(volume, view, spec,
                  {{0, static_cast<volume::BlockId>(volume.layout.block_count())}});
}

// A fragment of the exact picture.
struct Drawn {
  std::size_t pixel = 0;
  float depth = 0;
};

class DepthBoundsTest : public ::testing::Test {
 protected:
  // Draws each surface by itself, so that no fragment hides another one of a block that it meets
  // alone. Translucent ones are drawn as opaque: depths are the same.
  void DrawTriangles(const Volume& volume, const view::View& view, const frame::FrameSpec& spec,
                     std::vector<Drawn>* drawn) {
    extract::BlockExtractor extractor(volume.geometry, volume.layout);
    for (const frame::Surface& surface : spec.surfaces) {
      frame::FrameSpec one = spec;
      one.surfaces = {{.rule = surface.rule}};
      one.caps.reset();
      for (std::int64_t i = 0; i < volume.layout.block_count(); ++i) {
        const auto id = static_cast<volume::BlockId>(i);
        if (!surface.rule.IsActive(volume.ranges.Get(id))) {
          continue;
        }
        const std::string block =
            testing::CutBlock(volume.layout, volume::ScalarType::kUint8, volume.samples, id);
        const std::shared_ptr<const mesh::CompactMesh> mesh = mesh::Compact(
            extractor.Extract({id, volume::ScalarType::kUint8, block.data()}, surface.rule));
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<render::RenderPass> pass,
                                      renderer_->BeginPass(view, volume.layout, one));
        ISOSCOPE_ASSERT_OK(pass->Add(mesh));
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::FrameImage image,
                                      pass->Finish(base::Cancellation()));
        for (std::size_t pixel = 0; pixel < image.pixel_count(); ++pixel) {
          if (image::OwnerOf(image.keys[pixel]) != image::kNoOwner) {
            drawn->push_back({pixel, image::DepthOf(image.keys[pixel])});
          }
        }
      }
    }
  }

  static void DrawCaps(const Volume& volume, const view::View& view, const frame::FrameSpec& spec,
                       std::vector<Drawn>* drawn) {
    const render::CapPainter painter(view, volume.layout, spec, frame::BackEnd::kEgl, nullptr);
    volume::BlockSpans spans(volume.ranges);
    for (std::int64_t i = 0; i < volume.layout.block_count(); ++i) {
      const auto id = static_cast<volume::BlockId>(i);
      const render::CapPainter::Need need = painter.NeedOf(id, &spans);
      if (need == render::CapPainter::Need::kNothing) {
        continue;
      }
      const std::string block =
          testing::CutBlock(volume.layout, volume::ScalarType::kUint8, volume.samples, id);
      const volume::BlockSamples samples{id, volume::ScalarType::kUint8, block.data()};
      painter.Paint(
          id, spans.Get(id), need == render::CapPainter::Need::kSamples ? &samples : nullptr, {},
          [](int, int, float) { return false; },
          [&](const render::CapFragment& fragment) {
            const auto row = static_cast<std::size_t>(fragment.y);
            const auto width = static_cast<std::size_t>(view.image_size().width_px);
            drawn->push_back(
                {row * width + static_cast<std::size_t>(fragment.x), image::DepthOf(fragment.key)});
          });
    }
  }

  std::unique_ptr<render::Renderer> renderer_ = render::MakeCpuRenderer(std::size_t{1} << 20);
};

int FrameCount() {
  const char* const text =
      std::getenv("ISOSCOPE_DEPTH_BOUNDS_FRAMES");  // NOLINT(concurrency-mt-unsafe)
  int count = 400;
  if (text != nullptr) {
    EXPECT_TRUE(absl::SimpleAtoi(text, &count)) << "ISOSCOPE_DEPTH_BOUNDS_FRAMES=" << text;
  }
  return count;
}

TEST_F(DepthBoundsTest, EveryFragmentOfRandomFramesLiesBetweenTheBoundsOfItsPixel) {
  std::int64_t fragments = 0;
  std::int64_t caps = 0;
  std::int64_t background = 0;
  std::int64_t narrow = 0;
  const int frame_count = FrameCount();
  const std::uint64_t seed = testing::DrawSeed();
  for (int n = 0; n < frame_count; ++n) {
    Dice dice(seed + static_cast<std::uint64_t>(n));
    const Volume volume = RandomVolume(&dice);
    const math::Box3d bounds_of_volume = volume.geometry.Bounds();
    const frame::FrameSpec spec = RandomSpec(bounds_of_volume, &dice);
    const absl::StatusOr<view::View> view =
        view::View::Make(*spec.camera, spec.viewport, volume.geometry, spec.region);
    if (!view.ok()) {
      continue;  // the eye is the target, or up is the direction
    }
    // 1. The bounds of two parts.
    const auto count = static_cast<volume::BlockId>(volume.layout.block_count());
    const auto middle = static_cast<volume::BlockId>(dice.Whole(0, count));
    const DepthBounds bounds = BoundsOf(volume, *view, spec, {{middle, count}, {0, middle}});
    ASSERT_TRUE(bounds == BoundsOf(volume, *view, spec)) << "frame " << n;
    // 2. All fragments, by brute force.
    std::vector<Drawn> drawn;
    DrawTriangles(volume, *view, spec, &drawn);
    const std::size_t triangle_fragments = drawn.size();
    if (spec.caps.has_value()) {
      DrawCaps(volume, *view, spec, &drawn);
    }
    for (const Drawn& fragment : drawn) {
      ASSERT_FALSE(bounds.IsBackground(fragment.pixel))
          << "frame " << n << ", pixel " << fragment.pixel << ", depth " << fragment.depth;
      ASSERT_LE(bounds.nearest()[fragment.pixel], fragment.depth)
          << "frame " << n << ", pixel " << fragment.pixel;
      ASSERT_GE(bounds.farthest()[fragment.pixel], fragment.depth)
          << "frame " << n << ", pixel " << fragment.pixel;
    }
    fragments += static_cast<std::int64_t>(triangle_fragments);
    caps += static_cast<std::int64_t>(drawn.size() - triangle_fragments);
    for (std::size_t pixel = 0; pixel < bounds.nearest().size(); ++pixel) {
      ASSERT_TRUE(DepthBounds::AreValid(bounds.nearest()[pixel], bounds.farthest()[pixel]));
      background += bounds.IsBackground(pixel) ? 1 : 0;
      narrow +=
          !bounds.IsBackground(pixel) && bounds.farthest()[pixel] - bounds.nearest()[pixel] < 0.5F
              ? 1
              : 0;
    }
  }
  // The draws have all kinds of pixels.
  EXPECT_GT(fragments, 20 * frame_count);
  EXPECT_GT(caps, frame_count / 10);
  EXPECT_GT(background, 20 * frame_count);
  EXPECT_GT(narrow, 3 * frame_count);
}

// 9 x 9 x 9 samples in blocks of 4 cells, seen along -z, four pixels a cell; depth grows with -z.
view::View FromAbove(const volume::GridGeometry& geometry) {
  view::Camera camera;
  camera.eye = {4, 4, 100};
  camera.target = {4, 4, 0};
  camera.up = {0, 1, 0};
  camera.projection = view::Projection::kOrthographic;
  camera.view_height = 8;
  return view::View::Make(camera, {32, 32}, geometry).value();
}

Volume WithOneSample(const math::Index3& at, char value) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {9, 9, 9};
  std::string samples(std::size_t{9} * 9 * 9, '\0');
  samples[static_cast<std::size_t>(at.x + 9 * (at.y + 9 * at.z))] = value;
  return MakeVolume(geometry, {4, 4, 4}, std::move(samples));
}

frame::FrameSpec OfIsovalue(double isovalue) {
  frame::FrameSpec spec;
  spec.surfaces = {{.rule = volume::InsideRule::OfIsovalue(isovalue)}};
  return spec;
}

TEST_F(DepthBoundsTest, ABlockBoundsItsPixelsByItsOwnDepths) {
  const Volume volume = WithOneSample({2, 2, 6}, 100);  // block (0, 0, 1)
  const view::View view = FromAbove(volume.geometry);
  const DepthBounds bounds = BoundsOf(volume, view, OfIsovalue(50));
  const auto depth_of = [&](double z) {
    const math::Vec4d clip = view.clip_from_index() * math::Vec4d{0, 0, z, 1};
    return 0.5 * clip.z / clip.w + 0.5;
  };
  for (int y = 0; y < 32; ++y) {
    for (int x = 0; x < 32; ++x) {
      // Samples 0 to 4 of x are pixels 0 to 15; y points up.
      const auto pixel = static_cast<std::size_t>(32 * y + x);
      ASSERT_EQ(bounds.IsBackground(pixel), x >= 16 || y < 16) << x << ", " << y;
      if (!bounds.IsBackground(pixel)) {
        ASSERT_LE(bounds.nearest()[pixel], depth_of(8));
        ASSERT_NEAR(bounds.nearest()[pixel], depth_of(8), 1e-4);
        ASSERT_GE(bounds.farthest()[pixel], depth_of(4));
        ASSERT_NEAR(bounds.farthest()[pixel], depth_of(4), 1e-4);
      }
    }
  }
}

TEST_F(DepthBoundsTest, OnlyBlocksThatTheSpanMakesActiveCount) {
  const Volume volume = WithOneSample({2, 2, 6}, 100);
  const view::View view = FromAbove(volume.geometry);
  EXPECT_EQ(BoundsOf(volume, view, OfIsovalue(100.5)), DepthBounds(32, 32));
  EXPECT_NE(BoundsOf(volume, view, OfIsovalue(100)), DepthBounds(32, 32));
}

TEST_F(DepthBoundsTest, BlocksOutsideOfTheClipRegionDoNotCount) {
  const Volume volume = WithOneSample({2, 2, 6}, 100);
  const view::View view = FromAbove(volume.geometry);
  frame::FrameSpec spec = OfIsovalue(50);
  spec.clip.half_spaces = {{{0, 0, -1}, -3.5}};  // z <= 3.5; the block begins at 4
  EXPECT_EQ(BoundsOf(volume, view, spec), DepthBounds(32, 32));
  spec.clip.half_spaces = {{{0, 0, -1}, -4.5}};
  EXPECT_NE(BoundsOf(volume, view, spec), DepthBounds(32, 32));
}

// A solid without a triangle: only caps show it.
TEST_F(DepthBoundsTest, BlocksWithAnInsideSampleCountWhereCapsCutThem) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {9, 9, 9};
  const Volume volume = MakeVolume(geometry, {4, 4, 4}, std::string(std::size_t{9} * 9 * 9, 'x'));
  const view::View view = FromAbove(geometry);
  frame::FrameSpec spec = OfIsovalue(50);
  spec.clip.half_spaces = {{{0, 0, -1}, -6.0}};  // cuts the upper blocks
  EXPECT_EQ(BoundsOf(volume, view, spec), DepthBounds(32, 32)) << "open cuts show nothing";
  spec.caps.emplace();
  const DepthBounds bounds = BoundsOf(volume, view, spec);
  for (std::size_t pixel = 0; pixel < bounds.nearest().size(); ++pixel) {
    ASSERT_FALSE(bounds.IsBackground(pixel)) << pixel;
    ASSERT_LT(bounds.farthest()[pixel], 0.75) << "blocks below, which the cut is far from";
  }
  spec.surfaces[0].opacity = 0.5F;
  EXPECT_EQ(BoundsOf(volume, view, spec), DepthBounds(32, 32)) << "translucent ones have no caps";
}

TEST_F(DepthBoundsTest, ABlockAtTheNearPlaneCoversEverything) {
  const Volume volume = WithOneSample({2, 2, 6}, 100);
  view::Camera camera;
  camera.eye = {2, 2, 6};  // in the active block
  camera.target = {6, 6, 2};
  camera.up = {0, 1, 0};
  camera.fov_y_radians = 0.5;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const view::View view,
                                view::View::Make(camera, {32, 24}, volume.geometry));
  const DepthBounds bounds = BoundsOf(volume, view, OfIsovalue(50));
  for (std::size_t pixel = 0; pixel < bounds.nearest().size(); ++pixel) {
    ASSERT_EQ(bounds.nearest()[pixel], 0);
    ASSERT_EQ(bounds.farthest()[pixel], 1);
  }
}

TEST_F(DepthBoundsTest, UnionIsTheLeastAndTheGreatestOfBoth) {
  DepthBounds a(2, 1);
  a.AddToRows({0, 0, 1, 1}, 0.5F, 0.75F, 0, 1);
  DepthBounds b(2, 1);
  b.AddToRows({0, 0, 2, 1}, 0.625F, 0.875F, 0, 1);
  DepthBounds expected(2, 1);
  expected.AddToRows({0, 0, 1, 1}, 0.5F, 0.875F, 0, 1);
  expected.AddToRows({1, 0, 2, 1}, 0.625F, 0.875F, 0, 1);
  DepthBounds ab = a;
  ab.UniteWith(b);
  EXPECT_EQ(ab, expected);
  b.UniteWith(a);
  EXPECT_EQ(b, expected);
  b.UniteWith(b);
  b.UniteWith(DepthBounds(2, 1));
  EXPECT_EQ(b, expected) << "once more changes nothing";
}

TEST_F(DepthBoundsTest, ValuesOfAPixelAreChecked) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_TRUE(DepthBounds::AreValid(0, 1));
  EXPECT_TRUE(DepthBounds::AreValid(0.5F, 0.5F));
  EXPECT_TRUE(DepthBounds::AreValid(DepthBounds::kNoNearest, DepthBounds::kNoFarthest));
  for (const auto& [nearest, farthest] : {std::pair{0.5F, 0.25F},
                                          {-0.5F, 0.5F},
                                          {0.5F, 1.5F},
                                          {2.0F, 1.0F},
                                          {0.5F, -1.0F},
                                          {kNan, 0.5F},
                                          {0.5F, kNan},
                                          {kNan, kNan}}) {
    EXPECT_FALSE(DepthBounds::AreValid(nearest, farthest)) << nearest << ", " << farthest;
  }
}

}  // namespace
}  // namespace isoscope::visibility
