// The inner loops of ambient occlusion, over cells: squares of pixels, each represented by one of
// its pixels. Internal to core/picture.

#ifndef ISOSCOPE_CORE_PICTURE_AMBIENT_OCCLUSION_KERNEL_H_
#define ISOSCOPE_CORE_PICTURE_AMBIENT_OCCLUSION_KERNEL_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "core/base/large_pages.h"

namespace isoscope::picture {

// The depth of a cell without a surface; those of surfaces are at most 1.
inline constexpr float kNoDepth = 1e6F;

// Cells of several rows, surrounded by background. Column c is in plane c mod kPhases, at index c /
// kPhases. So the cells of one plane have the same samples, and cells at a fixed distance from
// consecutive ones are consecutive, too.
struct CellPlanes {
  static constexpr int kPhases = 4;
  static constexpr std::size_t kMaxLanes = 16;  // places are computed in multiples of it

  // Makes planes of `columns` x `rows` cells within a border of `border` cells.
  CellPlanes(int columns, int rows, int border);
  CellPlanes(const CellPlanes&) = delete;
  CellPlanes& operator=(const CellPlanes&) = delete;

  // Columns and rows count from the first cell inside the border, a multiple of kPhases in the
  // whole viewport.
  [[nodiscard]] std::size_t IndexOf(int column, int row) const {
    const auto c = static_cast<std::size_t>(column + border_columns);
    return c % kPhases * plane_size + static_cast<std::size_t>(row + border_rows) * row_size +
           c / kPhases;
  }

  int border_columns = 0;  // a multiple of kPhases
  int border_rows = 0;
  std::size_t places =
      0;  // of a plane's row that have cells inside the border: a multiple of lanes
  std::size_t row_size = 0;
  std::size_t plane_size = 0;
  std::span<float> depth;    // distance along the view axis over that of the far plane
  std::span<float> slope_x;  // its change to the next column, without jumps
  std::span<float> slope_y;  // to the next row
  std::span<float> open;     // share of the light that arrives, 0 .. 1
  std::span<float> blurred;

 private:
  base::LargePageVector<float> values_;  // all of them, because that takes fewer pages
};

// The parameters that all cells share. Lengths are in drawn pixels.
struct OcclusionSetup {
  bool is_perspective = true;
  float pixel_size = 0;  // of a pixel, in units of depth: at depth 1 for perspective
  float cell_px = 2;
  float radius_px = 1;
  // A depth that is farther off a tangent plane belongs to another surface.
  float jump_px = 1;
};

struct OcclusionSample {
  std::ptrdiff_t step = 0;  // from a place of plane 0 to the sample's place
  float x_px = 0;
  float y_px = 0;
};
inline constexpr std::size_t kOcclusionSamples = 16;
using OcclusionSamples = std::array<OcclusionSample, kOcclusionSamples>;

// Sets `open` and the slopes of the cells of one row and phase.
//
// x_px, y_px: of the pixel of the first of these cells, from the middle of the viewport
void ComputeOcclusion(const OcclusionSetup& setup, const OcclusionSamples& samples, float x_px,
                      float y_px, int row, int phase, CellPlanes* cells);

// Sets `blurred` of the cells of one row and phase to the mean of `open` of 5 cells in the row,
// without those behind a jump; and then `open` to that of `blurred` of 5 cells in the column.
void BlurAlongRow(const OcclusionSetup& setup, int row, int phase, CellPlanes* cells);
void BlurAlongColumn(const OcclusionSetup& setup, int row, int phase, CellPlanes* cells);

// A tile of pixels, each between 4 cells.
struct OcclusionTile {
  static constexpr std::size_t kSidePx = 16;

  // For a column of pixels: its cells to the left and to the right, as the distance of their
  // indices from those of column 0, and its place between the two, in [0, 1).
  std::array<std::int32_t, kSidePx> left;
  std::array<std::int32_t, kSidePx> right;
  std::array<float, kSidePx> x;
  // For a row of pixels: the index of column 0 of the cells above and below, and its place.
  std::array<std::size_t, kSidePx> above;
  std::array<std::size_t, kSidePx> below;
  std::array<float, kSidePx> y;

  std::array<float, kSidePx * kSidePx> depth;  // kNoDepth: no pixel to compute
  std::array<float, kSidePx * kSidePx> open;   // the result; 1 where there is no pixel
};

// Sets how open the pixels of a tile are: the mean of the 4 cells around each, by their distance
// and by how far the pixel is from the cell's tangent plane. A pixel behind jumps of all 4 takes
// the nearest in depth.
void ComputeOpenPixels(const OcclusionSetup& setup, const CellPlanes& cells, OcclusionTile* tile);

}  // namespace isoscope::picture

#endif  // ISOSCOPE_CORE_PICTURE_AMBIENT_OCCLUSION_KERNEL_H_
