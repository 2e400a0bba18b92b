// Turns triangles into fragments. Three functions fill triangles; each suits one size:
//
//   FillTinyTriangles   box of at most 8 x 8 pixels   one triangle in each lane        32 bits
//   FillSmallTriangle   at most 60 pixels a side      one pixel of a row in each lane  32 bits
//   FillLargeTriangle   any size in the guard band    pixel by pixel                   64 bits
//
// The steps for the triangles of a small block:
//
// 1. TransformVertices projects in double and snaps x and y to 1/256 pixel, ties to even. Two
//    blocks that share a vertex get the same integers for it.
// 2. PackVertices subtracts the block's origin, a pixel left of and above all of its vertices, and
//    packs a vertex as x | y << 16. A block of at most 254 pixels a side fits: (254 + 1) * 256 is
//    less than 2^16.
// 3. SetUp takes a triangle in each lane and finds its box: the pixels whose centres lie between
//    the triangle's smallest and largest coordinates. It drops a triangle whose box is empty, and
//    compresses the survivors, so that step 4 has few idle lanes. Example: x runs from 300 to 380.
//    The box begins at (300 + 127) >> 8 = 1 and ends before (380 + 128) >> 8 = 1. It is empty:
//    the nearest centres are at 128 and 384. A larger box goes to FillTriangle.
// 4. FillSurvivors walks all boxes of a vector in step and evaluates three edge functions (Pineda
//    1988). A pixel is covered if none is negative. The edge function of an edge that is neither a
//    top nor a left one is lower by 1, so it excludes the centres that lie on the edge: of two
//    triangles that share an edge, exactly one covers such a pixel.
//
// 32 bits suffice. A side is at most 60 * 256 < 2^14 long, and a pixel centre in the box is no
// farther from a vertex. An edge function is the difference of two products below 2^28.
//
// All three functions, on every instruction set, give the same bits. Edge functions are exact
// integers. A depth comes from the same float operations in the same order, on the same integers,
// without fused multiply-add. Exchanging vertices b and c changes the sign of both factors of a
// depth's slope, so the plane does not depend on the orientation either.

#include "core/render/raster_kernels.h"

