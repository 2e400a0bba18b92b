// Occlusion changes slowly, so it is computed for cells of 2 x 2 pixels of the final picture:
//
//   1. Each cell takes the depth of one of its pixels. Cells are counted from the corner of the
//      whole viewport, so a region has the whole's cells.
//   2. The kernel computes how open each cell is, from 16 cells around it, and blurs that over
//      5 x 5 cells without crossing jumps in depth.
//   3. A pixel takes the mean of those of the 4 cells around it that are on its surface. Weights
//      are the distance of the cell, and the distance of the pixel from the cell's tangent plane. A
//      pixel on no cell's surface takes the cell nearest in depth.
//   4. The pixel's colour is darkened in linear light.

#include "core/picture/ambient_occlusion.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/image/fragment.h"
#include "core/image/tile_set.h"
#include "core/picture/ambient_occlusion_kernel.h"
#include "core/picture/linear_light.h"
#include "core/view/unprojection.h"

namespace isoscope::picture {
namespace {

constexpr int kPhases = CellPlanes::kPhases;
constexpr int kPixelsPerCell = 2;  // of the final picture, on each axis
constexpr int kBlurCells = 3;      // the blur and the cells around a pixel
constexpr int kRowsPerTask = 16;
constexpr float kJumpShare = 1.0F / 8;  // of the radius
constexpr float kLeastJumpPx = 1.5F;
static_assert(OcclusionTile::kSidePx == image::TileSet::kTilePx);

int FloorDivide(int value, int divisor) {
  return value >= 0 ? value / divisor : -((-value + divisor - 1) / divisor);
}

// A point of the unit circle at `step` of 256 steps, with the same bits on every machine.
struct Direction {
  double x = 1;
  double y = 0;
};
std::array<Direction, 256> MakeDirections() {
  constexpr Direction kStep{0.99969881869620422, 0.024541228522912288};  // 1/256 of a turn
  std::array<Direction, 256> directions;
  for (std::size_t i = 1; i < directions.size(); ++i) {
    const Direction& last = directions[i - 1];
    directions[i] = {last.x * kStep.x - last.y * kStep.y, last.x * kStep.y + last.y * kStep.x};
  }
  return directions;
}

// Returns the samples of the cells of one column and row mod kPhases: a spiral from the centre to
// the radius. Each of the 16 sets is turned by 1/16 of a turn, and moved along by 1/16 of a step.
OcclusionSamples MakeSamples(const OcclusionSetup& setup, int phase_x, int phase_y,
                             const CellPlanes& cells) {
  // An ordered dither, so that neighbours differ much.
  constexpr std::array<std::array<unsigned, kPhases>, kPhases> kTurns{
      {{0, 8, 2, 10}, {12, 4, 14, 6}, {3, 11, 1, 9}, {15, 7, 13, 5}}};
  constexpr unsigned kGoldenStep = 98;  // of 256: about the golden angle
  static const std::array<Direction, 256> directions = MakeDirections();
  const unsigned turn =
      kTurns[static_cast<std::size_t>(phase_y)][static_cast<std::size_t>(phase_x)];
  const double shift = ((turn * 7 + 3) % 16 + 0.5) / 16;
  const double radius = static_cast<double>(setup.radius_px) / static_cast<double>(setup.cell_px);
  OcclusionSamples samples;
  for (std::size_t k = 0; k < kOcclusionSamples; ++k) {
    const Direction& direction = directions[(k * kGoldenStep + turn * 16) % 256];
    const double length =
        1 + (radius - 1) * (static_cast<double>(k) + shift) / double{kOcclusionSamples};
    const auto x = static_cast<int>(std::lround(length * direction.x));
    const auto y = static_cast<int>(std::lround(length * direction.y));
    samples[k] = {.step = static_cast<std::ptrdiff_t>(cells.IndexOf(phase_x + x, y)) -
                          static_cast<std::ptrdiff_t>(cells.IndexOf(0, 0)),
                  .x_px = static_cast<float>(x) * setup.cell_px,
                  .y_px = static_cast<float>(y) * setup.cell_px};
  }
  return samples;
}

// The cells of an image, and how open they are.
class OpenCells {
 public:
  // `drawn`: a rectangle of the image outside which all is background.
  OpenCells(const frame::AmbientOcclusion& occlusion, const view::View& view, int samples_per_side,
            const image::FrameImage& image, const view::PixelRect& drawn)
      : view_(view),
        unprojection_(view),
        image_(image),
        far_(static_cast<float>(view.far_distance())),
        cell_px_(kPixelsPerCell * samples_per_side),
        first_column_(FirstCell(view.region().x + drawn.begin_x)),
        first_row_(FirstCell(view.region().y + drawn.begin_y)),
        columns_(FloorDivide(view.region().x + drawn.end_x, cell_px_) + kBlurCells - first_column_),
        rows_(FloorDivide(view.region().y + drawn.end_y, cell_px_) + kBlurCells - first_row_),
        cells_(columns_, rows_, occlusion.radius_px / kPixelsPerCell + kBlurCells) {
    const view::ImagePlane& plane = view.image_plane();
    const double height = 2 * plane.half_height / (plane.is_perspective ? 1 : view.far_distance());
    setup_ = {
        .is_perspective = plane.is_perspective,
        .pixel_size = static_cast<float>(height / view.viewport().height_px),
        .cell_px = static_cast<float>(cell_px_),
        .radius_px = static_cast<float>(occlusion.radius_px * samples_per_side),
        .jump_px = std::max(kJumpShare * static_cast<float>(occlusion.radius_px), kLeastJumpPx) *
                   static_cast<float>(samples_per_side)};
  }

