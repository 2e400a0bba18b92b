// Computes the footprints of View (view.h), for as many boxes at a time as a register has doubles:
//
//   1. Project: clip coordinates x, y, z, w of the 8 corners, and the bound of the error that a
//      float32 renderer makes in each: kClipError * (|m0| reach0 + |m1| reach1 + |m2| reach2 +
//      |m3|).
//   2. The whole picture if an error is above kMaxClipError, or NaN. Outside if all corners are
//      outside one plane of the frustum by more than the error: the planes are linear, so the
//      corners decide, whatever the sign of w. The whole picture if a corner may lie in front of
//      the near plane, where a renderer clips, or has w < kMinClipW within the error.
//   3. Divide by w. The margin in pixels is half the viewport times ((error + reach * w's error) /
//      w + kViewportError * (reach + 1)), plus kSnapErrorPx. The whole picture if it exceeds
//      kMaxMarginPx.
//   4. CoverPixels: the pixels whose centres lie in the box's extent, grown by the margin.
//
// Invariant: one box and many, and all instruction sets, have the same operations in the same
// order, and so the same bits.
//
// Example: 1024 pixels wide, x / w from -0.25 to 0, margin 1/16. The extent is 512 * 0.75 = 384 to
// 512 pixels; the centre 383.5 is 7/16 too far to the left, so the columns are [384, 512).
//
// Derivation of the bounds: docs/numerics.md, "How far float32 can move a vertex".

