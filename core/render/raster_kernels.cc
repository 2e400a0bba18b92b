// Turns triangles into fragments. Three functions fill triangles; each suits one size:
//
//   FillTinyTriangles   box of at most 8 x 8 pixels   one triangle in each lane        32 bits
//   FillSmallTriangle   at most 60 pixels a side      one pixel of a row in each lane  32 bits
//   FillLargeTriangle   any size in the guard band    pixel by pixel                   64 bits
//
// The steps for the triangles of a small block:
//
// 1. TransformVertices (screen_vertices.h) snaps x and y to 1/256 pixel.
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
using DI = hn::CappedTag<std::int32_t, kLaneSlack>;
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

// The sides u = b - a and v = c - a of a triangle in each lane, in 1/256 pixel.
struct Sides {
  VI ux, uy, vx, vy;

  HWY_INLINE VI Area() const { return hn::Sub(hn::Mul(ux, vy), hn::Mul(vx, uy)); }
};

// The depth over a triangle: the plane through its vertices, relative to vertex a. It depends on
// the triangle alone, and all three fill functions compute it with the same arithmetic.
struct DepthPlane {
  VF a, per_x, per_y;
  // A sliver has a steep plane. Its fragments are clamped to the depths of its vertices.
  VF low, high;

  HWY_INLINE DepthPlane(const Sides& sides, VF az, VF bz, VF cz, VF nearest) : a(az) {
    const DF df;
    const VF ux = hn::ConvertTo(df, sides.ux);
    const VF uy = hn::ConvertTo(df, sides.uy);
    const VF vx = hn::ConvertTo(df, sides.vx);
    const VF vy = hn::ConvertTo(df, sides.vy);
    const VF uz = hn::Sub(bz, az);
    const VF vz = hn::Sub(cz, az);
    const VF one = hn::Set(df, 1.0F);
    const VF inverse_area = hn::Div(one, hn::ConvertTo(df, sides.Area()));
    per_x = hn::Mul(hn::Sub(hn::Mul(uz, vy), hn::Mul(vz, uy)), inverse_area);
    per_y = hn::Mul(hn::Sub(hn::Mul(vz, ux), hn::Mul(uz, vx)), inverse_area);
    low = hn::Min(hn::Max(hn::Min(hn::Min(az, bz), cz), nearest), one);
    high = hn::Min(hn::Max(hn::Max(hn::Max(az, bz), cz), nearest), one);
  }
  HWY_INLINE VF RowAt(VI y_from_a) const {
    return hn::Add(a, hn::Mul(per_y, hn::ConvertTo(DF(), y_from_a)));
  }
  HWY_INLINE VU BitsAt(VF depth_of_row, VI x_from_a) const {
    const DF df;
    const VF depth = hn::Add(depth_of_row, hn::Mul(per_x, hn::ConvertTo(df, x_from_a)));
    // Adding 0 turns -0 into +0, whose bits are the smallest.
    return hn::BitCast(DU(), hn::Add(hn::Min(hn::Max(depth, low), high), hn::Zero(df)));
  }
};

// An edge function at the centre of a pixel: not negative inside. A centre on an edge belongs to
// the triangle only if the edge is a top or a left one; other edges start 1 lower.
struct Edge {
  VI value, step_x, step_y;

  // (dx, dy): the edge, clockwise. (x, y): the centre, from a point of the edge.
  HWY_INLINE Edge(VI dx, VI dy, VI x, VI y, VI column_step)
      : step_x(hn::Mul(hn::Neg(dy), column_step)), step_y(hn::ShiftLeft<kSubpixelBits>(dx)) {
    // All bits are set if dy < 0, or if dy == 0 and dx > 0. Both are below 2^15, so nothing is
    // lost.
    const VI top_left = hn::ShiftRight<31>(hn::Sub(hn::ShiftLeft<16>(dy), dx));
    value = hn::Add(hn::Sub(hn::Mul(dx, y), hn::Mul(dy, x)), hn::Not(top_left));
  }
};

// The pixel that each lane has reached in the box of its triangle. REQUIRES: Area() is not
// negative.
struct Walk {
  VI x, y;  // the pixel's centre, from vertex a
  VI step_x;
  Edge ab, bc, ca;