#include <algorithm>
#include <bit>
#include <cstring>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/render/raster_kernels.cc"
#include "hwy/foreach_target.h"
//
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::render {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// All vectors of 32-bit lanes have one length, so that masks and indices fit each other.
using DI = hn::CappedTag<std::int32_t, FragmentBuffer::kSlack>;
using DU = hn::RebindToUnsigned<DI>;
using DF = hn::RebindToFloat<DI>;
using VI = hn::Vec<DI>;
using VU = hn::Vec<DU>;
using VF = hn::Vec<DF>;
using MI = hn::Mask<DI>;

// Boxes of at most this many pixels a side are filled across triangles, one in each lane.
constexpr std::int32_t kTinyBoxPx = 8;
constexpr std::size_t kTinyBoxPixels = std::size_t{kTinyBoxPx} * kTinyBoxPx;
constexpr std::int32_t kHalfPixel = kSubpixels / 2;

// 1.5 * 2^52: adding it leaves a number's nearest integer (ties to even) in the low bits.
constexpr double kRoundingShift = 6755399441055744.0;

ScreenBounds TransformVertices(const Projection& projection, std::span<const math::Vec3f> positions,
                               ScreenVertices* vertices) {
  const hn::CappedTag<double, 8> dd;
  const hn::RebindToUnsigned<decltype(dd)> d64;
  const hn::Rebind<float, decltype(dd)> df;
  const hn::Rebind<std::uint32_t, decltype(dd)> du;
  const hn::Rebind<std::int32_t, decltype(dd)> di;
  using VD = hn::Vec<decltype(dd)>;
  const std::size_t lanes = hn::Lanes(dd);

  const std::array<double, 16>& m = projection.clip_from_index;
  const VD one = hn::Set(dd, 1.0);
  const VD half = hn::Set(dd, 0.5);
  const VD width = hn::Set(dd, projection.width_px);
  const VD height = hn::Set(dd, projection.height_px);
  const VD band = hn::Set(dd, projection.guard_band_px);
  const VD subpixels = hn::Set(dd, static_cast<double>(kSubpixels));
  // The origin is a whole number of pixels, so that taking it off here does not change how a
  // coordinate is rounded.
  const VD shift_x =
      hn::Set(dd, kRoundingShift - static_cast<double>(projection.origin_x * kSubpixels));
  const VD shift_y =
      hn::Set(dd, kRoundingShift - static_cast<double>(projection.origin_y * kSubpixels));
  const VD max_depth = hn::Set(dd, kMaxVertexDepth);
  auto all_valid = hn::FirstN(dd, lanes);
  auto min_x = hn::Set(di, std::int32_t{1} << 30);
  auto min_y = min_x;
  auto max_x = hn::Neg(min_x);
  auto max_y = max_x;

  const auto transform = [&](const float* from, std::size_t to) HWY_ATTR {
    // Positions become clip coordinates, in double.
    hn::Vec<decltype(df)> fx;
    hn::Vec<decltype(df)> fy;
    hn::Vec<decltype(df)> fz;
    hn::LoadInterleaved3(df, from, fx, fy, fz);
    const VD px = hn::PromoteTo(dd, fx);
    const VD py = hn::PromoteTo(dd, fy);
    const VD pz = hn::PromoteTo(dd, fz);
    const auto row = [&](std::size_t r) HWY_ATTR {
      const VD xy = hn::Add(hn::Mul(hn::Set(dd, m[r]), px), hn::Mul(hn::Set(dd, m[4 + r]), py));
      return hn::Add(hn::Add(xy, hn::Mul(hn::Set(dd, m[8 + r]), pz)), hn::Set(dd, m[12 + r]));
    };
    const VD clip_x = row(0);
    const VD clip_y = row(1);
    const VD clip_z = row(2);
    const VD clip_w = row(3);
    // Clip coordinates become pixels and window depth, row 0 at the top.
    const VD inverse_w = hn::Div(one, clip_w);
    const VD x = hn::Mul(hn::Add(hn::Mul(hn::Mul(clip_x, inverse_w), half), half), width);
    const VD y = hn::Mul(hn::Sub(half, hn::Mul(hn::Mul(clip_y, inverse_w), half)), height);
    const VD z = hn::Add(hn::Mul(hn::Mul(clip_z, inverse_w), half), half);
    // One vertex that must be clipped makes the whole block take the path that clips.
    const auto in_front = hn::And(hn::Gt(clip_w, hn::Zero(dd)), hn::Ge(clip_z, hn::Neg(clip_w)));
    const auto in_band = hn::And(hn::Le(hn::Abs(x), band), hn::Le(hn::Abs(y), band));
    all_valid = hn::And(all_valid, hn::And(in_front, in_band));
    // The low 32 bits of the shifted number are v in 1/256 pixel, rounded.
    const auto snap = [&](VD v, VD shift) HWY_ATTR {
      const VD shifted = hn::Add(hn::Mul(v, subpixels), shift);
      return hn::BitCast(di, hn::TruncateTo(du, hn::BitCast(d64, shifted)));
    };
    const auto xi = snap(x, shift_x);
    const auto yi = snap(y, shift_y);
    min_x = hn::Min(min_x, xi);
    min_y = hn::Min(min_y, yi);
    max_x = hn::Max(max_x, xi);
    max_y = hn::Max(max_y, yi);
    hn::StoreU(xi, di, vertices->x.data() + to);
    hn::StoreU(yi, di, vertices->y.data() + to);
    hn::StoreU(hn::DemoteTo(df, hn::Min(z, max_depth)), df, vertices->z.data() + to);
  };

  vertices->Resize(positions.size());
  std::size_t i = 0;
  for (; i + lanes <= positions.size(); i += lanes) {
    transform(&positions[i].x, i);
  }
  if (i < positions.size()) {
    // The last vertex fills the lanes that are left over.
    std::array<math::Vec3f, 8> rest;
    for (std::size_t k = 0; k < lanes; ++k) {
      rest[k] = positions[std::min(i + k, positions.size() - 1)];
    }
    transform(&rest[0].x, i);
  }
  return {.is_valid = hn::AllTrue(dd, all_valid),
          .min_x = hn::GetLane(hn::MinOfLanes(di, min_x)),
          .min_y = hn::GetLane(hn::MinOfLanes(di, min_y)),
          .max_x = hn::GetLane(hn::MaxOfLanes(di, max_x)),
          .max_y = hn::GetLane(hn::MaxOfLanes(di, max_y))};
}

// The depth over a triangle: the plane through its vertices, relative to vertex a. It depends on
// the triangle alone, and all three fill functions compute it with the same arithmetic.
struct DepthPlane {
  VF a;
  VF per_x;
  VF per_y;
  // A sliver has a steep plane. Its fragments are clamped to the depths of its vertices.
  VF low;
  VF high;
};

HWY_INLINE DepthPlane MakeDepthPlane(VI ux, VI uy, VI vx, VI vy, VF area, VF az, VF bz, VF cz,
                                     VF nearest) {
  const DF df;
  const VF fux = hn::ConvertTo(df, ux);
  const VF fuy = hn::ConvertTo(df, uy);
  const VF fvx = hn::ConvertTo(df, vx);
  const VF fvy = hn::ConvertTo(df, vy);
  const VF uz = hn::Sub(bz, az);
  const VF vz = hn::Sub(cz, az);
  const VF one = hn::Set(df, 1.0F);
  const VF inverse_area = hn::Div(one, area);
  DepthPlane plane;
  plane.a = az;
  plane.per_x = hn::Mul(hn::Sub(hn::Mul(uz, fvy), hn::Mul(vz, fuy)), inverse_area);
  plane.per_y = hn::Mul(hn::Sub(hn::Mul(vz, fux), hn::Mul(uz, fvx)), inverse_area);
  plane.low = hn::Min(hn::Max(hn::Min(hn::Min(az, bz), cz), nearest), one);
  plane.high = hn::Min(hn::Max(hn::Max(hn::Max(az, bz), cz), nearest), one);
  return plane;
}
HWY_INLINE VF DepthOfRow(const DepthPlane& plane, VI y_from_a) {
  return hn::Add(plane.a, hn::Mul(plane.per_y, hn::ConvertTo(DF(), y_from_a)));
}
HWY_INLINE VU DepthBits(const DepthPlane& plane, VF depth_of_row, VI x_from_a) {
  const DF df;
  const VF depth = hn::Add(depth_of_row, hn::Mul(plane.per_x, hn::ConvertTo(df, x_from_a)));
  // Adding 0 turns -0 into +0, whose bits are the smallest.
  const VF clamped = hn::Add(hn::Min(hn::Max(depth, plane.low), plane.high), hn::Zero(df));
  return hn::BitCast(DU(), clamped);
}

// Moves the lanes of one mask to the front of several vectors.
#if HWY_TARGET == HWY_AVX2
// Highway's own Compress (1.0) copies its table at every call when GCC compiles it.
constexpr auto kLanesOfBits = [] {
  std::array<std::array<std::uint32_t, 8>, 256> table{};
  for (std::size_t bits = 0; bits < 256; ++bits) {
    std::size_t count = 0;
    for (std::uint32_t lane = 0; lane < 8; ++lane) {
      if ((bits >> lane & 1) != 0) {
        table[bits][count++] = lane;
      }
    }
  }
  return table;
}();

class Compressor {
 public:
  HWY_INLINE explicit Compressor(hn::Mask<DU> mask)
      : bits_(BitsOf(mask)), lanes_(hn::SetTableIndices(DU(), kLanesOfBits[bits_].data())) {}
  HWY_INLINE VU operator()(VU v) const { return hn::TableLookupLanes(v, lanes_); }
  [[nodiscard]] HWY_INLINE std::size_t count() const {
    return static_cast<std::size_t>(std::popcount(bits_));
  }

 private:
  static HWY_INLINE std::uint8_t BitsOf(hn::Mask<DU> mask) {
    std::array<std::uint8_t, 8> bytes;
    hn::StoreMaskBits(DU(), mask, bytes.data());
    return bytes[0];
  }
  std::uint8_t bits_;
  decltype(hn::SetTableIndices(DU(), kLanesOfBits[0].data())) lanes_;
};
#else
class Compressor {
 public:
  HWY_INLINE explicit Compressor(hn::Mask<DU> mask) : mask_(mask) {}
  HWY_INLINE VU operator()(VU v) const { return hn::Compress(v, mask_); }
  [[nodiscard]] HWY_INLINE std::size_t count() const { return hn::CountTrue(DU(), mask_); }

 private:
  hn::Mask<DU> mask_;
};
#endif

// Appends the fragments in the lanes of `mask`. Writes whole vectors, so that up to
// FragmentBuffer::kSlack elements behind the last fragment are overwritten.
HWY_INLINE void Append(VU pixels, VU depths, VU triangles, hn::Mask<DU> mask,
                       FragmentBuffer* buffer) {
  const DU du;
  const Compressor compress(mask);
  const std::size_t at = buffer->count;
  hn::StoreU(compress(pixels), du, buffer->pixels.data() + at);
  hn::StoreU(compress(depths), du, buffer->depths.data() + at);
  hn::StoreU(compress(triangles), du, buffer->triangles.data() + at);
  buffer->count = at + compress.count();
}

// The triangles that SetUp keeps, one behind the other: their boxes have at least one pixel.
struct Survivors {
  static constexpr std::size_t kChunk = 512;
  static constexpr std::size_t kSize = kChunk + FragmentBuffer::kSlack;
  std::size_t count = 0;
  alignas(64) std::array<std::uint32_t, kSize> triangle;
  alignas(64) std::array<std::array<std::uint32_t, kSize>, 3> corner;
  alignas(64) std::array<std::array<std::uint32_t, kSize>, 3> xy;  // packed
  alignas(64) std::array<std::uint32_t, kSize> begin;              // packed: the box's first pixel
  alignas(64) std::array<std::uint32_t, kSize> size;  // packed: the box's width and height
};

// Step 2. Packs the block's vertices as x | y << 16, in 1/256 pixel from the block's origin.
HWY_INLINE void PackVertices(const TinyTriangleTask& task) {
  const DI di;
  const DU du;
  ScreenVertices& v = *task.vertices;
  const VI origin_x = hn::Set(di, task.origin_x * kSubpixels);
  const VI origin_y = hn::Set(di, task.origin_y * kSubpixels);
  for (std::size_t i = 0; i < v.count; i += hn::Lanes(di)) {
    const VI x = hn::Sub(hn::LoadU(di, v.x.data() + i), origin_x);
    const VI y = hn::Sub(hn::LoadU(di, v.y.data() + i), origin_y);
    hn::StoreU(hn::BitCast(du, hn::Or(x, hn::ShiftLeft<16>(y))), du, v.packed.data() + i);
  }
}

// Packs x and y to be added to packed numbers. They may be negative, as long as x and y of the sum
// are not.
HWY_INLINE VU SetPacked(std::int32_t x, std::int32_t y) {
  return hn::Set(DU(), static_cast<std::uint32_t>(x) + (static_cast<std::uint32_t>(y) << 16));
}

// Step 3. Finds which of the triangles [first, first + Survivors::kChunk) may cover a pixel.
HWY_INLINE void SetUp(const TinyTriangleTask& task, std::size_t first, Survivors* survivors,
                      std::vector<std::uint32_t>* larger) {
  const DI di;
  const DU du;
  const std::size_t lanes = hn::Lanes(du);
  const std::size_t triangle_count = task.triangles.size();
  const std::size_t end = std::min(first + Survivors::kChunk, triangle_count);
  const std::uint32_t* packed = task.vertices->packed.data();

  const VI before = hn::Set(di, kHalfPixel - 1);
  const VI after = hn::Set(di, kHalfPixel);
  const VI rect_begin_x = hn::Set(di, task.rect.begin_x - task.origin_x);
  const VI rect_begin_y = hn::Set(di, task.rect.begin_y - task.origin_y);
  const VI rect_end_x = hn::Set(di, task.rect.end_x - task.origin_x);
  const VI rect_end_y = hn::Set(di, task.rect.end_y - task.origin_y);
  const VI box_limit = hn::Set(di, kTinyBoxPx + 1);
  const VI extent_limit = hn::Set(di, kSmallTrianglePx * kSubpixels + 1);
  const VU low_half = hn::Set(du, 0xffffu);
  const VU zero = hn::Zero(du);

  std::size_t count = 0;
  for (std::size_t t = first; t < end; t += lanes) {
    // Load the vertex indices of one triangle into each lane.
    VU a;
    VU b;
    VU c;
    if (t + lanes <= triangle_count) [[likely]] {
      if (task.triangles.small() != nullptr) [[likely]] {
        const hn::Rebind<std::uint16_t, DU> d16;
        hn::Vec<decltype(d16)> a16;
        hn::Vec<decltype(d16)> b16;
        hn::Vec<decltype(d16)> c16;
        hn::LoadInterleaved3(d16, task.triangles.small() + 3 * t, a16, b16, c16);
        a = hn::PromoteTo(du, a16);
        b = hn::PromoteTo(du, b16);
        c = hn::PromoteTo(du, c16);
      } else {
        hn::LoadInterleaved3(du, task.triangles.large() + 3 * t, a, b, c);
      }
    } else {
      // Triangles without area fill the lanes that are left over.
      std::array<std::uint32_t, 3 * FragmentBuffer::kSlack> rest{};
      for (std::size_t i = t; i < triangle_count; ++i) {
        const std::array<std::uint32_t, 3> corners = task.triangles[i];
        std::copy(corners.begin(), corners.end(),
                  rest.begin() + static_cast<std::ptrdiff_t>(3 * (i - t)));
      }
      hn::LoadInterleaved3(du, rest.data(), a, b, c);
    }
    // Fetch the packed vertices and take x and y apart.
    const VU pa = hn::GatherIndex(du, packed, hn::BitCast(di, a));
    const VU pb = hn::GatherIndex(du, packed, hn::BitCast(di, b));
    const VU pc = hn::GatherIndex(du, packed, hn::BitCast(di, c));
    const VI ax = hn::BitCast(di, hn::And(pa, low_half));
    const VI bx = hn::BitCast(di, hn::And(pb, low_half));
    const VI cx = hn::BitCast(di, hn::And(pc, low_half));
    const VI ay = hn::BitCast(di, hn::ShiftRight<16>(pa));
    const VI by = hn::BitCast(di, hn::ShiftRight<16>(pb));
    const VI cy = hn::BitCast(di, hn::ShiftRight<16>(pc));
    // Find the box: first pixel inclusive, last pixel exclusive, cut to the block's rectangle.
    const VI low_x = hn::Min(hn::Min(ax, bx), cx);
    const VI low_y = hn::Min(hn::Min(ay, by), cy);
    const VI high_x = hn::Max(hn::Max(ax, bx), cx);
    const VI high_y = hn::Max(hn::Max(ay, by), cy);
    const VI begin_x = hn::Max(hn::ShiftRight<kSubpixelBits>(hn::Add(low_x, before)), rect_begin_x);
    const VI begin_y = hn::Max(hn::ShiftRight<kSubpixelBits>(hn::Add(low_y, before)), rect_begin_y);
    const VI end_x = hn::Min(hn::ShiftRight<kSubpixelBits>(hn::Add(high_x, after)), rect_end_x);
    const VI end_y = hn::Min(hn::ShiftRight<kSubpixelBits>(hn::Add(high_y, after)), rect_end_y);
    const auto has_pixels = hn::And(hn::Lt(begin_x, end_x), hn::Lt(begin_y, end_y));
    // Width and height mean something only in lanes of has_pixels.
    const VI width = hn::Sub(end_x, begin_x);
    const VI height = hn::Sub(end_y, begin_y);
    const auto is_tiny =
        hn::And(hn::Lt(hn::Max(width, height), box_limit),
                hn::Lt(hn::Max(hn::Sub(high_x, low_x), hn::Sub(high_y, low_y)), extent_limit));
    const VU begin = hn::BitCast(du, hn::Or(begin_x, hn::ShiftLeft<16>(begin_y)));
    const VU size = hn::BitCast(du, hn::Or(width, hn::ShiftLeft<16>(height)));
    const auto survives = hn::RebindMask(du, hn::And(has_pixels, is_tiny));
    // Hand larger triangles to the caller, who fills them one at a time.
    const MI is_larger = hn::AndNot(is_tiny, has_pixels);
    if (!hn::AllFalse(di, is_larger)) [[unlikely]] {
      std::array<std::uint8_t, 8> bits{};
      hn::StoreMaskBits(di, is_larger, bits.data());
      std::uint64_t rest = 0;
      std::memcpy(&rest, bits.data(), sizeof(rest));
      for (; rest != 0; rest &= rest - 1) {
        larger->push_back(static_cast<std::uint32_t>(t) +
                          static_cast<std::uint32_t>(std::countr_zero(rest)));
      }
    }
    // Append the survivors.
    const Compressor compress(survives);
    const VU triangle = hn::Iota(du, static_cast<std::uint32_t>(t));
    hn::StoreU(compress(triangle), du, survivors->triangle.data() + count);
    hn::StoreU(compress(a), du, survivors->corner[0].data() + count);
    hn::StoreU(compress(b), du, survivors->corner[1].data() + count);
    hn::StoreU(compress(c), du, survivors->corner[2].data() + count);
    hn::StoreU(compress(pa), du, survivors->xy[0].data() + count);
    hn::StoreU(compress(pb), du, survivors->xy[1].data() + count);
    hn::StoreU(compress(pc), du, survivors->xy[2].data() + count);
    hn::StoreU(compress(begin), du, survivors->begin.data() + count);
    hn::StoreU(compress(size), du, survivors->size.data() + count);
    count += compress.count();
  }
  // Boxes without pixels fill the lanes that FillSurvivors reads past the last survivor.
  for (auto& corner : survivors->corner) {
    hn::StoreU(zero, du, corner.data() + count);
  }
  for (auto& xy : survivors->xy) {
    hn::StoreU(zero, du, xy.data() + count);
  }
  hn::StoreU(zero, du, survivors->size.data() + count);
  survivors->count = count;
}

// An edge function at the first pixel of a box: not negative inside. A pixel centre on an edge
// belongs to the triangle only if the edge is a top or a left one; other edges start 1 lower.
struct Edge {
  VI value;
  VI step_x;
  VI step_y;
};
HWY_INLINE Edge MakeEdge(VI from_x, VI from_y, VI to_x, VI to_y, VI x, VI y) {
  const VI dx = hn::Sub(to_x, from_x);
  const VI dy = hn::Sub(to_y, from_y);
  const VI at = hn::Sub(hn::Mul(dx, hn::Sub(y, from_y)), hn::Mul(dy, hn::Sub(x, from_x)));
  // All bits are set if dy < 0, or if dy == 0 and dx > 0. Both are below 2^15, so nothing is lost.
  const VI top_left = hn::ShiftRight<31>(hn::Sub(hn::ShiftLeft<16>(dy), dx));
  return {hn::Add(at, hn::Not(top_left)), hn::ShiftLeft<kSubpixelBits>(hn::Neg(dy)),
          hn::ShiftLeft<kSubpixelBits>(dx)};
}

// Step 4. Appends the fragments of the survivors to `buffer`.
HWY_INLINE void FillSurvivors(const TinyTriangleTask& task, const Survivors& survivors,
                              FragmentBuffer* buffer, absl::FunctionRef<void()> flush) {
  const DI di;
  const DU du;
  const DF df;
  const std::size_t lanes = hn::Lanes(di);
  const VU low_half = hn::Set(du, 0xffffu);
  const VI zero = hn::Zero(di);
  const VI one_pixel = hn::Set(di, kSubpixels);
  const VU next_pixel = hn::Set(du, 1u);
  const VU next_row = hn::Set(du, 1u << 16);
  const VU origin = SetPacked(task.origin_x, task.origin_y);
  const VF nearest = hn::Set(df, task.nearest_depth);
  const float* depths = task.vertices->z.data();
  const auto low = [&](VU v) HWY_ATTR { return hn::BitCast(di, hn::And(v, low_half)); };
  const auto high = [&](VU v) HWY_ATTR { return hn::BitCast(di, hn::ShiftRight<16>(v)); };

  for (std::size_t i = 0; i < survivors.count; i += lanes) {
    // Load one triangle into each lane: vertex a, and the sides u = b - a and v = c - a.
    const VU pa = hn::LoadU(du, survivors.xy[0].data() + i);
    const VU pb = hn::LoadU(du, survivors.xy[1].data() + i);
    const VU pc = hn::LoadU(du, survivors.xy[2].data() + i);
    const VI ax = low(pa);
    const VI ay = high(pa);
    VI ux = hn::Sub(low(pb), ax);
    VI uy = hn::Sub(high(pb), ay);
    VI vx = hn::Sub(low(pc), ax);
    VI vy = hn::Sub(high(pc), ay);
    const VI signed_area = hn::Sub(hn::Mul(ux, vy), hn::Mul(vx, uy));
    const VF az =
        hn::GatherIndex(df, depths, hn::BitCast(di, hn::LoadU(du, survivors.corner[0].data() + i)));
    const VF bz =
        hn::GatherIndex(df, depths, hn::BitCast(di, hn::LoadU(du, survivors.corner[1].data() + i)));
    const VF cz =
        hn::GatherIndex(df, depths, hn::BitCast(di, hn::LoadU(du, survivors.corner[2].data() + i)));
    // Make the depth plane. It is the same, bit by bit, whichever of b and c comes first.
    const DepthPlane plane =
        MakeDepthPlane(ux, uy, vx, vy, hn::ConvertTo(df, signed_area), az, bz, cz, nearest);
    // Exchange b and c of a clockwise triangle, so that all edge functions are positive inside.
    const MI is_clockwise = hn::Lt(signed_area, zero);
    const VI bx = hn::Add(ax, hn::IfThenElse(is_clockwise, vx, ux));
    const VI by = hn::Add(ay, hn::IfThenElse(is_clockwise, vy, uy));
    const VI cx = hn::Add(ax, hn::IfThenElse(is_clockwise, ux, vx));
    const VI cy = hn::Add(ay, hn::IfThenElse(is_clockwise, uy, vy));

    // Evaluate the edge functions at the centre of each box's first pixel. A triangle without area
    // gets a box of width 0.
    const VU begin = hn::LoadU(du, survivors.begin.data() + i);
    const VU size = hn::LoadU(du, survivors.size.data() + i);
    const VI x = hn::Add(hn::ShiftLeft<kSubpixelBits>(low(begin)), hn::Set(di, kHalfPixel));
    const VI y = hn::Add(hn::ShiftLeft<kSubpixelBits>(high(begin)), hn::Set(di, kHalfPixel));
    Edge ab = MakeEdge(ax, ay, bx, by, x, y);
    Edge bc = MakeEdge(bx, by, cx, cy, x, y);
    Edge ca = MakeEdge(cx, cy, ax, ay, x, y);
    const VU triangle = hn::LoadU(du, survivors.triangle.data() + i);
    const VI width = hn::IfThenZeroElse(hn::Eq(signed_area, zero), low(size));
    const VI height = high(size);
    VU row_pixel = hn::Add(begin, origin);
    VI y_from_a = hn::Sub(y, ay);
    const VI first_x_from_a = hn::Sub(x, ax);
    // Make room for every pixel of every box.
    if (buffer->count + kTinyBoxPixels * lanes > FragmentBuffer::kCapacity) [[unlikely]] {
      flush();
      buffer->Extend(task.rect);
    }
    // Walk the rows and columns of all boxes in step, and append the covered pixels.
    for (std::int32_t row = 0; row < kTinyBoxPx; ++row) {
      const MI in_rows = hn::Lt(hn::Set(di, row), height);
      if (hn::AllFalse(di, in_rows)) {
        break;
      }
      const VF depth_of_row = DepthOfRow(plane, y_from_a);
      VI value_ab = ab.value;
      VI value_bc = bc.value;
      VI value_ca = ca.value;
      VI x_from_a = first_x_from_a;
      VU pixel = row_pixel;
      for (std::int32_t column = 0; column < kTinyBoxPx; ++column) {
        const MI in_box = hn::And(in_rows, hn::Lt(hn::Set(di, column), width));
        if (hn::AllFalse(di, in_box)) {
          break;
        }
        const MI covered =
            hn::AndNot(hn::Lt(hn::Or(hn::Or(value_ab, value_bc), value_ca), zero), in_box);
        if (!hn::AllFalse(di, covered)) {
          Append(pixel, DepthBits(plane, depth_of_row, x_from_a), triangle,
                 hn::RebindMask(du, covered), buffer);
        }
        value_ab = hn::Add(value_ab, ab.step_x);
        value_bc = hn::Add(value_bc, bc.step_x);
        value_ca = hn::Add(value_ca, ca.step_x);
        x_from_a = hn::Add(x_from_a, one_pixel);
        pixel = hn::Add(pixel, next_pixel);
      }
      ab.value = hn::Add(ab.value, ab.step_y);
      bc.value = hn::Add(bc.value, bc.step_y);
      ca.value = hn::Add(ca.value, ca.step_y);
      y_from_a = hn::Add(y_from_a, one_pixel);
      row_pixel = hn::Add(row_pixel, next_row);
    }
  }
}

void FillTinyTriangles(const TinyTriangleTask& task, FragmentBuffer* buffer,
                       std::vector<std::uint32_t>* larger, absl::FunctionRef<void()> flush) {
  PackVertices(task);
  buffer->Extend(task.rect);
  Survivors survivors;  // 19 KB: stays in the first-level cache
  for (std::size_t first = 0; first < task.triangles.size(); first += Survivors::kChunk) {
    SetUp(task, first, &survivors, larger);
    FillSurvivors(task, survivors, buffer, flush);
  }
}

// Fills a triangle of at most kSmallTrianglePx a side, `lanes` pixels of a row at a time. 32 bits
// hold its edge functions.
void FillSmallTriangle(const ScreenTriangle& triangle, float nearest_depth, FragmentBuffer* buffer,
                       absl::FunctionRef<void()> flush) {
  const DI di;
  const DU du;
  const DF df;
  const auto lanes = static_cast<std::int32_t>(hn::Lanes(di));
  const auto& [a, b, c] = triangle.v;
  const view::PixelRect& box = triangle.box;
  const VI x = hn::Set(di, box.begin_x * kSubpixels + kHalfPixel);
  const VI y = hn::Set(di, box.begin_y * kSubpixels + kHalfPixel);
  const VI ax = hn::Set(di, a.x);
  const VI ay = hn::Set(di, a.y);
  const VI bx = hn::Set(di, b.x);
  const VI by = hn::Set(di, b.y);
  const VI cx = hn::Set(di, c.x);
  const VI cy = hn::Set(di, c.y);
  // Each lane starts at its own column and steps by as many pixels as there are lanes.
  const VI column = hn::Iota(di, 0);
  const auto start = [&](Edge edge) HWY_ATTR {
    edge.value = hn::Add(edge.value, hn::Mul(edge.step_x, column));
    edge.step_x = hn::Mul(edge.step_x, hn::Set(di, lanes));
    return edge;
  };
  Edge ab = start(MakeEdge(ax, ay, bx, by, x, y));
  Edge bc = start(MakeEdge(bx, by, cx, cy, x, y));
  Edge ca = start(MakeEdge(cx, cy, ax, ay, x, y));
  const std::int32_t area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
  const DepthPlane plane =
      MakeDepthPlane(hn::Sub(bx, ax), hn::Sub(by, ay), hn::Sub(cx, ax), hn::Sub(cy, ay),
                     hn::Set(df, static_cast<float>(area)), hn::Set(df, a.z), hn::Set(df, b.z),
                     hn::Set(df, c.z), hn::Set(df, nearest_depth));
  const VU triangle_index = hn::Set(du, triangle.index);
  const VI first_x_from_a = hn::Add(hn::Sub(x, ax), hn::ShiftLeft<kSubpixelBits>(column));
  const VI lane_step = hn::Set(di, lanes * kSubpixels);
  VI y_from_a = hn::Sub(y, ay);
  buffer->Extend(box);
  for (std::int32_t py = box.begin_y; py < box.end_y; ++py) {
    const VF depth_of_row = DepthOfRow(plane, y_from_a);
    VI value_ab = ab.value;
    VI value_bc = bc.value;
    VI value_ca = ca.value;
    VI x_from_a = first_x_from_a;
    for (std::int32_t px = box.begin_x; px < box.end_x; px += lanes) {
      const MI in_box = hn::Lt(column, hn::Set(di, box.end_x - px));
      const MI covered =
          hn::AndNot(hn::Lt(hn::Or(hn::Or(value_ab, value_bc), value_ca), hn::Zero(di)), in_box);
      if (!hn::AllFalse(di, covered)) {
        if (buffer->count + static_cast<std::size_t>(lanes) > FragmentBuffer::kCapacity)
            [[unlikely]] {
          flush();
          buffer->Extend(box);
        }
        const VU pixel = hn::Add(SetPacked(px, py), hn::BitCast(du, column));
        Append(pixel, DepthBits(plane, depth_of_row, x_from_a), triangle_index,
               hn::RebindMask(du, covered), buffer);
      }
      value_ab = hn::Add(value_ab, ab.step_x);
      value_bc = hn::Add(value_bc, bc.step_x);
      value_ca = hn::Add(value_ca, ca.step_x);
      x_from_a = hn::Add(x_from_a, lane_step);
    }
    ab.value = hn::Add(ab.value, ab.step_y);
    bc.value = hn::Add(bc.value, bc.step_y);
    ca.value = hn::Add(ca.value, ca.step_y);
    y_from_a = hn::Add(y_from_a, hn::Set(di, kSubpixels));
  }
}

std::int64_t Target() { return HWY_TARGET; }

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace isoscope::render
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isoscope::render {
namespace {

HWY_EXPORT(TransformVertices);
HWY_EXPORT(FillTinyTriangles);
HWY_EXPORT(FillSmallTriangle);
HWY_EXPORT(Target);

// Fills a triangle of any size: the arithmetic of FillSmallTriangle, but with edge functions of 64
// bits, and pixel by pixel.
void FillLargeTriangle(const ScreenTriangle& triangle, float nearest_depth, FragmentBuffer* buffer,
                       absl::FunctionRef<void()> flush) {
  constexpr std::int32_t kHalfPixel = kSubpixels / 2;
  const auto& [a, b, c] = triangle.v;
  const view::PixelRect& box = triangle.box;
  const std::int64_t x = std::int64_t{box.begin_x} * kSubpixels + kHalfPixel;
  const std::int64_t y = std::int64_t{box.begin_y} * kSubpixels + kHalfPixel;
  const auto edge = [x, y](const ScreenVertex& from, const ScreenVertex& to) {
    const std::int64_t dx = to.x - from.x;
    const std::int64_t dy = to.y - from.y;
    const bool is_top_left = dy < 0 || (dy == 0 && dx > 0);
    return dx * (y - from.y) - dy * (x - from.x) - (is_top_left ? 0 : 1);
  };
  std::int64_t row_ab = edge(a, b);
  std::int64_t row_bc = edge(b, c);
  std::int64_t row_ca = edge(c, a);
  const std::int64_t ux = b.x - a.x;
  const std::int64_t uy = b.y - a.y;
  const std::int64_t vx = c.x - a.x;
  const std::int64_t vy = c.y - a.y;
  const float uz = b.z - a.z;
  const float vz = c.z - a.z;
  const float inverse_area = 1.0F / static_cast<float>(ux * vy - vx * uy);
  const float depth_per_x =
      (uz * static_cast<float>(vy) - vz * static_cast<float>(uy)) * inverse_area;
  const float depth_per_y =
      (vz * static_cast<float>(ux) - uz * static_cast<float>(vx)) * inverse_area;
  const float low = std::min(std::max(std::min({a.z, b.z, c.z}), nearest_depth), 1.0F);
  const float high = std::min(std::max(std::max({a.z, b.z, c.z}), nearest_depth), 1.0F);
  buffer->Extend(box);
  for (std::int32_t py = box.begin_y; py < box.end_y; ++py) {
    std::int64_t ab = row_ab;
    std::int64_t bc = row_bc;
    std::int64_t ca = row_ca;
    const float depth_of_row =
        a.z + depth_per_y * static_cast<float>(py * kSubpixels + kHalfPixel - a.y);
    for (std::int32_t px = box.begin_x; px < box.end_x; ++px) {
      if ((ab | bc | ca) >= 0) {
        if (buffer->count == FragmentBuffer::kCapacity) [[unlikely]] {
          flush();
          buffer->Extend(box);
        }
        const float plane =
            depth_of_row + depth_per_x * static_cast<float>(px * kSubpixels + kHalfPixel - a.x);
        const float depth = std::min(std::max(plane, low), high) + 0.0F;
        buffer->pixels[buffer->count] =
            static_cast<std::uint32_t>(px) | static_cast<std::uint32_t>(py) << 16;
        buffer->depths[buffer->count] = std::bit_cast<std::uint32_t>(depth);
        buffer->triangles[buffer->count] = triangle.index;
        ++buffer->count;
      }
      ab -= uy * kSubpixels;
      bc -= std::int64_t{c.y - b.y} * kSubpixels;
      ca += vy * kSubpixels;
    }
    row_ab += ux * kSubpixels;
    row_bc += std::int64_t{c.x - b.x} * kSubpixels;
    row_ca -= vx * kSubpixels;
  }
}

}  // namespace

void ScreenVertices::Resize(std::size_t vertex_count) {
  count = vertex_count;
  const std::size_t padded = vertex_count + FragmentBuffer::kSlack;
  if (x.size() < padded) {
    y.resize(padded);
    z.resize(padded);
    packed.resize(padded);
    x.resize(padded);  // the last: if memory runs out before, the next call resizes all
  }
}

void FragmentBuffer::Extend(const view::PixelRect& rect) {
  if (bounds.empty()) {
    bounds = rect;
    return;
  }
  bounds = {std::min(bounds.begin_x, rect.begin_x), std::min(bounds.begin_y, rect.begin_y),
            std::max(bounds.end_x, rect.end_x), std::max(bounds.end_y, rect.end_y)};
}

ScreenBounds TransformVertices(const Projection& projection, std::span<const math::Vec3f> positions,
                               ScreenVertices* vertices) {
  return HWY_DYNAMIC_DISPATCH(TransformVertices)(projection, positions, vertices);
}

const char* RasterInstructionSet() {
  const std::int64_t target = HWY_DYNAMIC_DISPATCH(Target)();
  // Highway calls AVX-512 the third AVX.
  return target == HWY_AVX3 || target == HWY_AVX3_DL ? "AVX-512" : hwy::TargetName(target);
}

void FillTinyTriangles(const TinyTriangleTask& task, FragmentBuffer* buffer,
                       std::vector<std::uint32_t>* larger, absl::FunctionRef<void()> flush) {
  HWY_DYNAMIC_DISPATCH(FillTinyTriangles)(task, buffer, larger, flush);
}

void FillTriangle(const ScreenTriangle& triangle, float nearest_depth, FragmentBuffer* buffer,
                  absl::FunctionRef<void()> flush) {
  const auto& v = triangle.v;
  const auto [low_x, high_x] = std::minmax({v[0].x, v[1].x, v[2].x});
  const auto [low_y, high_y] = std::minmax({v[0].y, v[1].y, v[2].y});
  if (std::max(high_x - low_x, high_y - low_y) <= kSmallTrianglePx * kSubpixels) {
    HWY_DYNAMIC_DISPATCH(FillSmallTriangle)(triangle, nearest_depth, buffer, flush);
  } else {
    FillLargeTriangle(triangle, nearest_depth, buffer, flush);
  }
}

}  // namespace isoscope::render
#endif  // HWY_ONCE
