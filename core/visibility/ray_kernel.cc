// Casts rays, as many at a time as a register has doubles, each through the grid of blocks up to
// its first active one:
//
//   1. MakeRays: origin and direction in index space, through the centres of neighbouring boundary
//      faces, or through random points of neighbouring cells of the image plane.
//   2. StartWalks: clip to the volume by slabs; the block of entry; for each axis t of the next
//      block boundary and t from one boundary to the next.
//   3. WalkRays: test the block's bit; then cross the boundary that comes first, of equal ones that
//      of the lowest axis, and add that axis' stride to the block id.
//
// Steps left on the three axes share one 64-bit word, so one subtraction counts and one test ends a
// walk. Each axis has a field of bit_width(blocks - 1) bits, and above it an overrun bit that is
// set when the field goes below 0. For 5 x 4 x 3 blocks:
//
//        bit    9    8 7    6    5 4    3    2 1 0
//               |     z     |     y     |      x         one step: x 1 << 0, y 1 << 4, z 1 << 7
//            overrun     overrun     overrun             overrun bits: 3, 6, 9
//
// Invariants: each step uses up one of these, so a walk ends after at most x + y + z steps however
// t is rounded, and its block id always exists. Whole numbers below 2^53 are exact in double. Lanes
// do not influence each other, so the hits do not depend on the width of registers.
//
// Source of the walk: Amanatides and Woo 1987, section 2 (references.bib: amanatides-woo).

#include "core/visibility/ray_kernel.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <limits>

#include "core/base/random.h"

// This file is compiled once for each instruction set; the processor's best one is called.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/visibility/ray_kernel.cc"
#include "hwy/foreach_target.h"  // IWYU pragma: keep
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::visibility::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using F64 = hn::CappedTag<double, 8>;
using I64 = hn::RebindToSigned<F64>;
using U64 = hn::RebindToUnsigned<F64>;
using VecF64 = hn::Vec<F64>;

constexpr std::size_t kMaxLanes = 8;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Face centres up to this factor outside the image are still cast: their block may reach into it.
constexpr double kViewportSlack = 1.02;

using LaneArray = std::array<double, kMaxLanes>;

// A packet of rays, one to a lane.
struct alignas(64) RayLanes {
  std::array<LaneArray, 3> origin;
  std::array<LaneArray, 3> direction;
  LaneArray t_end;  // infinity; below 0: no ray in this lane
};

// Returns element `row` of the matrix times (x, y, z, 1), by the operations of math::Mat4d in their
// order.
VecF64 TransformRow(F64 d, const math::Mat4d& m, std::size_t row, VecF64 x, VecF64 y, VecF64 z) {
  const auto in_plane =
      hn::Add(hn::Mul(hn::Set(d, m.At(row, 0)), x), hn::Mul(hn::Set(d, m.At(row, 1)), y));
  return hn::Add(hn::Add(in_plane, hn::Mul(hn::Set(d, m.At(row, 2)), z)), hn::Set(d, m.At(row, 3)));
}

void StoreRays(F64 d, const math::Vec3d& origin, VecF64 dx, VecF64 dy, VecF64 dz, RayLanes* rays) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    hn::Store(hn::Set(d, origin[static_cast<int>(axis)]), d, rays->origin[axis].data());
  }
  hn::Store(dx, d, rays->direction[0].data());
  hn::Store(dy, d, rays->direction[1].data());
  hn::Store(dz, d, rays->direction[2].data());
}
void StoreRays(F64 d, VecF64 ox, VecF64 oy, VecF64 oz, const math::Vec3d& direction,
               RayLanes* rays) {
  hn::Store(ox, d, rays->origin[0].data());
  hn::Store(oy, d, rays->origin[1].data());
  hn::Store(oz, d, rays->origin[2].data());
  for (std::size_t axis = 0; axis < 3; ++axis) {
    hn::Store(hn::Set(d, direction[static_cast<int>(axis)]), d, rays->direction[axis].data());
  }
}

