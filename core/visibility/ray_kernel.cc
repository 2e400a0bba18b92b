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

// This file is compiled once for each instruction set; the processor's best one is called.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/visibility/ray_kernel.cc"
#include "hwy/foreach_target.h"  // IWYU pragma: keep
//
#include "core/visibility/ray_packet-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::visibility::HWY_NAMESPACE {
namespace {

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

using I64 = hn::RebindToSigned<F64>;

// Returns the id of the blocks that walks start in. Whole numbers below 2^53: exact.
VecF64 FirstIds(F64 d, const RayScene& scene, const WalkStarts& walks) {
  auto id = hn::Zero(d);
  for (std::size_t a = 3; a-- > 0;) {
    id =
        hn::Add(hn::Mul(id, hn::Set(d, static_cast<double>(scene.block_dims[static_cast<int>(a)]))),
                hn::Load(d, walks.index[a].data()));
  }
  return id;
}

// Returns the steps left of walks at their start, as StepFields. Whole numbers below 2^53: exact.
VecF64 FirstStepsLeft(F64 d, const RayScene& scene, const StepFields& fields, const RayLanes& rays,
                      const WalkStarts& walks) {
  auto steps_left = hn::Zero(d);
  for (std::size_t a = 0; a < 3; ++a) {
    const auto index = hn::Load(d, walks.index[a].data());
    const auto direction = hn::Load(d, rays.direction[a].data());
    const auto last = hn::Set(d, static_cast<double>(scene.block_dims[static_cast<int>(a)] - 1));
    const auto steps = hn::IfThenZeroElse(
        hn::Eq(direction, hn::Zero(d)),
        hn::IfThenElse(hn::Gt(direction, hn::Zero(d)), hn::Sub(last, index), index));
    steps_left =
        hn::Add(steps_left, hn::Mul(steps, hn::Set(d, static_cast<double>(fields.one[a]))));
  }
  return steps_left;
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
  WalkStarts walks;
  if (!StartWalks(d, scene, rays, &walks)) {
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
  auto id = hn::BitCast(du, hn::ConvertTo(di, FirstIds(d, scene, walks)));
  auto steps_left =
      hn::BitCast(du, hn::ConvertTo(di, FirstStepsLeft(d, scene, fields, rays, walks)));
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