#include "core/view/footprint_kernel.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/view/footprint_kernel.cc"
#include "hwy/foreach_target.h"  // IWYU pragma: keep
//
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::view {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using F64 = hn::CappedTag<double, FootprintBatch::kMultiple>;
using Lanes = hn::Vec<F64>;

// The least and the greatest value over the 8 corners of each box.
struct Range {
  Lanes min;
  Lanes max;
};

// Returns the range of value(corner).
template <typename Value>
HWY_INLINE Range RangeOf(const Value& value) {
  Range range{value(0), value(0)};
  for (std::size_t corner = 1; corner < 8; ++corner) {
    const Lanes v = value(corner);
    range.min = hn::Min(v, range.min);
    range.max = hn::Max(v, range.max);
  }
  return range;
}

// One clip coordinate of the corners of a box, and the bound of its float32 error.
struct Row {
  Lanes corners[8];
  Lanes error;
};

// Step 1 transforms the 8 corners by one row of the matrix. A corner's coordinate is one of two
// values on each axis, so 6 products make all 8.
HWY_INLINE void Project(const math::Mat4d& m, std::size_t row, const Lanes (&min)[3],
                        const Lanes (&max)[3], const Lanes (&reach)[3], Row* out) {
  const F64 d;
  const Lanes mx = hn::Set(d, m.m[row]);
  const Lanes my = hn::Set(d, m.m[4 + row]);
  const Lanes mz = hn::Set(d, m.m[8 + row]);
  const Lanes mw = hn::Set(d, m.m[12 + row]);
  const Lanes x[2] = {hn::Mul(mx, min[0]), hn::Mul(mx, max[0])};
  const Lanes y[2] = {hn::Mul(my, min[1]), hn::Mul(my, max[1])};
  const Lanes z[2] = {hn::Add(hn::Mul(mz, min[2]), mw), hn::Add(hn::Mul(mz, max[2]), mw)};
  for (std::size_t corner = 0; corner < 8; ++corner) {
    out->corners[corner] = hn::Add(hn::Add(x[corner & 1], y[corner >> 1 & 1]), z[corner >> 2]);
  }
  const Lanes sum =
      hn::Add(hn::Add(hn::Add(hn::Mul(hn::Abs(mx), reach[0]), hn::Mul(hn::Abs(my), reach[1])),
                      hn::Mul(hn::Abs(mz), reach[2])),
              hn::Abs(mw));
  out->error = hn::Mul(hn::Set(d, kClipError), sum);
}

// Step 4 finds the pixels [begin, end) of an axis whose centres lie in [min - margin, max +
// margin], all in pixels, in the window of `size_px` pixels from `window_px` on.
HWY_INLINE void CoverPixels(Lanes min, Lanes max, Lanes margin, int window_px, int size_px,
                            double* begin, double* end) {
  const F64 d;
  const Lanes zero = hn::Zero(d);
  const Lanes half = hn::Set(d, 0.5);
  const Lanes window = hn::Set(d, static_cast<double>(window_px));
  const Lanes size = hn::Set(d, static_cast<double>(size_px));
  const Lanes first = hn::Sub(hn::Ceil(hn::Sub(hn::Sub(min, margin), half)), window);
  const Lanes last = hn::Sub(hn::Floor(hn::Sub(hn::Add(max, margin), half)), window);
  hn::Store(hn::Min(hn::Max(first, zero), size), d, begin);
  hn::Store(hn::Min(hn::Max(hn::Add(last, hn::Set(d, 1.0)), zero), size), d, end);
}

void ComputeFootprints(const math::Mat4d& clip_from_index, const Viewport& viewport,
                       const Region& region, FootprintBatch* batch) {
  const F64 d;
  const Lanes zero = hn::Zero(d);
  const Lanes one = hn::Set(d, 1.0);
  for (std::size_t i = 0; i < batch->count; i += hn::Lanes(d)) {
    Lanes min[3];
    Lanes max[3];
    Lanes reach[3];
    for (std::size_t axis = 0; axis < 3; ++axis) {
      min[axis] = hn::Load(d, batch->min[axis].data() + i);
      max[axis] = hn::Load(d, batch->max[axis].data() + i);
      reach[axis] = hn::Max(hn::Abs(min[axis]), hn::Abs(max[axis]));
    }
    // Step 1: project.
    Row rows[4];
    for (std::size_t row = 0; row < 4; ++row) {
      Project(clip_from_index, row, min, max, reach, &rows[row]);
    }
    const Row& w = rows[3];

    // Step 2: compare c + w and c - w with their errors. A box is outside if all its corners are
    // outside the same plane, and near if one is in front of the near plane.
    auto is_outside = hn::Lt(one, zero);
    auto is_near = is_outside;
    auto is_within_float = hn::Le(w.error, hn::Set(d, kMaxClipError));
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const Row& c = rows[axis];
      is_within_float = hn::And(is_within_float, hn::Le(c.error, hn::Set(d, kMaxClipError)));
      const Lanes error = hn::Add(c.error, w.error);
      const Range sum =
          RangeOf([&](std::size_t k) HWY_ATTR { return hn::Add(c.corners[k], w.corners[k]); });
      const Range difference =
          RangeOf([&](std::size_t k) HWY_ATTR { return hn::Sub(c.corners[k], w.corners[k]); });
      is_outside = hn::Or(is_outside,
                          hn::Or(hn::Lt(sum.max, hn::Neg(error)), hn::Gt(difference.min, error)));
      if (axis == 2) {
        is_near = hn::Lt(sum.min, error);
      }
    }
    const Range w_range = RangeOf([&](std::size_t k) HWY_ATTR { return w.corners[k]; });
    const Lanes min_w = hn::Sub(w_range.min, w.error);

    // Step 3: divide by w, and bound the error in pixels.
    Lanes inverse_w[8];
    for (std::size_t k = 0; k < 8; ++k) {
      inverse_w[k] = hn::Div(one, w.corners[k]);
    }
    const auto ndc_range = [&](std::size_t axis) HWY_ATTR {
      return RangeOf([&](std::size_t k)
                         HWY_ATTR { return hn::Mul(rows[axis].corners[k], inverse_w[k]); });
    };
    const Range x = ndc_range(0);
    const Range y = ndc_range(1);
    const Range z = ndc_range(2);
    const Lanes half_width = hn::Set(d, 0.5 * viewport.width_px);
    const Lanes half_height = hn::Set(d, 0.5 * viewport.height_px);
    const auto margin_of = [&](const Range& range, Lanes half_size, Lanes error) HWY_ATTR {
      const Lanes reach_ndc = hn::Max(hn::Abs(range.min), hn::Abs(range.max));
      const Lanes clip = hn::Div(hn::Add(error, hn::Mul(reach_ndc, w.error)), min_w);
      const Lanes transform = hn::Mul(hn::Set(d, kViewportError), hn::Add(reach_ndc, one));
      return hn::Add(hn::Mul(half_size, hn::Add(clip, transform)), hn::Set(d, kSnapErrorPx));
    };
    const Lanes margin_x = margin_of(x, half_width, rows[0].error);
    const Lanes margin_y = margin_of(y, half_height, rows[1].error);
    // Comparisons of NaN are false, while Max and Min may drop one: so each margin by itself.
    const Lanes max_margin = hn::Set(d, kMaxMarginPx);
    const auto is_sure =
        hn::And(hn::Ge(min_w, hn::Set(d, kMinClipW)),
                hn::And(hn::Le(margin_x, max_margin), hn::Le(margin_y, max_margin)));
    const auto is_decided = hn::And(is_within_float, hn::AndNot(is_near, is_sure));

    // Step 4: the pixels of the box, and its nearest depth.
    CoverPixels(hn::Mul(half_width, hn::Add(x.min, one)), hn::Mul(half_width, hn::Add(x.max, one)),
                margin_x, region.x, region.width_px, batch->begin_x.data() + i,
                batch->end_x.data() + i);
    CoverPixels(hn::Mul(half_height, hn::Sub(one, y.max)),
                hn::Mul(half_height, hn::Sub(one, y.min)), margin_y, region.y, region.height_px,
                batch->begin_y.data() + i, batch->end_y.data() + i);
    hn::Store(hn::Add(hn::Mul(hn::Set(d, 0.5), z.min), hn::Set(d, 0.5)), d,
              batch->depth.data() + i);
    std::uint8_t outside_bits[8] = {};
    std::uint8_t decided_bits[8] = {};
    hn::StoreMaskBits(d, hn::And(is_within_float, is_outside), outside_bits);
    hn::StoreMaskBits(d, is_decided, decided_bits);
    for (std::size_t lane = 0; lane < hn::Lanes(d); ++lane) {
      batch->outcome[i + lane] = (outside_bits[0] >> lane & 1) != 0 ? FootprintBatch::kOutside
                                 : (decided_bits[0] >> lane & 1) != 0
                                     ? FootprintBatch::kOnScreen
                                     : FootprintBatch::kWholePicture;
    }
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace isoscope::view
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isoscope::view {
namespace {
HWY_EXPORT(ComputeFootprints);
}  // namespace

void ComputeFootprints(const math::Mat4d& clip_from_index, const Viewport& viewport,
                       const Region& region, FootprintBatch* batch) {
  HWY_DYNAMIC_DISPATCH(ComputeFootprints)(clip_from_index, viewport, region, batch);
}

}  // namespace isoscope::view
#endif  // HWY_ONCE