  void Compute() {
    ForEachRow([&](int row) { FillDepths(row); });
    std::array<std::array<OcclusionSamples, kPhases>, kPhases> samples;
    for (int y = 0; y < kPhases; ++y) {
      for (int x = 0; x < kPhases; ++x) {
        samples[static_cast<std::size_t>(y)][static_cast<std::size_t>(x)] =
            MakeSamples(setup_, x, y, cells_);
      }
    }
    ForEachRow([&](int row) {
      for (int phase = 0; phase < kPhases; ++phase) {
        // First columns and rows are multiples of kPhases.
        ComputeOcclusion(
            setup_,
            samples[static_cast<std::size_t>(row % kPhases)][static_cast<std::size_t>(phase)],
            FromMiddle(first_column_ + phase, view_.viewport().width_px),
            FromMiddle(first_row_ + row, view_.viewport().height_px), row, phase, &cells_);
      }
    });
    ForEachRow([&](int row) {
      for (int phase = 0; phase < kPhases; ++phase) {
        BlurAlongRow(setup_, row, phase, &cells_);
      }
    });
    ForEachRow([&](int row) {
      for (int phase = 0; phase < kPhases; ++phase) {
        BlurAlongColumn(setup_, row, phase, &cells_);
      }
    });
  }

  // Computes how open the pixels of a tile of the image are. False if all of them are, or none lies
  // on a surface; then the tile is not set.
  bool ComputeTile(int column, int row, OcclusionTile* tile) const {
    constexpr int kTilePx = image::TileSet::kTilePx;
    const int begin_x = column * kTilePx;
    const int begin_y = row * kTilePx;
    const int end_x = std::min(begin_x + kTilePx, image_.width);
    const int end_y = std::min(begin_y + kTilePx, image_.height);
    // Pixels beyond the image take the cells of the last one.
    const Place last_x = PlaceOf(view_.region().x + end_x - 1, first_column_);
    const Place last_y = PlaceOf(view_.region().y + end_y - 1, first_row_);
    if (IsOpen(PlaceOf(view_.region().x + begin_x, first_column_).cell,
               PlaceOf(view_.region().y + begin_y, first_row_).cell, last_x.cell + 1,
               last_y.cell + 1)) {
      return false;
    }
    const std::size_t origin = cells_.IndexOf(0, 0);
    for (std::size_t i = 0; i < OcclusionTile::kSidePx; ++i) {
      const int x = std::min(begin_x + static_cast<int>(i), end_x - 1);
      const Place place = PlaceOf(view_.region().x + x, first_column_);
      tile->left[i] = static_cast<std::int32_t>(cells_.IndexOf(place.cell, 0) - origin);
      tile->right[i] = static_cast<std::int32_t>(cells_.IndexOf(place.cell + 1, 0) - origin);
      tile->x[i] = place.between;
      const int y = std::min(begin_y + static_cast<int>(i), end_y - 1);
      const Place row_place = PlaceOf(view_.region().y + y, first_row_);
      tile->above[i] = cells_.IndexOf(0, row_place.cell);
      tile->below[i] = cells_.IndexOf(0, row_place.cell + 1);
      tile->y[i] = row_place.between;
    }
    tile->depth.fill(kNoDepth);
    for (int y = begin_y; y < end_y; ++y) {
      const std::uint64_t* const keys = image_.keys.data() + image_.IndexOf(begin_x, y);
      float* const depths =
          tile->depth.data() + static_cast<std::size_t>(y - begin_y) * OcclusionTile::kSidePx;
      for (int x = 0; x < end_x - begin_x; ++x) {
        // Without branches, so that compilers turn it into SIMD.
        const float depth = DepthOf(keys[x]);
        depths[x] = image::OwnerOf(keys[x]) == image::kNoOwner ? kNoDepth : depth;
      }
    }
    ComputeOpenPixels(setup_, cells_, tile);
    return true;
  }