// Sets t_end: lanes [0, count) that are `shown` have a ray.
void StoreEnds(F64 d, hn::Mask<F64> shown, std::size_t count, RayLanes* rays) {
  const auto has_ray = hn::And(shown, hn::FirstN(d, count));
  hn::Store(hn::IfThenElse(has_ray, hn::Set(d, kInfinity), hn::Set(d, -1.0)), d,
            rays->t_end.data());
}

// Step 1 for faces: makes the rays through the centres of `count` boundary faces from `column` on.
void MakeFaceRays(F64 d, const RayScene& scene, const RayRow& row, std::int64_t column,
                  std::size_t count, RayLanes* rays) {
  const int u = (row.axis + 1) % 3;
  const int v = (row.axis + 2) % 3;
  // Sums of whole numbers: exact.
  const auto begin_u = hn::Mul(hn::Add(hn::Iota(d, 0.0), hn::Set(d, static_cast<double>(column))),
                               hn::Set(d, scene.block_size[u]));
  const auto end_u =
      hn::Min(hn::Add(begin_u, hn::Set(d, scene.block_size[u])), hn::Set(d, scene.size[u]));
  const auto center_u = hn::Mul(hn::Set(d, 0.5), hn::Add(begin_u, end_u));
  const double begin_v = static_cast<double>(row.row) * scene.block_size[v];
  const double end_v = std::min(begin_v + scene.block_size[v], scene.size[v]);
  const auto center_v = hn::Set(d, 0.5 * (begin_v + end_v));
  const auto center_axis = hn::Set(d, row.is_upper ? scene.size[row.axis] : 0.0);
  const auto x = u == 0 ? center_u : v == 0 ? center_v : center_axis;
  const auto y = u == 1 ? center_u : v == 1 ? center_v : center_axis;
  const auto z = u == 2 ? center_u : v == 2 ? center_v : center_axis;

  const auto clip_x = TransformRow(d, scene.clip_from_index, 0, x, y, z);
  const auto clip_y = TransformRow(d, scene.clip_from_index, 1, x, y, z);
  const auto clip_w = TransformRow(d, scene.clip_from_index, 3, x, y, z);
  const auto reach = hn::Mul(hn::Set(d, kViewportSlack), clip_w);
  const auto outside = hn::Or(hn::Gt(hn::Abs(clip_x), reach), hn::Gt(hn::Abs(clip_y), reach));
  StoreEnds(d, hn::AndNot(outside, hn::Gt(clip_w, hn::Zero(d))), count, rays);

  if (scene.is_perspective) {
    StoreRays(d, scene.eye, hn::Sub(x, hn::Set(d, scene.eye.x)),
              hn::Sub(y, hn::Set(d, scene.eye.y)), hn::Sub(z, hn::Set(d, scene.eye.z)), rays);
    return;
  }
  const auto offset_x =
      hn::Sub(TransformRow(d, scene.world_from_index, 0, x, y, z), hn::Set(d, scene.world_eye.x));
  const auto offset_y =
      hn::Sub(TransformRow(d, scene.world_from_index, 1, x, y, z), hn::Set(d, scene.world_eye.y));
  const auto offset_z =
      hn::Sub(TransformRow(d, scene.world_from_index, 2, x, y, z), hn::Set(d, scene.world_eye.z));
  const auto distance = hn::Add(hn::Add(hn::Mul(hn::Set(d, scene.world_forward.x), offset_x),
                                        hn::Mul(hn::Set(d, scene.world_forward.y), offset_y)),
                                hn::Mul(hn::Set(d, scene.world_forward.z), offset_z));
  const auto back = hn::Sub(hn::Set(d, scene.near_distance), distance);
  StoreRays(d, hn::Add(x, hn::Mul(hn::Set(d, scene.forward.x), back)),
            hn::Add(y, hn::Mul(hn::Set(d, scene.forward.y), back)),
            hn::Add(z, hn::Mul(hn::Set(d, scene.forward.z), back)), scene.forward, rays);
}

