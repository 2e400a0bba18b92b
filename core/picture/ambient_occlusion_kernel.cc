// For a cell with depth d, with all lengths in pixels at that depth:
//
//   1. The surface's tangents to the right and downward are the differences to the neighbour that
//      is nearer in depth, on each axis; flat if both lie behind a jump. Their product is the
//      normal.
//   2. Each sample is a cell at a fixed offset: v from this cell's point to that one's. It occludes
//      by its height over the tangent plane, cos(v, normal) - kBias, times a falloff with distance,
//      1 - |v|^2 / radius^2. Negative factors count as 0.
//   3. The open share is 1 - kGain times the mean over the samples, at least 0.
//
// The offsets of a cell depend on its column and row mod 4. Every window of 4 x 4 cells has all 16
// sets. The weights of the blur, 1/2, 1, 1, 1, 1/2, count each column mod 4 once, so no set shows.
//
// Invariant: the same operations in the same order for each cell, in float32 without contraction;
// lanes are independent. So instruction sets give the same bits.

#include "core/picture/ambient_occlusion_kernel.h"

#include <algorithm>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/picture/ambient_occlusion_kernel.cc"
#include "hwy/foreach_target.h"  // IWYU pragma: keep
//
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::picture {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using F32 = hn::CappedTag<float, CellPlanes::kMaxLanes>;
using Lanes = hn::Vec<F32>;

constexpr float kBias = 0.22F;
constexpr float kGain = 8.0F;
constexpr float kLeastPixel = 1e-12F;

struct Vector {
  Lanes x;
  Lanes y;
  Lanes z;
};

HWY_INLINE Lanes Dot(const Vector& a, const Vector& b) {
  return hn::Add(hn::Add(hn::Mul(a.x, b.x), hn::Mul(a.y, b.y)), hn::Mul(a.z, b.z));
}

// The point of a cell, as the origin of its samples.
struct Origin {
  Lanes depth;
  Lanes x_px;
  Lanes y_px;
  Lanes inverse_depth;  // perspective
  Lanes inverse_pixel;
};

HWY_INLINE Lanes PixelAt(const OcclusionSetup& setup, Lanes depth) {
  const F32 d;
  const Lanes size = hn::Set(d, setup.pixel_size);
  return hn::Max(setup.is_perspective ? hn::Mul(size, depth) : size, hn::Set(d, kLeastPixel));
}

// Returns the vector from the origin to the point of `depth` that is seen `x_px` to the right and
// `y_px` below.
HWY_INLINE Vector WayTo(const OcclusionSetup& setup, const Origin& origin, Lanes depth, Lanes x_px,
                        Lanes y_px) {
  const Lanes z = hn::Mul(hn::Sub(depth, origin.depth), origin.inverse_pixel);
  if (!setup.is_perspective) {
    return {x_px, y_px, z};
  }
  const Lanes growth = hn::Mul(depth, origin.inverse_depth);
  return {hn::Sub(hn::Mul(hn::Add(origin.x_px, x_px), growth), origin.x_px),
          hn::Sub(hn::Mul(hn::Add(origin.y_px, y_px), growth), origin.y_px), z};
}

// Returns the tangent towards larger columns or rows: along x if `x_step` is not 0, else along y.
// Sets `slope` to the change of depth on it.
HWY_INLINE Vector TangentOf(const OcclusionSetup& setup, const Origin& origin, Lanes before,
                            Lanes after, float x_step, float y_step, Lanes* slope) {
  const F32 d;
  const Lanes zero = hn::Zero(d);
  const Lanes x = hn::Set(d, x_step);
  const Lanes y = hn::Set(d, y_step);
  const Lanes fall_after = hn::Sub(after, origin.depth);
  const Lanes fall_before = hn::Sub(origin.depth, before);
  const auto is_after = hn::Le(hn::Abs(fall_after), hn::Abs(fall_before));
  const Vector to_after = WayTo(setup, origin, after, x, y);
  const Vector to_before = WayTo(setup, origin, before, hn::Neg(x), hn::Neg(y));
  const Lanes fall = hn::IfThenElse(is_after, fall_after, fall_before);
  const auto is_flat =
      hn::Ge(hn::Mul(hn::Abs(fall), origin.inverse_pixel), hn::Set(d, setup.radius_px));
  *slope = hn::IfThenElse(is_flat, zero, fall);
  const auto choose = [&](Lanes a, Lanes b, Lanes flat) HWY_ATTR {
    return hn::IfThenElse(is_flat, flat, hn::IfThenElse(is_after, a, hn::Neg(b)));
  };
  return {choose(to_after.x, to_before.x, x), choose(to_after.y, to_before.y, y),
          choose(to_after.z, to_before.z, zero)};
}

// Returns the unit normal towards the eye of the plane of two tangents.
HWY_INLINE Vector NormalOf(const Vector& right, const Vector& down) {
  const F32 d;
  const Vector normal{hn::Sub(hn::Mul(down.y, right.z), hn::Mul(down.z, right.y)),
                      hn::Sub(hn::Mul(down.z, right.x), hn::Mul(down.x, right.z)),
                      hn::Sub(hn::Mul(down.x, right.y), hn::Mul(down.y, right.x))};
  const Lanes length = hn::Sqrt(hn::Max(Dot(normal, normal), hn::Set(d, 1e-30F)));
  const Lanes inverse = hn::Div(hn::Set(d, 1.0F), length);
  return {hn::Mul(normal.x, inverse), hn::Mul(normal.y, inverse), hn::Mul(normal.z, inverse)};
}

// Returns the offset of the cell at a distance of columns and rows, from a cell of plane 0 in the
// row.
std::ptrdiff_t StepTo(const CellPlanes& cells, int phase, int columns, int rows) {
  return static_cast<std::ptrdiff_t>(cells.IndexOf(phase + columns, rows)) -
         static_cast<std::ptrdiff_t>(cells.IndexOf(0, 0));
}

void ComputeOcclusion(const OcclusionSetup& setup, const OcclusionSamples& samples, float x_px,
                      float y_px, int row, int phase, CellPlanes* cells) {
  const F32 d;
  const Lanes zero = hn::Zero(d);
  const Lanes one = hn::Set(d, 1.0F);
  const Lanes none = hn::Set(d, kNoDepth);
  const Lanes least = hn::Set(d, 1e-30F);
  const Lanes bias = hn::Set(d, kBias);
  const Lanes per_sample = hn::Set(d, kGain / static_cast<float>(kOcclusionSamples));
  const Lanes inverse_radius_squared = hn::Set(d, 1.0F / (setup.radius_px * setup.radius_px));
  const float place_px = setup.cell_px * static_cast<float>(CellPlanes::kPhases);
  const float* const base = cells->depth.data() + cells->IndexOf(0, row);
  const std::size_t begin = cells->IndexOf(phase, row);
  const std::ptrdiff_t here = StepTo(*cells, phase, 0, 0);
  const std::ptrdiff_t left = StepTo(*cells, phase, -1, 0);
  const std::ptrdiff_t right = StepTo(*cells, phase, 1, 0);
  const std::ptrdiff_t above = StepTo(*cells, phase, 0, -1);
  const std::ptrdiff_t below = StepTo(*cells, phase, 0, 1);
  for (std::size_t i = 0; i < cells->places; i += hn::Lanes(d)) {
    const float* const at = base + i;
    Origin origin;
    origin.depth = hn::LoadU(d, at + here);
    const auto is_surface = hn::Lt(origin.depth, none);
    if (hn::AllFalse(d, is_surface)) {
      hn::StoreU(one, d, cells->open.data() + begin + i);
      hn::StoreU(zero, d, cells->slope_x.data() + begin + i);
      hn::StoreU(zero, d, cells->slope_y.data() + begin + i);
      continue;
    }
    origin.x_px = hn::Add(hn::Set(d, x_px),
                          hn::Mul(hn::Set(d, place_px), hn::Iota(d, static_cast<float>(i))));
    origin.y_px = hn::Set(d, y_px);
    origin.inverse_depth = hn::Div(one, hn::Max(origin.depth, least));
    origin.inverse_pixel = hn::Div(one, PixelAt(setup, origin.depth));
    Lanes slope_x;
    Lanes slope_y;
    const Vector across = TangentOf(setup, origin, hn::LoadU(d, at + left),
                                    hn::LoadU(d, at + right), setup.cell_px, 0, &slope_x);
    const Vector down = TangentOf(setup, origin, hn::LoadU(d, at + above), hn::LoadU(d, at + below),
                                  0, setup.cell_px, &slope_y);
    const Vector normal = NormalOf(across, down);
    Lanes hidden = zero;
    for (const OcclusionSample& sample : samples) {
      const Vector way = WayTo(setup, origin, hn::LoadU(d, at + sample.step),
                               hn::Set(d, sample.x_px), hn::Set(d, sample.y_px));
      const Lanes squared = hn::Max(Dot(way, way), least);
      const Lanes rise = hn::Sub(hn::Div(Dot(way, normal), hn::Sqrt(squared)), bias);
      const Lanes near = hn::Sub(one, hn::Mul(squared, inverse_radius_squared));
      hidden = hn::Add(hidden, hn::Mul(hn::Max(rise, zero), hn::Max(near, zero)));
    }
    const Lanes open = hn::Max(hn::Sub(one, hn::Mul(hidden, per_sample)), zero);
    hn::StoreU(hn::IfThenElse(is_surface, open, one), d, cells->open.data() + begin + i);
    hn::StoreU(slope_x, d, cells->slope_x.data() + begin + i);
    hn::StoreU(slope_y, d, cells->slope_y.data() + begin + i);
  }
}

// Sets to[i] to the mean of `from` at `steps` and at place i itself.
HWY_INLINE void Blur(const OcclusionSetup& setup, const std::ptrdiff_t (&steps)[4],
                     const float* depth, const float* slope, const float* from, std::ptrdiff_t here,
                     std::size_t places, float* to) {
  const F32 d;
  const Lanes zero = hn::Zero(d);
  const Lanes one = hn::Set(d, 1.0F);
  constexpr float kDistances[4] = {-2, -1, 1, 2};
  constexpr float kWeights[4] = {0.5F, 1, 1, 0.5F};
  const Lanes jump_px = hn::Set(d, setup.jump_px);
  for (std::size_t i = 0; i < places; i += hn::Lanes(d)) {
    const Lanes center = hn::LoadU(d, depth + i + here);
    const Lanes own_slope = hn::LoadU(d, slope + i);
    const Lanes inverse_jump = hn::Div(one, hn::Mul(jump_px, PixelAt(setup, center)));
    Lanes sum = hn::LoadU(d, from + i + here);
    Lanes weights = one;
    for (std::size_t k = 0; k < 4; ++k) {
      const Lanes expected = hn::Add(center, hn::Mul(own_slope, hn::Set(d, kDistances[k])));
      const Lanes off = hn::Abs(hn::Sub(hn::LoadU(d, depth + i + steps[k]), expected));
      const Lanes weight =
          hn::Mul(hn::Set(d, kWeights[k]), hn::Max(hn::Sub(one, hn::Mul(off, inverse_jump)), zero));
      sum = hn::Add(sum, hn::Mul(weight, hn::LoadU(d, from + i + steps[k])));
      weights = hn::Add(weights, weight);
    }
    hn::StoreU(hn::Div(sum, weights), d, to + i);
  }
}

void BlurAlongRow(const OcclusionSetup& setup, int row, int phase, CellPlanes* cells) {
  const std::size_t base = cells->IndexOf(0, row);
  const std::size_t begin = cells->IndexOf(phase, row);
  const std::ptrdiff_t steps[4] = {StepTo(*cells, phase, -2, 0), StepTo(*cells, phase, -1, 0),
                                   StepTo(*cells, phase, 1, 0), StepTo(*cells, phase, 2, 0)};
  Blur(setup, steps, cells->depth.data() + base, cells->slope_x.data() + begin,
       cells->open.data() + base, StepTo(*cells, phase, 0, 0), cells->places,
       cells->blurred.data() + begin);
}

void BlurAlongColumn(const OcclusionSetup& setup, int row, int phase, CellPlanes* cells) {
  const std::size_t base = cells->IndexOf(0, row);
  const std::size_t begin = cells->IndexOf(phase, row);
  const std::ptrdiff_t steps[4] = {StepTo(*cells, phase, 0, -2), StepTo(*cells, phase, 0, -1),
                                   StepTo(*cells, phase, 0, 1), StepTo(*cells, phase, 0, 2)};
  Blur(setup, steps, cells->depth.data() + base, cells->slope_y.data() + begin,
       cells->blurred.data() + base, StepTo(*cells, phase, 0, 0), cells->places,
       cells->open.data() + begin);
}

// One of the 4 cells around each pixel of a vector. k: bit 0 is set for the right ones, bit 1 for
// the lower ones.
template <std::size_t kCorner>
HWY_INLINE void AddCorner(const CellPlanes& cells, const OcclusionTile& tile, std::size_t row,
                          std::size_t column, Lanes depth, Lanes inverse_jump, Lanes* sum,
                          Lanes* weights, Lanes* least_off, Lanes* nearest_open) {
  const F32 d;
  const hn::RebindToSigned<F32> di;
  constexpr bool kIsRight = (kCorner & 1) != 0;
  constexpr bool kIsBelow = (kCorner & 2) != 0;
  const Lanes one = hn::Set(d, 1.0F);
  const auto step = hn::LoadU(di, (kIsRight ? tile.right : tile.left).data() + column);
  const std::size_t base = (kIsBelow ? tile.below : tile.above)[row];
  const Lanes x = hn::LoadU(d, tile.x.data() + column);
  const Lanes y = hn::Set(d, tile.y[row]);
  const Lanes cell_depth = hn::GatherIndex(d, cells.depth.data() + base, step);
  const Lanes slope_x = hn::GatherIndex(d, cells.slope_x.data() + base, step);
  const Lanes slope_y = hn::GatherIndex(d, cells.slope_y.data() + base, step);
  const Lanes open = hn::GatherIndex(d, cells.open.data() + base, step);
  const Lanes expected =
      hn::Add(hn::Add(cell_depth, hn::Mul(slope_x, kIsRight ? hn::Sub(x, one) : x)),
              hn::Mul(slope_y, kIsBelow ? hn::Sub(y, one) : y));
  const Lanes off = hn::Abs(hn::Sub(expected, depth));
  const Lanes nearness = hn::Mul(kIsRight ? x : hn::Sub(one, x), kIsBelow ? y : hn::Sub(one, y));
  const Lanes weight =
      hn::Mul(nearness, hn::Max(hn::Sub(one, hn::Mul(off, inverse_jump)), hn::Zero(d)));
  *sum = hn::Add(*sum, hn::Mul(weight, open));
  *weights = hn::Add(*weights, weight);
  *nearest_open = hn::IfThenElse(hn::Lt(off, *least_off), open, *nearest_open);
  *least_off = hn::Min(off, *least_off);
}

void ComputeOpenPixels(const OcclusionSetup& setup, const CellPlanes& cells, OcclusionTile* tile) {
  const hn::CappedTag<float, OcclusionTile::kSidePx> d;
  const Lanes one = hn::Set(d, 1.0F);
  const Lanes none = hn::Set(d, kNoDepth);
  const Lanes least_weight = hn::Set(d, 1e-3F);
  const Lanes jump_px = hn::Set(d, setup.jump_px);
  for (std::size_t row = 0; row < OcclusionTile::kSidePx; ++row) {
    for (std::size_t column = 0; column < OcclusionTile::kSidePx; column += hn::Lanes(d)) {
      const std::size_t i = row * OcclusionTile::kSidePx + column;
      const Lanes depth = hn::LoadU(d, tile->depth.data() + i);
      const auto is_pixel = hn::Lt(depth, none);
      Lanes open = one;
      if (!hn::AllFalse(d, is_pixel)) {
        const Lanes inverse_jump = hn::Div(one, hn::Mul(jump_px, PixelAt(setup, depth)));
        Lanes sum = hn::Zero(d);
        Lanes weights = hn::Zero(d);
        Lanes least_off = hn::Set(d, kNoDepth / 2);  // cells of the background are farther off
        Lanes nearest = one;
        AddCorner<0>(cells, *tile, row, column, depth, inverse_jump, &sum, &weights, &least_off,
                     &nearest);
        AddCorner<1>(cells, *tile, row, column, depth, inverse_jump, &sum, &weights, &least_off,
                     &nearest);
        AddCorner<2>(cells, *tile, row, column, depth, inverse_jump, &sum, &weights, &least_off,
                     &nearest);
        AddCorner<3>(cells, *tile, row, column, depth, inverse_jump, &sum, &weights, &least_off,
                     &nearest);
        const Lanes mean = hn::Div(sum, hn::Max(weights, least_weight));
        open = hn::IfThenElse(hn::Gt(weights, least_weight), mean, nearest);
        open = hn::IfThenElse(is_pixel, open, one);
      }
      hn::StoreU(open, d, tile->open.data() + i);
    }
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace isoscope::picture
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isoscope::picture {
namespace {
HWY_EXPORT(ComputeOcclusion);
HWY_EXPORT(BlurAlongRow);
HWY_EXPORT(BlurAlongColumn);
HWY_EXPORT(ComputeOpenPixels);
}  // namespace

CellPlanes::CellPlanes(int columns, int rows, int border)
    : border_columns((border + kPhases - 1) / kPhases * kPhases), border_rows(border) {
  const auto round_up = [](std::size_t value) {
    return (value + kMaxLanes - 1) / kMaxLanes * kMaxLanes;
  };
  places = round_up((static_cast<std::size_t>(columns) + kPhases - 1) / kPhases);
  row_size = round_up(places + 2 * static_cast<std::size_t>(border_columns) / kPhases) + kMaxLanes;
  plane_size = row_size * static_cast<std::size_t>(rows + 2 * border_rows);
  const std::size_t size = plane_size * kPhases;
  values_.resize(5 * size);
  float* next = values_.data();
  for (std::span<float>* plane : {&depth, &slope_x, &slope_y, &open, &blurred}) {
    *plane = std::span<float>(next, size);
    next += size;
  }
  std::fill(depth.begin(), depth.end(), kNoDepth);
  std::fill(open.begin(), open.end(), 1.0F);
  std::fill(blurred.begin(), blurred.end(), 1.0F);
}

void ComputeOcclusion(const OcclusionSetup& setup, const OcclusionSamples& samples, float x_px,
                      float y_px, int row, int phase, CellPlanes* cells) {
  HWY_DYNAMIC_DISPATCH(ComputeOcclusion)(setup, samples, x_px, y_px, row, phase, cells);
}

void BlurAlongRow(const OcclusionSetup& setup, int row, int phase, CellPlanes* cells) {
  HWY_DYNAMIC_DISPATCH(BlurAlongRow)(setup, row, phase, cells);
}

void BlurAlongColumn(const OcclusionSetup& setup, int row, int phase, CellPlanes* cells) {
  HWY_DYNAMIC_DISPATCH(BlurAlongColumn)(setup, row, phase, cells);
}

void ComputeOpenPixels(const OcclusionSetup& setup, const CellPlanes& cells, OcclusionTile* tile) {
  HWY_DYNAMIC_DISPATCH(ComputeOpenPixels)(setup, cells, tile);
}

}  // namespace isoscope::picture
#endif  // HWY_ONCE