  // columns: pixels that NextColumn goes on
  HWY_INLINE Walk(const Sides& s, VI x_from_a, VI y_from_a, std::int32_t columns)
      : x(x_from_a),
        y(y_from_a),
        step_x(hn::Set(DI(), columns * kSubpixels)),
        ab(s.ux, s.uy, x, y, step_x),
        bc(hn::Sub(s.vx, s.ux), hn::Sub(s.vy, s.uy), hn::Sub(x, s.ux), hn::Sub(y, s.uy), step_x),
        ca(hn::Neg(s.vx), hn::Neg(s.vy), x, y, step_x) {}
  HWY_INLINE MI Covered(MI in_box) const {
    const VI any_sign = hn::Or(hn::Or(ab.value, bc.value), ca.value);
    return hn::AndNot(hn::Lt(any_sign, hn::Zero(DI())), in_box);
  }
  HWY_INLINE void NextColumn() {
    ab.value = hn::Add(ab.value, ab.step_x);
    bc.value = hn::Add(bc.value, bc.step_x);
    ca.value = hn::Add(ca.value, ca.step_x);
    x = hn::Add(x, step_x);
  }
  HWY_INLINE void NextRow() {
    ab.value = hn::Add(ab.value, ab.step_y);
    bc.value = hn::Add(bc.value, bc.step_y);
    ca.value = hn::Add(ca.value, ca.step_y);
    y = hn::Add(y, hn::Set(DI(), kSubpixels));
  }
};

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

// Appends the fragments in the lanes of `mask`. Writes whole vectors, so that up to kLaneSlack
// elements behind the last fragment are overwritten.
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

// A pair of 16-bit numbers, x | y << 16, in each lane.
HWY_INLINE VU Pack(VI x, VI y) { return hn::BitCast(DU(), hn::Or(x, hn::ShiftLeft<16>(y))); }
HWY_INLINE VI UnpackX(VU packed) {
  return hn::BitCast(DI(), hn::And(packed, hn::Set(DU(), 0xffffu)));
}
HWY_INLINE VI UnpackY(VU packed) { return hn::BitCast(DI(), hn::ShiftRight<16>(packed)); }
// Packs x and y to be added to packed numbers. They may be negative, as long as x and y of the sum
// are not.
HWY_INLINE VU SetPacked(std::int32_t x, std::int32_t y) {
  return hn::Set(DU(), static_cast<std::uint32_t>(x) + (static_cast<std::uint32_t>(y) << 16));
}

// The triangles that SetUp keeps, one behind the other: their boxes have at least one pixel.
struct Survivors {
  static constexpr std::size_t kChunk = 512;
  using Row = std::uint32_t[kChunk + kLaneSlack];
  std::size_t count = 0;
  alignas(64) Row index, corners[3], xy[3], begin, size;  // the fields of TriangleLanes
};

// A tiny triangle in each lane.
struct TriangleLanes {
  VU index;       // of the mesh's triangles
  VU corners[3];  // indices of vertices
  VU xy[3];       // packed: the vertices, from the block's origin
  VU begin;       // packed: the box's first pixel
  VU size;        // packed: the box's width and height

  static HWY_INLINE TriangleLanes Load(const Survivors& from, std::size_t at) {
    const auto load = [at](const Survivors::Row& row)
                          HWY_ATTR { return hn::LoadU(DU(), row + at); };
    return {load(from.index),
            {load(from.corners[0]), load(from.corners[1]), load(from.corners[2])},
            {load(from.xy[0]), load(from.xy[1]), load(from.xy[2])},
            load(from.begin),
            load(from.size)};
  }
  // Stores the lanes of a mask as survivors from `at` on, and overwrites up to kLaneSlack elements
  // behind them. Returns where they end.
  HWY_INLINE std::size_t Store(hn::Mask<DU> mask, std::size_t at, Survivors* to) const {
    const Compressor compress(mask);
    const auto store = [&](VU v, Survivors::Row* row)
                           HWY_ATTR { hn::StoreU(compress(v), DU(), *row + at); };
    store(index, &to->index);
    for (std::size_t k = 0; k < 3; ++k) {
      store(corners[k], &to->corners[k]);
      store(xy[k], &to->xy[k]);
    }
    store(begin, &to->begin);
    store(size, &to->size);
    return at + compress.count();
  }
};

// Step 2. Packs the block's vertices, in 1/256 pixel from the block's origin.
HWY_INLINE void PackVertices(const TinyTriangleTask& task) {
  const DI di;
  ScreenVertices& v = *task.vertices;
  const VI origin_x = hn::Set(di, task.origin_x * kSubpixels);
  const VI origin_y = hn::Set(di, task.origin_y * kSubpixels);
  for (std::size_t i = 0; i < v.count; i += hn::Lanes(di)) {
    const VI x = hn::Sub(hn::LoadU(di, v.x.data() + i), origin_x);
    const VI y = hn::Sub(hn::LoadU(di, v.y.data() + i), origin_y);
    hn::StoreU(Pack(x, y), DU(), v.packed.data() + i);
  }
}