// Step 1 for the image plane: makes `count` rays through random points of the cells from `column`
// on.
void MakeImageRays(F64 d, const RayScene& scene, const RayRow& row, std::int64_t column,
                   std::size_t count, RayLanes* rays) {
  // Ray indices alternate in direction from row to row; the random numbers of a ray follow from its
  // index.
  const bool is_forth = row.row % 2 == 0;
  const std::int64_t first =
      row.row * scene.grid_columns + (is_forth ? column : scene.grid_columns - 1 - column);
  alignas(64) LaneArray random_x{};
  alignas(64) LaneArray random_y{};
  for (std::size_t lane = 0; lane < count; ++lane) {
    const auto step = static_cast<std::int64_t>(lane);
    const auto counter = static_cast<std::uint64_t>(first + (is_forth ? step : -step)) * 2;
    random_x[lane] = base::RandomUnit(scene.seed, counter);
    random_y[lane] = base::RandomUnit(scene.seed, counter + 1);
  }
  const auto columns = hn::Add(hn::Iota(d, 0.0), hn::Set(d, static_cast<double>(column)));
  const auto x = hn::Div(hn::Add(columns, hn::Load(d, random_x.data())),
                         hn::Set(d, static_cast<double>(scene.grid_columns)));
  const auto y =
      hn::Div(hn::Add(hn::Set(d, static_cast<double>(row.row)), hn::Load(d, random_y.data())),
              hn::Set(d, static_cast<double>(scene.grid_rows)));
  const auto right = hn::Sub(hn::Mul(hn::Set(d, 2.0), x), hn::Set(d, 1.0));
  const auto up = hn::Sub(hn::Set(d, 1.0), hn::Mul(hn::Set(d, 2.0), y));
  const auto offset = [&](int axis) HWY_ATTR {
    return hn::Add(hn::Mul(hn::Set(d, scene.half_right[axis]), right),
                   hn::Mul(hn::Set(d, scene.half_up[axis]), up));
  };
  StoreEnds(d, hn::FirstN(d, count), count, rays);
  if (scene.is_perspective) {
    const auto direction = [&](int axis) HWY_ATTR {
      return hn::Add(hn::Set(d, scene.forward[axis]), offset(axis));
    };
    StoreRays(d, scene.eye, direction(0), direction(1), direction(2), rays);
    return;
  }
  const auto origin = [&](int axis) HWY_ATTR {
    return hn::Add(hn::Add(hn::Set(d, scene.eye[axis]), offset(axis)),
                   hn::Set(d, scene.forward[axis] * scene.near_distance));
  };
  StoreRays(d, origin(0), origin(1), origin(2), scene.forward, rays);
}

void MakeRays(F64 d, const RayScene& scene, const RayRow& row, std::int64_t column,
              std::size_t count, RayLanes* rays) {
  if (row.axis < 0) {
    MakeImageRays(d, scene, row, column, count, rays);
  } else {
    MakeFaceRays(d, scene, row, column, count, rays);
  }
}

// The layout of the word that counts the steps left on each axis (head of this file). Block ids
// have 32 bits, so the three fields and their overrun bits fit.
struct StepFields {
  explicit StepFields(const math::Index3& dims) {
    int shift = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto last = static_cast<std::uint64_t>(dims[static_cast<int>(axis)] - 1);
      one[axis] = std::uint64_t{1} << shift;
      shift += static_cast<int>(std::bit_width(last));
      overrun |= std::uint64_t{1} << shift;
      ++shift;
    }
  }
  std::array<std::uint64_t, 3> one{};  // one step on each axis
  std::uint64_t overrun = 0;           // the bits above the fields
};

// The first state of the walks of a packet.
struct alignas(64) WalkLanes {
  std::array<LaneArray, 3> t_next;  // t of the next block boundary
  std::array<LaneArray, 3> t_step;  // from one boundary to the next
  LaneArray t_exit;                 // where the ray leaves the volume; below 0: no walk
  LaneArray id;                     // first block
  LaneArray steps_left;             // as StepFields
};

