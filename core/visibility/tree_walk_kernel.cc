// Walks rays through a tree of active blocks (volume::BlockTree), as many at a time as a register
// has doubles. Hits are bit for bit those of the walk from block to block (ray_kernel.cc):
//
//   1. A ray that is d bricks away from every brick with members crosses the cube of 2 d - 1 bricks
//      around its own at once (CrossCubes).
//   2. In another brick it walks from block to block, and tests the bits of the brick's word
//      (CrossBricks).
//
// Why the hits are equal. The walk crosses, on each axis, boundaries at t_next, t_next + t_step, and
// so on, rounded each time: an ascending sequence. It takes the three in the order of t, of equal
// ones that of the lowest axis first. So the boundary that leaves a cube is the least, in that
// order, of those that leave it on each axis. The boundaries that are crossed until then are those
// before it. Nothing in between is active, so nothing is lost, if the sums are the same: they
// follow from few operations (repeated_sum.h). The walk ends in the cube if that boundary lies
// beyond t_exit, or if an axis has left the volume; in both cases without a hit.
//
// In registers, sums are one product away while they stay in a binade: t_next below t_limit adds
// t_increment. The number of boundaries before a given t is guessed by a quotient, moved by one if
// it must, and verified. A lane where that fails, or that may pass its limit, is done by itself
// (CrossCube), whatever the binades.
//
// Positions count blocks in the direction of the ray, so that every ray walks upward: one that goes
// down an axis is at position 4 * bricks - 1 - index. Example: 10 blocks are 3 bricks. A ray that
// enters at block 9 and goes down begins at position 2 of 12, in the first brick that it meets.
//
// Source of the walk: Amanatides and Woo 1987, section 2 (references.bib: amanatides-woo).

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "core/visibility/ray_kernel.h"
#include "core/visibility/repeated_sum.h"
#include "core/volume/block_tree.h"