// Loads the vertex indices of triangle `first` and of those behind it. Triangles without area fill
// the lanes that are left over.
HWY_INLINE void LoadCorners(const mesh::TriangleVertices& triangles, std::size_t first,
                            VU (&corners)[3]) {
  const DU du;
  auto& [a, b, c] = corners;
  if (first + hn::Lanes(du) > triangles.size()) [[unlikely]] {
    std::array<std::array<std::uint32_t, 3>, kLaneSlack> rest{};
    for (std::size_t i = first; i < triangles.size(); ++i) {
      rest[i - first] = triangles[i];
    }
    hn::LoadInterleaved3(du, rest[0].data(), a, b, c);
  } else if (triangles.small() != nullptr) [[likely]] {
    const hn::Rebind<std::uint16_t, DU> d16;
    hn::Vec<decltype(d16)> a16, b16, c16;
    hn::LoadInterleaved3(d16, triangles.small() + 3 * first, a16, b16, c16);
    a = hn::PromoteTo(du, a16);
    b = hn::PromoteTo(du, b16);
    c = hn::PromoteTo(du, c16);
  } else {
    hn::LoadInterleaved3(du, triangles.large() + 3 * first, a, b, c);
  }
}

// A triangle's box along one axis, in pixels from the block's origin.
struct BoxSide {
  VI begin;
  VI size;    // not positive: no pixel
  VI extent;  // of the triangle, in 1/256 pixel

  // a, b, c: coordinates of the vertices. The box is cut to [rect_begin, rect_end).
  HWY_INLINE BoxSide(VI a, VI b, VI c, std::int32_t rect_begin, std::int32_t rect_end) {
    const DI di;
    const VI low = hn::Min(hn::Min(a, b), c);
    const VI high = hn::Max(hn::Max(a, b), c);
    const auto first_from = [di](VI v, std::int32_t rounding) HWY_ATTR {
      return hn::ShiftRight<kSubpixelBits>(hn::Add(v, hn::Set(di, rounding)));
    };
    begin = hn::Max(first_from(low, kHalfPixel - 1), hn::Set(di, rect_begin));
    size = hn::Sub(hn::Min(first_from(high, kHalfPixel), hn::Set(di, rect_end)), begin);
    extent = hn::Sub(high, low);
  }
};

// Step 3. Finds which of the triangles [first, first + Survivors::kChunk) may cover a pixel.
HWY_INLINE void SetUp(const TinyTriangleTask& task, std::size_t first, Survivors* survivors,
                      std::vector<std::uint32_t>* larger) {
  const DI di;
  const DU du;
  const std::size_t end = std::min(first + Survivors::kChunk, task.triangles.size());
  const std::uint32_t* packed = task.vertices->packed.data();
  std::size_t count = 0;
  TriangleLanes triangle;
  for (std::size_t t = first; t < end; t += hn::Lanes(du)) {
    triangle.index = hn::Iota(du, static_cast<std::uint32_t>(t));
    LoadCorners(task.triangles, t, triangle.corners);
    for (std::size_t k = 0; k < 3; ++k) {
      triangle.xy[k] = hn::GatherIndex(du, packed, hn::BitCast(di, triangle.corners[k]));
    }
    const auto& [a, b, c] = triangle.xy;
    const BoxSide x(UnpackX(a), UnpackX(b), UnpackX(c), task.rect.begin_x - task.origin_x,
                    task.rect.end_x - task.origin_x);
    const BoxSide y(UnpackY(a), UnpackY(b), UnpackY(c), task.rect.begin_y - task.origin_y,
                    task.rect.end_y - task.origin_y);
    triangle.begin = Pack(x.begin, y.begin);
    triangle.size = Pack(x.size, y.size);
    const MI has_pixels = hn::Gt(hn::Min(x.size, y.size), hn::Zero(di));
    const MI is_tiny = hn::And(
        hn::Lt(hn::Max(x.size, y.size), hn::Set(di, kTinyBoxPx + 1)),
        hn::Lt(hn::Max(x.extent, y.extent), hn::Set(di, kSmallTrianglePx * kSubpixels + 1)));
    // Hand larger triangles to the caller, who fills them one at a time.
    const MI is_larger = hn::AndNot(is_tiny, has_pixels);
    if (!hn::AllFalse(di, is_larger)) [[unlikely]] {
      const Compressor compress(hn::RebindMask(du, is_larger));
      const std::size_t at = larger->size();
      larger->resize(at + kLaneSlack);
      hn::StoreU(compress(triangle.index), du, larger->data() + at);
      larger->resize(at + compress.count());
    }
    count = triangle.Store(hn::RebindMask(du, hn::And(has_pixels, is_tiny)), count, survivors);
  }
  // Boxes without pixels fill the lanes that FillSurvivors reads past the last survivor.
  const VU zero = hn::Zero(du);
  const TriangleLanes none{zero, {zero, zero, zero}, {zero, zero, zero}, zero, zero};
  none.Store(hn::FirstN(du, hn::Lanes(du)), count, survivors);
  survivors->count = count;
}