// Step 2 clips the rays to the volume and finds their first blocks. False if no ray meets the
// volume; t_exit is below 0 in the lanes of rays that do not.
bool StartWalks(F64 d, const RayScene& scene, const StepFields& fields, const RayLanes& rays,
                WalkLanes* walks) {
  const auto zero = hn::Zero(d);
  auto t_enter = zero;
  auto t_exit = hn::Load(d, rays.t_end.data());
  auto enter_axis = hn::Set(d, -1.0);
  for (std::size_t a = 0; a < 3; ++a) {
    const auto size = hn::Set(d, scene.size[static_cast<int>(a)]);
    const auto origin = hn::Load(d, rays.origin[a].data());
    const auto direction = hn::Load(d, rays.direction[a].data());
    const auto is_parallel = hn::Eq(direction, zero);
    const auto t_low = hn::Div(hn::Sub(zero, origin), direction);
    const auto t_high = hn::Div(hn::Sub(size, origin), direction);
    const auto is_later = hn::AndNot(is_parallel, hn::Gt(hn::Min(t_low, t_high), t_enter));
    t_enter = hn::IfThenElse(is_later, hn::Min(t_low, t_high), t_enter);
    enter_axis = hn::IfThenElse(is_later, hn::Set(d, static_cast<double>(a)), enter_axis);
    const auto is_between = hn::And(hn::Ge(origin, zero), hn::Le(origin, size));
    t_exit = hn::IfThenElse(is_parallel, hn::IfThenElse(is_between, t_exit, hn::Set(d, -1.0)),
                            hn::Min(t_exit, hn::Max(t_low, t_high)));
  }
  const auto is_met = hn::Le(t_enter, t_exit);
  if (hn::AllFalse(d, is_met)) {
    return false;
  }
  hn::Store(hn::IfThenElse(is_met, t_exit, hn::Set(d, -1.0)), d, walks->t_exit.data());

  auto id = zero;
  auto steps_left = zero;
  double stride = 1;
  for (std::size_t a = 0; a < 3; ++a) {
    const int axis = static_cast<int>(a);
    const auto origin = hn::Load(d, rays.origin[a].data());
    const auto direction = hn::Load(d, rays.direction[a].data());
    const auto block_size = hn::Set(d, scene.block_size[axis]);
    const auto last = hn::Set(d, static_cast<double>(scene.block_dims[axis] - 1));
    const auto is_parallel = hn::Eq(direction, zero);
    const auto is_forward = hn::Gt(direction, zero);
    // On the axis of entry the index is 0 or the last: the quotient might round across the face.
    const auto position = hn::Add(origin, hn::Mul(direction, t_enter));
    const auto cell = hn::Floor(hn::Div(position, block_size));
    const auto inside = hn::IfThenElseZero(hn::Gt(cell, zero), hn::Min(cell, last));
    const auto index = hn::IfThenElse(hn::Eq(enter_axis, hn::Set(d, static_cast<double>(a))),
                                      hn::IfThenElse(is_forward, zero, last), inside);
    const auto boundary =
        hn::Mul(hn::IfThenElse(is_forward, hn::Add(index, hn::Set(d, 1.0)), index), block_size);
    hn::Store(hn::IfThenElse(is_parallel, hn::Set(d, kInfinity),
                             hn::Div(hn::Sub(boundary, origin), direction)),
              d, walks->t_next[a].data());
    hn::Store(hn::IfThenZeroElse(is_parallel, hn::Div(block_size, hn::Abs(direction))), d,
              walks->t_step[a].data());
    const auto steps =
        hn::IfThenZeroElse(is_parallel, hn::IfThenElse(is_forward, hn::Sub(last, index), index));
    // Whole numbers below 2^53: exact.
    id = hn::Add(id, hn::Mul(index, hn::Set(d, stride)));
    steps_left =
        hn::Add(steps_left, hn::Mul(steps, hn::Set(d, static_cast<double>(fields.one[a]))));
    stride *= static_cast<double>(scene.block_dims[axis]);
  }
  hn::Store(hn::IfThenElseZero(is_met, id), d, walks->id.data());
  hn::Store(hn::IfThenElseZero(is_met, steps_left), d, walks->steps_left.data());
  return true;
}