// This file is compiled once for each instruction set; the processor's best one is called.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/visibility/tree_walk_kernel.cc"
#include "hwy/foreach_target.h"  // IWYU pragma: keep
//
#include "core/visibility/ray_packet-inl.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::visibility::HWY_NAMESPACE {
namespace {

constexpr double kBrickSide = volume::BlockTree::kBrickSide;

// The walks of a packet (head of this file).
struct alignas(64) WalkLanes {
  std::array<LaneArray, 3> t_next;        // t of the next block boundary
  std::array<LaneArray, 3> t_step;        // from one boundary to the next
  std::array<LaneArray, 3> inverse_step;  // about 1 / t_step
  std::array<LaneArray, 3> position;      // of the block that the ray is in
  std::array<LaneArray, 3> end;           // the walk ends at this position
  std::array<LaneArray, 3> first;         // block index = first + sign * position
  std::array<LaneArray, 3> sign;
  LaneArray t_exit;  // where the ray leaves the volume; below 0: no walk
};

// Makes walks of their starts. Whole numbers below 2^53: exact.
void MakeWalks(F64 d, const RayScene& scene, const ActiveTree& active, const RayLanes& rays,
               const WalkStarts& starts, WalkLanes* walks) {
  const auto one = hn::Set(d, 1.0);
  walks->t_next = starts.t_next;
  walks->t_step = starts.t_step;
  walks->t_exit = starts.t_exit;
  for (std::size_t a = 0; a < 3; ++a) {
    const int axis = static_cast<int>(a);
    const auto direction = hn::Load(d, rays.direction[a].data());
    const auto index = hn::Load(d, starts.index[a].data());
    const auto is_backward = hn::Lt(direction, hn::Zero(d));
    const auto is_parallel = hn::Eq(direction, hn::Zero(d));
    const auto block_count = hn::Set(d, static_cast<double>(scene.block_dims[axis]));
    const auto mirror = hn::Set(d, kBrickSide * static_cast<double>(active.brick_dims[axis]));
    const auto first = hn::IfThenElseZero(is_backward, hn::Sub(mirror, one));
    const auto position = hn::IfThenElse(is_backward, hn::Sub(first, index), index);
    hn::Store(hn::Div(hn::Abs(direction), hn::Set(d, scene.block_size[axis])), d,
              walks->inverse_step[a].data());
    hn::Store(position, d, walks->position[a].data());
    hn::Store(hn::IfThenElse(is_parallel, hn::Add(position, one),
                             hn::IfThenElse(is_backward, mirror, block_count)),
              d, walks->end[a].data());
    hn::Store(first, d, walks->first[a].data());
    hn::Store(hn::IfThenElse(is_backward, hn::Set(d, -1.0), one), d, walks->sign[a].data());
  }
}

// Returns true if boundary `a`, of axis `axis_a`, is crossed before boundary `b`.
bool IsBefore(double a, std::size_t axis_a, double b, std::size_t axis_b) {
  return a < b || (a == b && axis_a < axis_b);
}

// Crosses, in one lane, the rest of its cube, by any number of binades. Returns false if the walk
// ends there. `reach`: as CubeLanes.
bool CrossCube(std::size_t lane, double reach, WalkLanes* walks) {
  std::array<std::int64_t, 3> rest{};  // boundaries up to and with the one that leaves the cube
  std::array<double, 3> t_leave{};
  for (std::size_t a = 0; a < 3; ++a) {
    const double position = walks->position[a][lane];
    const double begin = kBrickSide * std::floor(position / kBrickSide);
    rest[a] = static_cast<std::int64_t>(begin + reach - position);
    t_leave[a] = RepeatedSum(walks->t_next[a][lane], walks->t_step[a][lane], rest[a] - 1);
  }
  std::size_t exit = IsBefore(t_leave[1], 1, t_leave[0], 0) ? 1 : 0;
  exit = IsBefore(t_leave[2], 2, t_leave[exit], exit) ? 2 : exit;
  if (t_leave[exit] > walks->t_exit[lane]) {
    return false;
  }
  for (std::size_t a = 0; a < 3; ++a) {
    double& t_next = walks->t_next[a][lane];
    const double t_step = walks->t_step[a][lane];
    if (a == exit) {
      t_next = t_leave[a] + t_step;
      walks->position[a][lane] += static_cast<double>(rest[a]);
    } else if (IsBefore(t_next, a, t_leave[exit], exit)) {
      // How many boundaries come before: about the quotient, exactly by the sums themselves.
      const double quotient = (t_leave[exit] - t_next) / t_step;
      std::int64_t count = 1;
      if (quotient > 1) {
        count = std::min(static_cast<std::int64_t>(std::min(quotient, 0x1p40)), rest[a] - 1);
      }
      double t = RepeatedSum(t_next, t_step, count);
      for (; IsBefore(t, a, t_leave[exit], exit); ++count) {
        t += t_step;
      }
      for (; count > 1; --count) {
        const double t_before = RepeatedSum(t_next, t_step, count - 1);
        if (IsBefore(t_before, a, t_leave[exit], exit)) {
          break;
        }
        t = t_before;
      }
      t_next = t;
      walks->position[a][lane] += static_cast<double>(count);
    }
  }
  // A cube may reach beyond the volume: any axis may have left it.
  return walks->position[0][lane] < walks->end[0][lane] &&
         walks->position[1][lane] < walks->end[1][lane] &&
         walks->position[2][lane] < walks->end[2][lane];
}

// Of the lanes that walk: the cubes without an active block that they are in, or the members of
// their bricks.
struct alignas(64) CubeLanes {
  LaneArray reach;  // blocks from the begin of the brick to the end of the cube
  std::array<std::uint64_t, kMaxLanes> word;
  std::array<std::uint64_t, kMaxLanes> bit;   // of the block in the word
  std::array<std::uint32_t, kMaxLanes> cell;  // the index of the word
};

// Looks up the bricks of the lanes `searching`. Returns those that are in a cube larger than a brick
// without an active block.
unsigned LookUp(const ActiveTree& active, unsigned searching, const LaneArray& codes,
                CubeLanes* cubes) {
  constexpr std::uint32_t kLarger = volume::BlockTree::kEmpty + 2;
  unsigned in_cubes = 0;
  for (unsigned lanes = searching; lanes != 0; lanes &= lanes - 1) {
    const auto lane = static_cast<std::size_t>(std::countr_zero(lanes));
    const std::uint64_t code =
        std::bit_cast<std::uint64_t>(codes[lane]) & ((std::uint64_t{1} << 52) - 1);
    const std::uint32_t cell = active.cells[code >> 6];
    if (cell >= kLarger) {
      in_cubes |= 1U << lane;
      cubes->reach[lane] = kBrickSide * static_cast<double>(cell - volume::BlockTree::kEmpty);
      continue;
    }
    cubes->cell[lane] = cell;
    cubes->word[lane] = cell < volume::BlockTree::kEmpty ? active.words[cell] : 0;
    cubes->bit[lane] = code & 63;
  }
  return in_cubes;
}

// One axis of the walks in registers.
struct AxisLanes {
  VecF64 t_next;
  VecF64 position;
  // While t_next stays below t_limit, each further boundary adds exactly t_increment
  // (repeated_sum.h). A limit of 0: not known.
  VecF64 t_increment;
  VecF64 t_limit;
};

void LoadAxes(F64 d, const WalkLanes& walks, std::array<AxisLanes, 3>* axes) {
  for (std::size_t a = 0; a < 3; ++a) {
    AxisLanes& axis = (*axes)[a];
    axis.t_next = hn::Load(d, walks.t_next[a].data());
    axis.position = hn::Load(d, walks.position[a].data());
  }
}

// Finds the increments of the axes whose limit is not known, or reached (repeated_sum.h).
void FindIncrements(F64 d, const WalkLanes& walks, std::array<AxisLanes, 3>* axes) {
  const U64 du;
  for (std::size_t a = 0; a < 3; ++a) {
    AxisLanes& axis = (*axes)[a];
    const auto step = hn::Load(d, walks.t_step[a].data());
    const auto first = hn::Add(axis.t_next, step);
    const auto second = hn::Add(first, step);
    const auto increment = hn::Sub(first, axis.t_next);
    const auto exponent = hn::ShiftRight<52>(hn::BitCast(du, axis.t_next));
    // Above 0, finite, and no sum is a tie between an odd multiple and an even one.
    const auto is_known = hn::And(
        hn::And(hn::Ge(axis.t_next, hn::Set(d, std::numeric_limits<double>::min())),
                hn::Lt(second, hn::Set(d, kInfinity))),
        hn::And(hn::Eq(hn::Sub(second, first), increment),
                hn::RebindMask(d, hn::Eq(exponent, hn::ShiftRight<52>(hn::BitCast(du, second))))));
    const auto end =
        hn::BitCast(d, hn::ShiftLeft<52>(hn::Add(exponent, hn::Set(du, std::uint64_t{1}))));
    const auto is_parallel = hn::Eq(axis.t_next, hn::Set(d, kInfinity));
    axis.t_increment = hn::IfThenZeroElse(is_parallel, increment);
    axis.t_limit = hn::IfThenElse(is_parallel, axis.t_next, hn::IfThenElseZero(is_known, end));
  }
}

void StoreAxes(F64 d, const std::array<AxisLanes, 3>& axes, WalkLanes* walks) {
  for (std::size_t a = 0; a < 3; ++a) {
    hn::Store(axes[a].t_next, d, walks->t_next[a].data());
    hn::Store(axes[a].position, d, walks->position[a].data());
  }
}

// Returns the codes of the blocks that the lanes are in (volume::BlockTree::CodeOf), plus 2^52, so
// that they are the low bits of the numbers.
VecF64 CodesOf(F64 d, const ActiveTree& active, const WalkLanes& walks,
               const std::array<AxisLanes, 3>& axes) {
  const auto four = hn::Set(d, kBrickSide);
  const auto quarter = hn::Set(d, 1 / kBrickSide);
  // Whole numbers below 2^53: exact.
  auto brick = hn::Zero(d);
  auto bits = hn::Set(d, 0x1p52);
  for (std::size_t a = 3; a-- > 0;) {
    const auto index = hn::Add(hn::Load(d, walks.first[a].data()),
                               hn::Mul(hn::Load(d, walks.sign[a].data()), axes[a].position));
    const auto brick_index = hn::Floor(hn::Mul(index, quarter));
    const auto brick_count =
        hn::Set(d, static_cast<double>(active.brick_dims[static_cast<int>(a)]));
    brick = hn::Add(hn::Mul(brick, brick_count), brick_index);
    bits = hn::Add(bits, hn::Mul(hn::Sub(index, hn::Mul(brick_index, four)),
                                 hn::Set(d, static_cast<double>(1 << (2 * a)))));
  }
  return hn::Add(hn::Mul(brick, hn::Set(d, 64.0)), bits);
}

// Crosses, in the lanes `in_cubes`, the rest of the cubes that they are in. A lane that may
// reach its limit stays as it was. Returns the lanes that went; sets those of them whose walk ends.
unsigned CrossCubes(F64 d, const WalkLanes& walks, const CubeLanes& cubes, unsigned in_cubes,
                    std::array<AxisLanes, 3>* axes, unsigned* ended) {
  const auto zero = hn::Zero(d);
  const auto one = hn::Set(d, 1.0);
  const auto infinity = hn::Set(d, kInfinity);
  const auto reach = hn::Load(d, cubes.reach.data());
  // The boundary of each axis that leaves the cube; infinity if it is beyond the limit.
  const auto rest_of = [&](const AxisLanes& axis) HWY_ATTR {
    const auto begin = hn::Mul(hn::Floor(hn::Mul(axis.position, hn::Set(d, 1 / kBrickSide))),
                               hn::Set(d, kBrickSide));
    return hn::Sub(hn::Add(begin, reach), axis.position);
  };
  const auto t_leave_of = [&](const AxisLanes& axis, VecF64 rest) HWY_ATTR {
    const auto t = hn::Add(axis.t_next, hn::Mul(hn::Sub(rest, one), axis.t_increment));
    return hn::IfThenElse(hn::Lt(t, axis.t_limit), t, infinity);
  };
  AxisLanes& x = (*axes)[0];
  AxisLanes& y = (*axes)[1];
  AxisLanes& z = (*axes)[2];
  const VecF64 rest[3] = {rest_of(x), rest_of(y), rest_of(z)};
  const auto t_x = t_leave_of(x, rest[0]);
  const auto t_y = t_leave_of(y, rest[1]);
  const auto t_z = t_leave_of(z, rest[2]);
  // The axis whose boundary comes first; of equal ones the lower.
  const auto x_before_y = hn::Le(t_x, t_y);
  const auto along_x = hn::And(x_before_y, hn::Le(t_x, t_z));
  const auto along_y = hn::AndNot(x_before_y, hn::Le(t_y, t_z));
  const auto along_z = hn::Not(hn::Or(along_x, along_y));
  const hn::Mask<F64> along[3] = {along_x, along_y, along_z};
  const auto t = hn::IfThenElse(along_x, t_x, hn::IfThenElse(along_y, t_y, t_z));
  const std::array<std::uint8_t, 8> lane_bits{static_cast<std::uint8_t>(in_cubes)};
  auto is_exact = hn::And(hn::LoadMaskBits(d, lane_bits.data()),
                          hn::Lt(t, hn::Min(hn::Min(x.t_limit, y.t_limit), z.t_limit)));
  auto is_over = hn::Gt(t, hn::Load(d, walks.t_exit.data()));

  VecF64 new_t[3] = {zero, zero, zero};
  VecF64 new_position[3] = {zero, zero, zero};
  for (std::size_t a = 0; a < 3; ++a) {
    const AxisLanes& axis = (*axes)[a];
    // A boundary of a lower axis than the one that is left comes before an equal one.
    const auto is_lower = a == 0 ? hn::Not(along_x) : a == 1 ? along_z : hn::Lt(one, zero);
    const auto is_before = [&](VecF64 other) HWY_ATTR {
      return hn::Or(hn::Lt(other, t), hn::And(is_lower, hn::Eq(other, t)));
    };
    const auto boundary = [&](VecF64 count) HWY_ATTR {
      return hn::Add(axis.t_next, hn::Mul(count, axis.t_increment));
    };
    // How many boundaries come before: about the quotient, exactly by the sums themselves.
    const auto room = hn::Sub(t, axis.t_next);
    const auto guess =
        hn::Add(hn::Floor(hn::Mul(room, hn::Load(d, walks.inverse_step[a].data()))), one);
    auto count = hn::IfThenElseZero(hn::Ge(room, zero), guess);
    const auto is_short = is_before(boundary(count));
    const auto is_long = hn::AndNot(is_before(boundary(hn::Sub(count, one))), hn::Gt(count, zero));
    count = hn::Sub(hn::Add(count, hn::IfThenElseZero(is_short, one)),
                    hn::IfThenElseZero(is_long, one));
    count = hn::IfThenElse(along[a], rest[a], count);
    const auto next = boundary(count);
    const auto is_none = hn::Eq(count, zero);
    const auto is_after = hn::Or(hn::Gt(next, t), hn::AndNot(is_lower, hn::Eq(next, t)));
    const auto last_is_before = hn::Or(is_before(boundary(hn::Sub(count, one))), is_none);
    const auto is_right = hn::Or(along[a], hn::And(is_after, last_is_before));
    const auto is_in_limit = hn::Or(hn::Lt(next, axis.t_limit), is_none);
    is_exact = hn::And(is_exact, hn::And(is_right, is_in_limit));
    new_t[a] = next;
    new_position[a] = hn::Add(axis.position, count);
    // A cube may reach beyond the volume: any axis may have left it.
    is_over = hn::Or(is_over, hn::Ge(new_position[a], hn::Load(d, walks.end[a].data())));
  }
  for (std::size_t a = 0; a < 3; ++a) {
    AxisLanes& axis = (*axes)[a];
    axis.t_next = hn::IfThenElse(is_exact, new_t[a], axis.t_next);
    axis.position = hn::IfThenElse(is_exact, new_position[a], axis.position);
  }
  std::array<std::uint8_t, 8> exact_bits{};
  std::array<std::uint8_t, 8> over_bits{};
  hn::StoreMaskBits(d, is_exact, exact_bits.data());
  hn::StoreMaskBits(d, is_over, over_bits.data());
  *ended = exact_bits[0] & over_bits[0];
  return exact_bits[0];
}

// Walks, in the lanes `in_bricks`, from block to block until each has met an active block or
// left its brick. Returns the lanes that met one, with its bit in cubes->bit; sets those whose walk
// ends otherwise.
unsigned CrossBricks(F64 d, const WalkLanes& walks, unsigned in_bricks, CubeLanes* cubes,
                     std::array<AxisLanes, 3>* axes, unsigned* ended) {
  const U64 du;
  const auto zero = hn::Zero(d);
  const auto one = hn::Set(d, 1.0);
  const auto t_exit = hn::Load(d, walks.t_exit.data());
  const auto word = hn::Load(du, cubes->word.data());
  auto bit = hn::Load(du, cubes->bit.data());
  VecF64 t_step[3] = {zero, zero, zero};
  VecF64 leave[3] = {zero, zero, zero};  // the positions that are beyond the brick
  hn::Vec<U64> bit_step[3] = {hn::Zero(du), hn::Zero(du), hn::Zero(du)};
  for (std::size_t a = 0; a < 3; ++a) {
    const auto side = hn::Set(d, kBrickSide);
    t_step[a] = hn::Load(d, walks.t_step[a].data());
    const auto begin = hn::Floor(hn::Mul((*axes)[a].position, hn::Set(d, 1 / kBrickSide)));
    leave[a] = hn::Mul(hn::Add(begin, one), side);
    const std::int64_t stride = std::int64_t{1} << (2 * a);
    bit_step[a] =
        hn::IfThenElse(hn::RebindMask(du, hn::Lt(hn::Load(d, walks.sign[a].data()), zero)),
                       hn::Set(du, static_cast<std::uint64_t>(-stride)),
                       hn::Set(du, static_cast<std::uint64_t>(stride)));
  }
  AxisLanes& x = (*axes)[0];
  AxisLanes& y = (*axes)[1];
  AxisLanes& z = (*axes)[2];
  const std::array<std::uint8_t, 8> lane_bits{static_cast<std::uint8_t>(in_bricks)};
  auto is_inside = hn::LoadMaskBits(d, lane_bits.data());
  auto has_hit = hn::Lt(one, zero);  // none
  auto is_over = has_hit;
  // Each turn moves every lane inside by a block.
  while (true) {
    // The bit of a lane that has left its brick may be any number.
    const auto is_member =
        hn::Ne(hn::And(hn::Shr(word, hn::And(bit, hn::Set(du, 63))), hn::Set(du, 1)), hn::Zero(du));
    const auto is_hit = hn::And(is_inside, hn::RebindMask(d, is_member));
    has_hit = hn::Or(has_hit, is_hit);
    is_inside = hn::AndNot(is_hit, is_inside);
    // The axis whose boundary comes first; of equal ones the lower.
    const auto x_before_y = hn::Le(x.t_next, y.t_next);
    const auto is_x = hn::And(x_before_y, hn::Le(x.t_next, z.t_next));
    const auto is_y = hn::AndNot(x_before_y, hn::Le(y.t_next, z.t_next));
    const auto t = hn::IfThenElse(is_x, x.t_next, hn::IfThenElse(is_y, y.t_next, z.t_next));
    const auto is_late = hn::And(is_inside, hn::Gt(t, t_exit));
    is_over = hn::Or(is_over, is_late);
    is_inside = hn::AndNot(is_late, is_inside);
    if (hn::AllFalse(d, is_inside)) {
      break;
    }
    const auto along_x = hn::And(is_inside, is_x);
    const auto along_y = hn::And(is_inside, is_y);
    const auto along_z = hn::AndNot(hn::Or(is_x, is_y), is_inside);
    x.t_next = hn::Add(x.t_next, hn::IfThenElseZero(along_x, t_step[0]));
    y.t_next = hn::Add(y.t_next, hn::IfThenElseZero(along_y, t_step[1]));
    z.t_next = hn::Add(z.t_next, hn::IfThenElseZero(along_z, t_step[2]));
    x.position = hn::Add(x.position, hn::IfThenElseZero(along_x, one));
    y.position = hn::Add(y.position, hn::IfThenElseZero(along_y, one));
    z.position = hn::Add(z.position, hn::IfThenElseZero(along_z, one));
    bit =
        hn::Add(bit, hn::IfThenElseZero(hn::RebindMask(du, is_inside),
                                        hn::IfThenElse(hn::RebindMask(du, is_x), bit_step[0],
                                                       hn::IfThenElse(hn::RebindMask(du, is_y),
                                                                      bit_step[1], bit_step[2]))));
    const auto has_left = hn::Or(hn::Or(hn::Ge(x.position, leave[0]), hn::Ge(y.position, leave[1])),
                                 hn::Ge(z.position, leave[2]));
    is_inside = hn::AndNot(has_left, is_inside);
  }
  for (std::size_t a = 0; a < 3; ++a) {
    is_over = hn::Or(is_over, hn::Ge((*axes)[a].position, hn::Load(d, walks.end[a].data())));
  }
  hn::Store(bit, du, cubes->bit.data());
  std::array<std::uint8_t, 8> hit_bits{};
  std::array<std::uint8_t, 8> over_bits{};
  hn::StoreMaskBits(d, has_hit, hit_bits.data());
  hn::StoreMaskBits(d, is_over, over_bits.data());
  *ended = over_bits[0] & in_bricks;
  return hit_bits[0];
}

// Walks all rays of a packet in parallel until each has met an active block or left the
// volume, and marks the blocks met in `hits`.
void WalkRays(F64 d, const RayScene& scene, const RayLanes& rays, const ActiveTree& active,
              std::uint64_t* hits) {
  WalkStarts starts;
  if (!StartWalks(d, scene, rays, &starts)) {
    return;
  }
  WalkLanes walks;
  MakeWalks(d, scene, active, rays, starts, &walks);
  unsigned searching = 0;
  CubeLanes cubes{};
  for (std::size_t lane = 0; lane < hn::Lanes(d); ++lane) {
    searching |= walks.t_exit[lane] >= 0 ? 1U << lane : 0;
  }
  std::array<AxisLanes, 3> axes;
  LoadAxes(d, walks, &axes);
  FindIncrements(d, walks, &axes);
  alignas(64) LaneArray codes{};
  // Every turn moves every lane that still searches by a block at least, so the walk ends whatever
  // the rounding.
  while (searching != 0) {
    hn::Store(CodesOf(d, active, walks, axes), d, codes.data());
    const unsigned in_cubes = LookUp(active, searching, codes, &cubes);
    unsigned ended = 0;
    if (in_cubes != 0) {
      const auto is_beyond = hn::Or(
          hn::Or(hn::Ge(axes[0].t_next, axes[0].t_limit), hn::Ge(axes[1].t_next, axes[1].t_limit)),
          hn::Ge(axes[2].t_next, axes[2].t_limit));
      if (!hn::AllFalse(d, is_beyond)) {
        FindIncrements(d, walks, &axes);
      }
      const unsigned gone = CrossCubes(d, walks, cubes, in_cubes, &axes, &ended);
      if ((in_cubes & ~gone) != 0) {
        StoreAxes(d, axes, &walks);
        for (unsigned lanes = in_cubes & ~gone; lanes != 0; lanes &= lanes - 1) {
          const auto lane = static_cast<std::size_t>(std::countr_zero(lanes));
          if (!CrossCube(lane, cubes.reach[lane], &walks)) {
            ended |= 1U << lane;
          }
        }
        LoadAxes(d, walks, &axes);
      }
    }
    if (in_cubes != searching) {
      unsigned over = 0;
      const unsigned in_bricks = searching & ~in_cubes;
      const unsigned hit = CrossBricks(d, walks, in_bricks, &cubes, &axes, &over);
      for (unsigned lanes = hit; lanes != 0; lanes &= lanes - 1) {
        const auto lane = static_cast<std::size_t>(std::countr_zero(lanes));
        hits[cubes.cell[lane]] |= std::uint64_t{1} << cubes.bit[lane];
      }
      ended |= hit | over;
    }
    searching &= ~ended;
  }
}

void CastRowOnTarget(const RayScene& scene, const RayRow& row, std::int64_t begin_column,
                     std::int64_t end_column, const ActiveTree& active, std::uint64_t* hits) {
  const F64 d;
  const auto lane_count = static_cast<std::int64_t>(hn::Lanes(d));
  RayLanes rays;
  for (std::int64_t column = begin_column; column < end_column; column += lane_count) {
    MakeRays(d, scene, row, column,
             static_cast<std::size_t>(std::min(lane_count, end_column - column)), &rays);
    WalkRays(d, scene, rays, active, hits);
  }
}

}  // namespace
}  // namespace isoscope::visibility::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isoscope::visibility {
namespace {
HWY_EXPORT(CastRowOnTarget);
}  // namespace

void CastRow(const RayScene& scene, const RayRow& row, std::int64_t begin_column,
             std::int64_t end_column, const ActiveTree& active, std::uint64_t* hits) {
  HWY_DYNAMIC_DISPATCH(CastRowOnTarget)(scene, row, begin_column, end_column, active, hits);
}

}  // namespace isoscope::visibility
#endif  // HWY_ONCE