// Step 4. Appends the fragments of the survivors to `buffer`.
HWY_INLINE void FillSurvivors(const TinyTriangleTask& task, const Survivors& survivors,
                              FragmentBuffer* buffer, absl::FunctionRef<void()> flush) {
  const DI di;
  const DU du;
  const DF df;
  const VI zero = hn::Zero(di);
  const VI half_pixel = hn::Set(di, kHalfPixel);
  for (std::size_t i = 0; i < survivors.count; i += hn::Lanes(di)) {
    const TriangleLanes triangle = TriangleLanes::Load(survivors, i);
    const auto& [a, b, c] = triangle.xy;
    const VI ax = UnpackX(a);
    const VI ay = UnpackY(a);
    Sides sides{hn::Sub(UnpackX(b), ax), hn::Sub(UnpackY(b), ay), hn::Sub(UnpackX(c), ax),
                hn::Sub(UnpackY(c), ay)};
    const VI area = sides.Area();
    const auto depth_of = [&](std::size_t k) HWY_ATTR {
      return hn::GatherIndex(df, task.vertices->z.data(), hn::BitCast(di, triangle.corners[k]));
    };
    // Make the depth plane. It is the same, bit by bit, whichever of b and c comes first.
    const DepthPlane plane(sides, depth_of(0), depth_of(1), depth_of(2),
                           hn::Set(df, task.nearest_depth));
    // Exchange b and c of a clockwise triangle, so that all edge functions are positive inside.
    const MI is_clockwise = hn::Lt(area, zero);
    sides = {hn::IfThenElse(is_clockwise, sides.vx, sides.ux),
             hn::IfThenElse(is_clockwise, sides.vy, sides.uy),
             hn::IfThenElse(is_clockwise, sides.ux, sides.vx),
             hn::IfThenElse(is_clockwise, sides.uy, sides.vy)};
    // Begin at the centre of each box's first pixel. A triangle without area gets a box of width 0.
    const auto center = [half_pixel](VI pixel) HWY_ATTR {
      return hn::Add(hn::ShiftLeft<kSubpixelBits>(pixel), half_pixel);
    };
    Walk row(sides, hn::Sub(center(UnpackX(triangle.begin)), ax),
             hn::Sub(center(UnpackY(triangle.begin)), ay), 1);
    VU row_pixel = hn::Add(triangle.begin, SetPacked(task.origin_x, task.origin_y));
    const VI width = hn::IfThenZeroElse(hn::Eq(area, zero), UnpackX(triangle.size));
    const VI height = UnpackY(triangle.size);
    // Make room for every pixel of every box.
    if (buffer->count + kTinyBoxPixels * hn::Lanes(di) > FragmentBuffer::kCapacity) [[unlikely]] {
      flush();
      buffer->Extend(task.rect);
    }
    // Walk the rows and columns of all boxes in step, and append the covered pixels.
    for (std::int32_t y = 0; y < kTinyBoxPx; ++y) {
      const MI in_rows = hn::Lt(hn::Set(di, y), height);
      if (hn::AllFalse(di, in_rows)) {
        break;
      }
      const VF depth_of_row = plane.RowAt(row.y);
      Walk at = row;
      VU pixel = row_pixel;
      for (std::int32_t x = 0; x < kTinyBoxPx; ++x) {
        const MI in_box = hn::And(in_rows, hn::Lt(hn::Set(di, x), width));
        if (hn::AllFalse(di, in_box)) {
          break;
        }
        const MI covered = at.Covered(in_box);
        if (!hn::AllFalse(di, covered)) {
          Append(pixel, plane.BitsAt(depth_of_row, at.x), triangle.index,
                 hn::RebindMask(du, covered), buffer);
        }
        at.NextColumn();
        pixel = hn::Add(pixel, hn::Set(du, 1u));
      }
      row.NextRow();
      row_pixel = hn::Add(row_pixel, hn::Set(du, 1u << 16));
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
  const Sides sides{hn::Set(di, b.x - a.x), hn::Set(di, b.y - a.y), hn::Set(di, c.x - a.x),
                    hn::Set(di, c.y - a.y)};
  const DepthPlane plane(sides, hn::Set(df, a.z), hn::Set(df, b.z), hn::Set(df, c.z),
                         hn::Set(df, nearest_depth));
  // Each lane starts at its own column and steps by as many pixels as there are lanes.
  const VI column = hn::Iota(di, 0);
  const VI first_x = hn::Set(di, box.begin_x * kSubpixels + kHalfPixel - a.x);
  Walk row(sides, hn::Add(first_x, hn::ShiftLeft<kSubpixelBits>(column)),
           hn::Set(di, box.begin_y * kSubpixels + kHalfPixel - a.y), lanes);
  buffer->Extend(box);
  for (std::int32_t py = box.begin_y; py < box.end_y; ++py) {
    const VF depth_of_row = plane.RowAt(row.y);
    Walk at = row;
    for (std::int32_t px = box.begin_x; px < box.end_x; px += lanes) {
      const MI covered = at.Covered(hn::Lt(column, hn::Set(di, box.end_x - px)));
      if (!hn::AllFalse(di, covered)) {
        if (buffer->count + static_cast<std::size_t>(lanes) > FragmentBuffer::kCapacity)
            [[unlikely]] {
          flush();
          buffer->Extend(box);
        }
        Append(hn::Add(SetPacked(px, py), hn::BitCast(du, column)),
               plane.BitsAt(depth_of_row, at.x), hn::Set(du, triangle.index),
               hn::RebindMask(du, covered), buffer);
      }
      at.NextColumn();
    }
    row.NextRow();
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

HWY_EXPORT(FillTinyTriangles);
HWY_EXPORT(FillSmallTriangle);
HWY_EXPORT(Target);

// Fills a triangle of any size: the arithmetic of FillSmallTriangle, but with edge functions of 64
// bits, and pixel by pixel.
void FillLargeTriangle(const ScreenTriangle& triangle, float nearest_depth, FragmentBuffer* buffer,
                       absl::FunctionRef<void()> flush) {
  struct Edge {
    std::int64_t value, step_x, step_y;
  };
  const auto& [a, b, c] = triangle.v;
  const view::PixelRect& box = triangle.box;
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
  const auto edge = [](std::int64_t dx, std::int64_t dy, std::int64_t x, std::int64_t y) {
    const bool is_top_left = dy < 0 || (dy == 0 && dx > 0);
    return Edge{dx * y - dy * x - (is_top_left ? 0 : 1), -dy * kSubpixels, dx * kSubpixels};
  };
  const std::int64_t first_x = std::int64_t{box.begin_x} * kSubpixels + kSubpixels / 2 - a.x;
  std::int64_t y = std::int64_t{box.begin_y} * kSubpixels + kSubpixels / 2 - a.y;
  std::array row{edge(ux, uy, first_x, y), edge(vx - ux, vy - uy, first_x - ux, y - uy),
                 edge(-vx, -vy, first_x, y)};
  buffer->Extend(box);
  for (std::int32_t py = box.begin_y; py < box.end_y; ++py, y += kSubpixels) {
    const float depth_of_row = a.z + depth_per_y * static_cast<float>(y);
    std::int64_t x = first_x;
    std::array at = row;
    for (std::int32_t px = box.begin_x; px < box.end_x; ++px, x += kSubpixels) {
      if ((at[0].value | at[1].value | at[2].value) >= 0) {
        if (buffer->count == FragmentBuffer::kCapacity) [[unlikely]] {
          flush();
          buffer->Extend(box);
        }
        const float plane = depth_of_row + depth_per_x * static_cast<float>(x);
        const float depth = std::min(std::max(plane, low), high) + 0.0F;
        buffer->pixels[buffer->count] =
            static_cast<std::uint32_t>(px) | static_cast<std::uint32_t>(py) << 16;
        buffer->depths[buffer->count] = std::bit_cast<std::uint32_t>(depth);
        buffer->triangles[buffer->count] = triangle.index;
        ++buffer->count;
      }
      for (Edge& edge_at : at) {
        edge_at.value += edge_at.step_x;
      }
    }
    for (Edge& edge_at : row) {
      edge_at.value += edge_at.step_y;
    }
  }
}

}  // namespace

void FragmentBuffer::Extend(const view::PixelRect& rect) {
  if (bounds.empty()) {
    bounds = rect;
    return;
  }
  bounds = {std::min(bounds.begin_x, rect.begin_x), std::min(bounds.begin_y, rect.begin_y),
            std::max(bounds.end_x, rect.end_x), std::max(bounds.end_y, rect.end_y)};
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