// Returns the change of the block id by a step along an axis.
hn::Vec<U64> IdStep(F64 d, const RayLanes& rays, std::size_t axis, std::int64_t stride) {
  const U64 du;
  const auto is_forward = hn::Gt(hn::Load(d, rays.direction[axis].data()), hn::Zero(d));
  return hn::IfThenElse(hn::RebindMask(du, is_forward),
                        hn::Set(du, static_cast<std::uint64_t>(stride)),
                        hn::Set(du, static_cast<std::uint64_t>(-stride)));
}

// Step 3 walks all rays of a packet in parallel until each has met an active block or left the
// volume, and inserts the blocks met into `hits`.
void WalkRays(F64 d, const RayScene& scene, const StepFields& fields, const RayLanes& rays,
              const std::uint64_t* active, std::uint64_t* hits) {
  WalkLanes walks;
  if (!StartWalks(d, scene, fields, rays, &walks)) {
    return;
  }
  const I64 di;
  const U64 du;
  auto t_next_x = hn::Load(d, walks.t_next[0].data());
  auto t_next_y = hn::Load(d, walks.t_next[1].data());
  auto t_next_z = hn::Load(d, walks.t_next[2].data());
  const auto t_step_x = hn::Load(d, walks.t_step[0].data());
  const auto t_step_y = hn::Load(d, walks.t_step[1].data());
  const auto t_step_z = hn::Load(d, walks.t_step[2].data());
  const auto t_exit = hn::Load(d, walks.t_exit.data());
  const auto id_step_x = IdStep(d, rays, 0, 1);
  const auto id_step_y = IdStep(d, rays, 1, scene.block_dims.x);
  const auto id_step_z = IdStep(d, rays, 2, scene.block_dims.x * scene.block_dims.y);
  const auto one_x = hn::Set(du, fields.one[0]);
  const auto one_y = hn::Set(du, fields.one[1]);
  const auto one_z = hn::Set(du, fields.one[2]);
  const auto overrun = hn::Set(du, fields.overrun);
  auto id = hn::BitCast(du, hn::ConvertTo(di, hn::Load(d, walks.id.data())));
  auto steps_left = hn::BitCast(du, hn::ConvertTo(di, hn::Load(d, walks.steps_left.data())));
  // A ray that has hit still walks until all have, so that the next step need not wait for the
  // gather.
  auto is_inside = hn::Ge(t_exit, hn::Zero(d));
  auto is_searching = is_inside;
  auto has_hit = hn::Lt(t_exit, t_exit);  // none
  auto hit_id = id;

  // Every step uses up one of steps_left, so the walk ends whatever the rounding.
  while (true) {
    const auto words = hn::GatherIndex(du, active, hn::BitCast(di, hn::ShiftRight<6>(id)));
    const auto bit = hn::And(hn::Shr(words, hn::And(id, hn::Set(du, 63))), hn::Set(du, 1));
    const auto is_hit = hn::And(is_searching, hn::RebindMask(d, hn::Eq(bit, hn::Set(du, 1))));
    hit_id = hn::IfThenElse(hn::RebindMask(du, is_hit), id, hit_id);
    has_hit = hn::Or(has_hit, is_hit);

    // The axis whose boundary comes first; of equal ones the lower.
    const auto x_before_y = hn::Le(t_next_x, t_next_y);
    const auto along_x = hn::And(x_before_y, hn::Le(t_next_x, t_next_z));
    const auto along_y = hn::AndNot(x_before_y, hn::Le(t_next_y, t_next_z));
    const auto t = hn::IfThenElse(along_x, t_next_x, hn::IfThenElse(along_y, t_next_y, t_next_z));
    const auto along_x_int = hn::RebindMask(du, along_x);
    const auto along_y_int = hn::RebindMask(du, along_y);
    steps_left = hn::Sub(
        steps_left, hn::IfThenElse(along_x_int, one_x, hn::IfThenElse(along_y_int, one_y, one_z)));
    // The last block of an axis may be smaller than a step: there t_exit ends the walk.
    is_inside =
        hn::And(is_inside,
                hn::AndNot(hn::Gt(t, t_exit),
                           hn::RebindMask(d, hn::Eq(hn::And(steps_left, overrun), hn::Zero(du)))));
    is_searching = hn::AndNot(is_hit, hn::And(is_searching, is_inside));
    if (hn::AllFalse(d, is_searching)) {
      break;
    }
    id = hn::Add(
        id, hn::IfThenElseZero(hn::RebindMask(du, is_inside),
                               hn::IfThenElse(along_x_int, id_step_x,
                                              hn::IfThenElse(along_y_int, id_step_y, id_step_z))));
    t_next_x = hn::IfThenElse(along_x, hn::Add(t_next_x, t_step_x), t_next_x);
    t_next_y = hn::IfThenElse(along_y, hn::Add(t_next_y, t_step_y), t_next_y);
    t_next_z = hn::IfThenElse(hn::Or(along_x, along_y), t_next_z, hn::Add(t_next_z, t_step_z));
  }

  alignas(64) std::array<std::uint64_t, kMaxLanes> ids;
  hn::Store(hit_id, du, ids.data());
  std::array<std::uint8_t, 8> hit_bits{};
  hn::StoreMaskBits(d, has_hit, hit_bits.data());
  for (unsigned bits = hit_bits[0]; bits != 0; bits &= bits - 1) {
    const std::uint64_t hit = ids[static_cast<std::size_t>(std::countr_zero(bits))];
    hits[hit / 64] |= std::uint64_t{1} << (hit % 64);
  }
}