 private:
  // The position of a pixel on an axis, between `cell` and the next one.
  struct Place {
    int cell = 0;
    float between = 0;  // [0, 1)
  };

  // Returns the place of pixel `whole_px` of the viewport.
  [[nodiscard]] Place PlaceOf(int whole_px, int first_cell) const {
    const int from_middle = whole_px - cell_px_ / 2;
    const int cell = FloorDivide(from_middle, cell_px_);
    return {cell - first_cell, static_cast<float>(from_middle - cell * cell_px_) / setup_.cell_px};
  }

  // Whether all cells of [begin_column, end_column] x [begin_row, end_row] are open.
  [[nodiscard]] bool IsOpen(int begin_column, int begin_row, int end_column, int end_row) const {
    for (int row = begin_row; row <= end_row; ++row) {
      for (int column = begin_column; column <= end_column; ++column) {
        if (cells_.open[cells_.IndexOf(column, row)] < 1) {
          return false;
        }
      }
    }
    return true;
  }

  template <typename Fn>
  void ForEachRow(const Fn& fn) const {
    tbb::parallel_for(tbb::blocked_range<int>(0, rows_, kRowsPerTask),
                      [&](const tbb::blocked_range<int>& rows) {
                        for (int row = rows.begin(); row < rows.end(); ++row) {
                          fn(row);
                        }
                      });
  }

  // Returns a cell of the whole, a multiple of kPhases, with those around pixel `whole_px`.
  [[nodiscard]] int FirstCell(int whole_px) const {
    return FloorDivide(FloorDivide(whole_px, cell_px_) - kBlurCells, kPhases) * kPhases;
  }

  // The centre of a cell's pixel, in pixels from the middle of a side of the whole. Exact.
  [[nodiscard]] float FromMiddle(int cell, int side_px) const {
    return static_cast<float>(cell * cell_px_ + cell_px_ / 2) + 0.5F -
           0.5F * static_cast<float>(side_px);
  }

  // Returns the depth of a pixel; any depth for the background.
  [[nodiscard]] float DepthOf(std::uint64_t key) const {
    return unprojection_.DistanceOf(image::DepthOf(key)) / far_;
  }

