// Blocks are taken some thousand at a time:
//
// 1. Find their footprints and farthest depths, in parallel (Splat).
// 2. Each task takes some rows of the picture, and adds all footprints to its rows. So no pixel is
//    written by two threads.
//
// A block that reaches the near plane covers every pixel with every depth. Once there is one, no
// other block changes anything.
//
// The result is a set of minima and maxima of floats without NaN. So it has the same bits whatever
// the order, the parts and the threads are.

#include "core/visibility/depth_bounds.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>

#include "absl/types/span.h"
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/base/check.h"
#include "core/math/box.h"
#include "core/math/vec.h"
#include "core/view/farthest_depth.h"

namespace isoscope::visibility {
namespace {

// Footprints at a time, and for one task.
constexpr std::size_t kBatchBlocks = 16384;
constexpr std::size_t kBlocksPerTask = 256;
constexpr int kRowsPerTask = 16;

// The fragments that a block may have.
struct Splat {
  view::PixelRect rect;
  float nearest = 0;
  float farthest = 0;
};

std::size_t PixelCount(int width_px, int height_px) {
  return static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px);
}

math::Vec3d ToDoubles(const math::Index3& v) {
  return {static_cast<double>(v.x), static_cast<double>(v.y), static_cast<double>(v.z)};
}

Splat SplatOf(const view::View& view, const math::Vec3d& min, const math::Vec3d& max,
              const view::Footprint& footprint) {
  return {.rect = footprint.rect,
          .nearest = footprint.nearest_depth,
          .farthest = footprint.rect.empty() ? footprint.nearest_depth
                                             : view::FarthestDepthOf(view, min, max, footprint)};
}

using Side = view::Clipper::Side;

// Finds the splats of some blocks. drawn(side): whether blocks on that side of the region count
template <typename Drawn>
void FindSplats(const BoundedBlocks& of, std::span<const volume::BlockId> ids, const Drawn& drawn,
                std::span<Splat> splats) {
  std::array<view::Footprint, kBlocksPerTask> footprints;
  of.view->FootprintsOf(*of.layout, absl::MakeConstSpan(ids.data(), ids.size()),
                        absl::MakeSpan(footprints).first(ids.size()));
  for (std::size_t i = 0; i < ids.size(); ++i) {
    if (!drawn(of.clipper->SideOf(*of.layout, ids[i]))) {
      splats[i] = {};
      continue;
    }
    const math::IndexBox cells = of.layout->CellsOf(ids[i]);
    splats[i] = SplatOf(*of.view, ToDoubles(cells.begin), ToDoubles(cells.end), footprints[i]);
  }
}

bool CoversAll(const Splat& splat, const DepthBounds& bounds) {
  return splat.nearest == 0 && splat.farthest == 1 &&
         splat.rect == view::PixelRect{0, 0, bounds.width_px(), bounds.height_px()};
}

template <typename Drawn>
void AddBlocks(const BoundedBlocks& of, const Drawn& drawn, DepthBounds* bounds) {
  ISOSCOPE_CHECK_EQ(bounds->width_px(), of.view->image_size().width_px);
  ISOSCOPE_CHECK_EQ(bounds->height_px(), of.view->image_size().height_px);
  std::vector<Splat> splats;
  const auto add = [&](std::span<const Splat> added) {
    tbb::parallel_for(tbb::blocked_range<int>(0, bounds->height_px(), kRowsPerTask),
                      [&](const tbb::blocked_range<int>& rows) {
                        for (const Splat& splat : added) {
                          bounds->AddToRows(splat.rect, splat.nearest, splat.farthest, rows.begin(),
                                            rows.end());
                        }
                      });
  };
  for (std::size_t begin = 0; begin < of.ids.size(); begin += kBatchBlocks) {
    const std::span<const volume::BlockId> ids =
        of.ids.subspan(begin, std::min(kBatchBlocks, of.ids.size() - begin));
    // 1. Footprints and depths.
    splats.resize(ids.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, ids.size(), kBlocksPerTask),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                        for (std::size_t i = range.begin(); i < range.end(); i += kBlocksPerTask) {
                          const std::size_t count = std::min(kBlocksPerTask, range.end() - i);
                          FindSplats(of, ids.subspan(i, count), drawn,
                                     std::span(splats).subspan(i, count));
                        }
                      });
    const auto all = std::find_if(splats.begin(), splats.end(),
                                  [&](const Splat& splat) { return CoversAll(splat, *bounds); });
    if (all != splats.end()) {
      add(std::span<const Splat>(&*all, 1));
      return;
    }
    // 2. Rows.
    add(splats);
  }
}

}  // namespace

DepthBounds::DepthBounds(int width_px, int height_px)
    : DepthBounds(width_px, height_px,
                  std::vector<float>(PixelCount(width_px, height_px), kNoNearest),
                  std::vector<float>(PixelCount(width_px, height_px), kNoFarthest)) {}

DepthBounds::DepthBounds(int width_px, int height_px, std::vector<float> nearest,
                         std::vector<float> farthest)
    : width_px_(width_px),
      height_px_(height_px),
      nearest_(std::move(nearest)),
      farthest_(std::move(farthest)) {
  ISOSCOPE_CHECK_EQ(nearest_.size(), PixelCount(width_px, height_px));
  ISOSCOPE_CHECK_EQ(farthest_.size(), PixelCount(width_px, height_px));
}

bool DepthBounds::AreValid(float nearest, float farthest) {
  return (nearest == kNoNearest && farthest == kNoFarthest) ||
         (nearest >= 0 && nearest <= farthest && farthest <= 1);
}

void DepthBounds::AddToRows(const view::PixelRect& rect, float nearest, float farthest,
                            int begin_row, int end_row) {
  for (int y = std::max(rect.begin_y, begin_row); y < std::min(rect.end_y, end_row); ++y) {
    const std::size_t row = PixelCount(width_px_, y);
    float* const near_row = nearest_.data() + row;
    float* const far_row = farthest_.data() + row;
    for (int x = rect.begin_x; x < rect.end_x; ++x) {
      near_row[x] = std::min(near_row[x], nearest);
      far_row[x] = std::max(far_row[x], farthest);
    }
  }
}

void DepthBounds::UniteWith(const DepthBounds& other) {
  ISOSCOPE_CHECK_EQ(width_px_, other.width_px_);
  ISOSCOPE_CHECK_EQ(height_px_, other.height_px_);
  for (std::size_t i = 0; i < nearest_.size(); ++i) {
    nearest_[i] = std::min(nearest_[i], other.nearest_[i]);
    farthest_[i] = std::max(farthest_[i], other.farthest_[i]);
  }
}

void AddSurfaceBlocks(const BoundedBlocks& active, DepthBounds* bounds) {
  AddBlocks(
      active, [](Side side) { return side != Side::kOutside; }, bounds);
}

void AddCapBlocks(const BoundedBlocks& near_inside, DepthBounds* bounds) {
  AddBlocks(
      near_inside, [](Side side) { return side == Side::kCut; }, bounds);
}

}  // namespace isoscope::visibility