void CastRowOnTarget(const RayScene& scene, const RayRow& row, std::int64_t begin_column,
                     std::int64_t end_column, const std::uint64_t* active, std::uint64_t* hits) {
  const F64 d;
  const auto lane_count = static_cast<std::int64_t>(hn::Lanes(d));
  const StepFields fields(scene.block_dims);
  RayLanes rays;
  for (std::int64_t column = begin_column; column < end_column; column += lane_count) {
    MakeRays(d, scene, row, column,
             static_cast<std::size_t>(std::min(lane_count, end_column - column)), &rays);
    WalkRays(d, scene, fields, rays, active, hits);
  }
}

bool MakeRayOnTarget(const RayScene& scene, const RayRow& row, std::int64_t column,
                     math::Vec3d* origin, math::Vec3d* direction) {
  RayLanes rays;
  MakeRays(F64(), scene, row, column, 1, &rays);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    (*origin)[static_cast<int>(axis)] = rays.origin[axis][0];
    (*direction)[static_cast<int>(axis)] = rays.direction[axis][0];
  }
  return rays.t_end[0] > 0;
}

}  // namespace
}  // namespace isoscope::visibility::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isoscope::visibility {
namespace {
HWY_EXPORT(CastRowOnTarget);
HWY_EXPORT(MakeRayOnTarget);
}  // namespace

void CastRow(const RayScene& scene, const RayRow& row, std::int64_t begin_column,
             std::int64_t end_column, const std::uint64_t* active, std::uint64_t* hits) {
  HWY_DYNAMIC_DISPATCH(CastRowOnTarget)(scene, row, begin_column, end_column, active, hits);
}

bool MakeRay(const RayScene& scene, const RayRow& row, std::int64_t column, math::Vec3d* origin,
             math::Vec3d* direction) {
  return HWY_DYNAMIC_DISPATCH(MakeRayOnTarget)(scene, row, column, origin, direction);
}

}  // namespace isoscope::visibility
#endif  // HWY_ONCE