  void FillDepths(int row) {
    const int y = (first_row_ + row) * cell_px_ + cell_px_ / 2 - view_.region().y;
    if (y < 0 || y >= image_.height) {
      return;
    }
    for (int column = 0; column < columns_; ++column) {
      const int x = (first_column_ + column) * cell_px_ + cell_px_ / 2 - view_.region().x;
      if (x < 0 || x >= image_.width) {
        continue;
      }
      const std::uint64_t key = image_.keys[image_.IndexOf(x, y)];
      if (image::OwnerOf(key) != image::kNoOwner) {
        cells_.depth[cells_.IndexOf(column, row)] = DepthOf(key);
      }
    }
  }

  const view::View& view_;
  const view::Unprojection unprojection_;
  const image::FrameImage& image_;
  const float far_;
  const int cell_px_;       // drawn pixels of a cell, on each axis
  const int first_column_;  // of the whole's cells; multiples of kPhases
  const int first_row_;
  const int columns_;
  const int rows_;
  OcclusionSetup setup_;
  CellPlanes cells_;
};

// Returns the smallest rectangle of tiles that were drawn on, cut to the image.
view::PixelRect DrawnRect(const image::FrameImage& image) {
  constexpr int kTilePx = image::TileSet::kTilePx;
  view::PixelRect rect{image.width, image.height, 0, 0};
  for (int row = 0; row < image.touched.rows(); ++row) {
    image.touched.ForEachInRow(row, [&](int column) {
      rect.begin_x = std::min(rect.begin_x, column * kTilePx);
      rect.begin_y = std::min(rect.begin_y, row * kTilePx);
      rect.end_x = std::max(rect.end_x, std::min((column + 1) * kTilePx, image.width));
      rect.end_y = std::max(rect.end_y, std::min((row + 1) * kTilePx, image.height));
    });
  }
  return rect;
}

// Multiplies the light of the pixels of a tile.
void DarkenTile(const OcclusionTile& tile, float strength, int column, int row,
                image::FrameImage* image) {
  constexpr int kTilePx = image::TileSet::kTilePx;
  const LinearLightTables& tables = LinearLight();
  const int columns = std::min(kTilePx, image->width - column * kTilePx);
  const int rows = std::min(kTilePx, image->height - row * kTilePx);
  for (int y = 0; y < rows; ++y) {
    image::Rgba8* const colors =
        image->colors.data() + image->IndexOf(column * kTilePx, row * kTilePx + y);
    const float* const open =
        tile.open.data() + static_cast<std::size_t>(y) * OcclusionTile::kSidePx;
    for (int x = 0; x < columns; ++x) {
      if (open[x] == 1) {
        continue;
      }
      const auto share =
          static_cast<std::uint32_t>((1 - strength * (1 - open[x])) * 65536.0F + 0.5F);
      const auto darken = [&](std::uint8_t value) {
        // At most 65535 * 65536 and a half of it: 32 bits.
        return tables.srgb[(tables.light[value] * share + 32768) >> 16];
      };
      colors[x].r = darken(colors[x].r);
      colors[x].g = darken(colors[x].g);
      colors[x].b = darken(colors[x].b);
    }
  }
}

}  // namespace

void ShadeAmbientOcclusion(const frame::AmbientOcclusion& occlusion, const view::View& view,
                           int samples_per_side, image::FrameImage* image) {
  const view::PixelRect drawn = DrawnRect(*image);
  if (drawn.empty()) {
    return;
  }
  OpenCells cells(occlusion, view, samples_per_side, *image, drawn);
  cells.Compute();
  tbb::parallel_for(0, image->touched.rows(), [&](int row) {
    OcclusionTile tile;
    image->touched.ForEachInRow(row, [&](int column) {
      if (cells.ComputeTile(column, row, &tile)) {
        DarkenTile(tile, occlusion.strength, column, row, image);
      }
    });
  });
}

}  // namespace isoscope::picture
