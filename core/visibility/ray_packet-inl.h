// A packet of rays, one to a vector lane: made, clipped to the volume, and set to the first block of
// each. Included once for each instruction set, by the kernels that walk on from there
// (ray_kernel.cc, tree_walk_kernel.cc). No step depends on the width of a register.

// Highway's guard: defined and undefined in turn.
#if defined(ISOSCOPE_CORE_VISIBILITY_RAY_PACKET_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ISOSCOPE_CORE_VISIBILITY_RAY_PACKET_INL_H_
#undef ISOSCOPE_CORE_VISIBILITY_RAY_PACKET_INL_H_
#else
#define ISOSCOPE_CORE_VISIBILITY_RAY_PACKET_INL_H_
#endif

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "core/base/random.h"
#include "core/visibility/ray_kernel.h"
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
  const auto block_u =
      hn::Min(hn::Add(hn::Mul(hn::Add(hn::Iota(d, 0.0), hn::Set(d, static_cast<double>(column))),
                              hn::Set(d, static_cast<double>(scene.face_stride))),
                      hn::Set(d, static_cast<double>(scene.face_stride / 2))),
              hn::Set(d, static_cast<double>(scene.block_dims[u] - 1)));
  const auto begin_u = hn::Mul(block_u, hn::Set(d, scene.block_size[u]));
  const auto end_u =
      hn::Min(hn::Add(begin_u, hn::Set(d, scene.block_size[u])), hn::Set(d, scene.size[u]));
  const auto center_u = hn::Mul(hn::Set(d, 0.5), hn::Add(begin_u, end_u));
  const std::int64_t block_v =
      std::min(row.row * scene.face_stride + scene.face_stride / 2, scene.block_dims[v] - 1);
  const double begin_v = static_cast<double>(block_v) * scene.block_size[v];
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

// Where the walks of a packet begin.
struct alignas(64) WalkStarts {
  std::array<LaneArray, 3> index;   // of the first block on each axis
  std::array<LaneArray, 3> t_next;  // t of the next block boundary; infinity: none
  std::array<LaneArray, 3> t_step;  // from one boundary to the next
  LaneArray t_exit;                 // where the ray leaves the volume; below 0: no walk
};

// Step 2 clips the rays to the volume and finds their first blocks. False if no ray meets the
// volume; t_exit is below 0 in the lanes of rays that do not.
bool StartWalks(F64 d, const RayScene& scene, const RayLanes& rays, WalkStarts* starts) {
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
  hn::Store(hn::IfThenElse(is_met, t_exit, hn::Set(d, -1.0)), d, starts->t_exit.data());

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
    hn::Store(hn::IfThenElseZero(is_met, index), d, starts->index[a].data());
    hn::Store(hn::IfThenElse(is_parallel, hn::Set(d, kInfinity),
                             hn::Div(hn::Sub(boundary, origin), direction)),
              d, starts->t_next[a].data());
    hn::Store(hn::IfThenZeroElse(is_parallel, hn::Div(block_size, hn::Abs(direction))), d,
              starts->t_step[a].data());
  }
  return true;
}

}  // namespace
}  // namespace isoscope::visibility::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // ISOSCOPE_CORE_VISIBILITY_RAY_PACKET_INL_H_
