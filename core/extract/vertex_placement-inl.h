// Pass 4 of extraction: positions and normals of vertices, in batches of 128 on edges of one axis.
// Included once for each instruction set, by block_kernels.cc. For each batch:
//
//   1. Gather: isovalue - a and b - a for the edge's samples a and b, and at both ends twice the
//      gradient, by central differences. GatherSmall and GatherLarge do that with SIMD gathers for
//      interior edges; vertex_batch.h does it one by one for the others and where the machine has
//      no gather.
//   2. ComputeVertices, in double: t = (isovalue - a) / (b - a); the position from the sample's
//      coordinates, plus t along the axis; the gradient between both ends at t; its normal
//      (gradient_normal-inl.h); and its length, if it is wanted.
//   3. Interleave: from one array a component to vectors of three floats. Here the values of
//      another field are added, if they are wanted, with the t of step 1 (field_values.h).
//
// Invariants: the factor 2 of the gradients cancels when they are normalised. 8- and 16-bit samples
// are subtracted as integers, others as doubles: both are exact or rounded once, the same in every
// lane, so all variants and instruction sets give the same bits.
//
// Coordinates come from the linear index by z = trunc((index + 0.5) / slice), and so on; the half
// keeps rounded quotients away from whole numbers. Example: rows of 19 samples, slices of 361;
// index 411 gives z = trunc(411.5 / 361) = 1, y = trunc(50.5 / 19) = 2, x = 50 - 38 = 12.
//
// Formulas: docs/numerics.md, "Vertex position" and "Normals".

// Highway's guard: defined and undefined in turn.
#if defined(ISOSCOPE_CORE_EXTRACT_VERTEX_PLACEMENT_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ISOSCOPE_CORE_EXTRACT_VERTEX_PLACEMENT_INL_H_
#undef ISOSCOPE_CORE_EXTRACT_VERTEX_PLACEMENT_INL_H_
#else
#define ISOSCOPE_CORE_EXTRACT_VERTEX_PLACEMENT_INL_H_
#endif

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>

#include "core/extract/block_kernels.h"
#include "core/extract/block_shape.h"
#include "core/extract/field_values.h"
#include "core/extract/gradient_normal-inl.h"
#include "core/extract/vertex_batch.h"
#include "core/math/vec.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::extract {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// Loads a register of doubles.
inline DoubleVec LoadDoubles(const double* from) { return hn::Load(DoubleTag(), from); }
inline DoubleVec LoadDoubles(const std::int32_t* from) {
  return hn::PromoteTo(DoubleTag(), hn::Load(IntHalfTag(), from));
}

#if HWY_TARGET <= HWY_AVX2 && HWY_ARCH_X86
#define ISOSCOPE_EXTRACT_HAS_GATHER 1
#else
#define ISOSCOPE_EXTRACT_HAS_GATHER 0
#endif

#if ISOSCOPE_EXTRACT_HAS_GATHER
// Extracts sample kIndex, lowest first, of those in each 32-bit lane, and extends its sign or
// zeros.
template <typename T, int kIndex>
hn::Vec<hn::ScalableTag<std::int32_t>> SampleOfLane(hn::Vec<hn::ScalableTag<std::int32_t>> lanes) {
  constexpr int kBits = 8 * static_cast<int>(sizeof(T));
  const hn::ScalableTag<std::int32_t> d;
  const hn::ScalableTag<std::uint32_t> du;
  const auto left = hn::ShiftLeft<32 - kBits - kIndex * kBits>(lanes);
  if constexpr (std::is_signed_v<T>) {
    return hn::ShiftRight<32 - kBits>(left);
  } else {
    return hn::BitCast(d, hn::ShiftRight<32 - kBits>(hn::BitCast(du, left)));
  }
}

// Step 1 for 8- and 16-bit samples without checks, as GatherVertices<T, Care::kNone>. Each gather
// fetches 4 bytes, so that neighbours in x come together: a byte sample with both its neighbours,
// or two 16-bit samples. The bytes are all in the block, because whole rows of samples follow an
// interior one. `count` is rounded up to whole registers; `samples` must have as many.
template <typename T, std::size_t kAxis>
void GatherSmall(const char* bytes, const EdgeStencil& stencil, double isovalue,
                 const std::uint32_t* samples, std::size_t count,
                 VertexBatch<std::int32_t>* batch) {
  const hn::ScalableTag<std::int32_t> d;
  const DoubleTag dd;
  using Vec = hn::Vec<decltype(d)>;
  const auto* base = reinterpret_cast<const std::int32_t*>(bytes);
  const auto iso = hn::Set(dd, isovalue);
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    const Vec sample = hn::BitCast(d, hn::LoadU(hn::ScalableTag<std::uint32_t>(), samples + i));
    const Vec offset = sizeof(T) == 1 ? sample : hn::Add(sample, sample);
    const auto at = [&](std::int32_t delta) {
      constexpr auto kSize = static_cast<std::int32_t>(sizeof(T));
      return hn::GatherOffset(d, base, hn::Add(offset, hn::Set(d, delta * kSize)));
    };
    const auto one = [&](std::int32_t delta) { return SampleOfLane<T, 0>(at(delta)); };
    const auto two = [&](std::int32_t delta, Vec* first, Vec* second) {
      const Vec pair = at(delta);
      *first = SampleOfLane<T, 0>(pair);
      *second = SampleOfLane<T, 1>(pair);
    };
    // By axis: the samples before and after the edge's lower and upper end.
    std::array<Vec, 3> lower_before;
    std::array<Vec, 3> lower_after;
    std::array<Vec, 3> upper_before;
    std::array<Vec, 3> upper_after;
    Vec lower;
    Vec upper;
    if constexpr (kAxis == 0) {
      if constexpr (sizeof(T) == 1) {
        const Vec four = at(-1);
        lower_before[0] = SampleOfLane<T, 0>(four);
        lower = SampleOfLane<T, 1>(four);
        upper = SampleOfLane<T, 2>(four);
        upper_after[0] = SampleOfLane<T, 3>(four);
      } else {
        two(-1, &lower_before[0], &lower);
        two(1, &upper, &upper_after[0]);
      }
      for (std::size_t k = 1; k < 3; ++k) {
        two(stencil.lower_before[k], &lower_before[k], &upper_before[k]);
        two(stencil.lower_after[k], &lower_after[k], &upper_after[k]);
      }
    } else {
      // Gathers the samples delta - 1, delta and delta + 1.
      const auto three = [&](std::int32_t delta, Vec* before, Vec* center, Vec* after) {
        const Vec first = at(delta - 1);
        *before = SampleOfLane<T, 0>(first);
        *center = SampleOfLane<T, 1>(first);
        if constexpr (sizeof(T) == 1) {
          *after = SampleOfLane<T, 2>(first);
        } else {
          *after = one(delta + 1);
        }
      };
      constexpr std::size_t kOther = 3 - kAxis;
      three(0, &lower_before[0], &lower, &lower_after[0]);
      three(stencil.upper, &upper_before[0], &upper, &upper_after[0]);
      lower_before[kAxis] = one(stencil.lower_before[kAxis]);
      upper_after[kAxis] = one(stencil.upper_after[kAxis]);
      lower_before[kOther] = one(stencil.lower_before[kOther]);
      lower_after[kOther] = one(stencil.lower_after[kOther]);
      upper_before[kOther] = one(stencil.upper_before[kOther]);
      upper_after[kOther] = one(stencil.upper_after[kOther]);
    }
    lower_after[kAxis] = upper;
    upper_before[kAxis] = lower;
    for (std::size_t k = 0; k < 3; ++k) {
      hn::Store(hn::Sub(lower_after[k], lower_before[k]), d, batch->lower_gradients[k].data() + i);
      hn::Store(hn::Sub(upper_after[k], upper_before[k]), d, batch->upper_gradients[k].data() + i);
    }
    // These differences are exact, as integers and as doubles.
    const Vec difference = hn::Sub(upper, lower);
    const std::size_t half = hn::Lanes(dd);
    const hn::Half<decltype(d)> dh;
    hn::Store(hn::Sub(iso, hn::PromoteTo(dd, hn::LowerHalf(dh, lower))), dd,
              batch->numerators.data() + i);
    hn::Store(hn::Sub(iso, hn::PromoteTo(dd, hn::UpperHalf(dh, lower))), dd,
              batch->numerators.data() + i + half);
    hn::Store(hn::PromoteTo(dd, hn::LowerHalf(dh, difference)), dd, batch->denominators.data() + i);
    hn::Store(hn::PromoteTo(dd, hn::UpperHalf(dh, difference)), dd,
              batch->denominators.data() + i + half);
  }
}

// Gathers samples of 32 or 64 bits and converts them to double.
template <typename T>
DoubleVec GatherDoubles(const char* bytes, hn::Vec<IntHalfTag> samples) {
  const DoubleTag dd;
  if constexpr (sizeof(T) == 8) {
    return hn::GatherIndex(dd, reinterpret_cast<const double*>(bytes),
                           hn::PromoteTo(hn::RebindToSigned<DoubleTag>(), samples));
  } else if constexpr (std::is_same_v<T, float>) {
    return hn::PromoteTo(
        dd, hn::GatherIndex(FloatHalfTag(), reinterpret_cast<const float*>(bytes), samples));
  } else {
    const IntHalfTag di;
    const auto values = hn::GatherIndex(di, reinterpret_cast<const std::int32_t*>(bytes), samples);
    if constexpr (std::is_signed_v<T>) {
      return hn::PromoteTo(dd, values);
    } else {
      const auto sign = hn::Set(di, std::numeric_limits<std::int32_t>::min());
      return hn::Add(hn::PromoteTo(dd, hn::Xor(values, sign)), hn::Set(dd, 0x1.0p31));
    }
  }
}

// Step 1 for 32- and 64-bit samples without checks: one gather for each sample.
template <typename T>
void GatherLarge(const char* bytes, const EdgeStencil& stencil, std::size_t axis, double isovalue,
                 const std::uint32_t* samples, std::size_t count, VertexBatch<double>* batch) {
  const DoubleTag dd;
  const IntHalfTag di;
  const auto iso = hn::Set(dd, isovalue);
  for (std::size_t i = 0; i < count; i += hn::Lanes(dd)) {
    const auto sample =
        hn::BitCast(di, hn::LoadU(hn::Rebind<std::uint32_t, DoubleTag>(), samples + i));
    const auto at = [&](std::int32_t delta) {
      return GatherDoubles<T>(bytes, hn::Add(sample, hn::Set(di, delta)));
    };
    const DoubleVec lower = at(0);
    const DoubleVec upper = at(stencil.upper);
    hn::Store(hn::Sub(iso, lower), dd, batch->numerators.data() + i);
    hn::Store(hn::Sub(upper, lower), dd, batch->denominators.data() + i);
    for (std::size_t k = 0; k < 3; ++k) {
      const DoubleVec lower_after = k == axis ? upper : at(stencil.lower_after[k]);
      const DoubleVec upper_before = k == axis ? lower : at(stencil.upper_before[k]);
      hn::Store(hn::Sub(lower_after, at(stencil.lower_before[k])), dd,
                batch->lower_gradients[k].data() + i);
      hn::Store(hn::Sub(at(stencil.upper_after[k]), upper_before), dd,
                batch->upper_gradients[k].data() + i);
    }
  }
}

// Step 1 for interior edges.
template <typename T, std::size_t kAxis>
void GatherInterior(const BlockTask& task, const Strides& strides, const std::uint32_t* samples,
                    std::size_t count, VertexBatch<Difference<T>>* batch) {
  const EdgeStencil stencil(strides, kAxis);
  if constexpr (sizeof(T) <= 2) {
    GatherSmall<T, kAxis>(task.bytes, stencil, task.isovalue, samples, count, batch);
  } else {
    GatherLarge<T>(task.bytes, stencil, kAxis, task.isovalue, samples, count, batch);
  }
}

// Step 1 for a block at the border, as GatherVertices<T, Care::kBorder>. Gathers the whole batch
// with a safe sample in place of those that are not interior, then gathers those one by one.
template <typename T, std::size_t kAxis>
void GatherNearBorder(const BlockTask& task, const Strides& strides, const std::uint32_t* samples,
                      std::size_t count, VertexBatch<Difference<T>>* batch) {
  alignas(64) std::array<std::uint32_t, kBatch> safe_samples;
  std::array<std::uint32_t, kBatch> near_border;
  std::size_t near_border_count = 0;
  const std::uint64_t* interior = task.shape->interior.data();
  const std::uint32_t safe = task.shape->first_interior;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint32_t sample = samples[i];
    const bool is_interior = (interior[sample / 64] >> sample % 64 & 1) != 0;
    safe_samples[i] = is_interior ? sample : safe;
    near_border[near_border_count] = static_cast<std::uint32_t>(i);
    near_border_count += is_interior ? 0 : 1;
  }
  if (near_border_count < count) {
    std::fill(safe_samples.begin() + static_cast<std::ptrdiff_t>(count), safe_samples.end(), safe);
    GatherInterior<T, kAxis>(task, strides, safe_samples.data(), count, batch);
  }
  for (std::size_t i = 0; i < near_border_count; ++i) {
    GatherAtBorder<T>(task.bytes, strides, kAxis, task.isovalue, samples[near_border[i]],
                      near_border[i], batch);
  }
}
#endif  // ISOSCOPE_EXTRACT_HAS_GATHER

// Returns the length of a gradient as a float, which is finite; 0 if it is not usable.
// `normal` is that of the gradient, doubled.
HWY_INLINE hn::Vec<FloatHalfTag> MagnitudeOf(const GradientNormal& normal) {
  const DoubleTag d;
  const auto length = hn::Mul(hn::Mul(normal.largest, hn::Set(d, 0.5)), hn::Sqrt(normal.square));
  const auto most = hn::Set(d, static_cast<double>(std::numeric_limits<float>::max()));
  return hn::DemoteTo(FloatHalfTag(), hn::IfThenElseZero(normal.is_usable, hn::Min(length, most)));
}

// Step 2 computes positions and normals of a batch.
template <std::size_t kAxis, typename D>
void ComputeVertices(const BlockTask& task, const std::uint32_t* samples, std::size_t count,
                     VertexBatch<D>* batch) {
  const DoubleTag d;
  const FloatHalfTag df;
  const auto half = hn::Set(d, 0.5);
  const auto row = hn::Set(d, static_cast<double>(task.shape->row));
  const auto slice = hn::Set(d, static_cast<double>(task.shape->slice));
  const auto row_inverse = hn::Set(d, task.shape->row_inverse);
  const auto slice_inverse = hn::Set(d, task.shape->slice_inverse);
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    // Position: the coordinates of the edge's lower sample, plus t along the axis.
    const auto t = hn::Div(LoadDoubles(batch->numerators.data() + i),
                           LoadDoubles(batch->denominators.data() + i));
    const auto linear = hn::PromoteTo(
        d,
        hn::BitCast(IntHalfTag(), hn::LoadU(hn::Rebind<std::uint32_t, DoubleTag>(), samples + i)));
    const auto z = hn::Trunc(hn::Mul(hn::Add(linear, half), slice_inverse));
    const auto in_slice = hn::Sub(linear, hn::Mul(z, slice));
    const auto y = hn::Trunc(hn::Mul(hn::Add(in_slice, half), row_inverse));
    const auto x = hn::Sub(in_slice, hn::Mul(y, row));
    std::array<DoubleVec, 3> position{hn::Add(hn::Set(d, task.begin.x), x),
                                      hn::Add(hn::Set(d, task.begin.y), y),
                                      hn::Add(hn::Set(d, task.begin.z), z)};
    position[kAxis] = hn::Add(position[kAxis], t);

    // Gradient at t.
    std::array<DoubleVec, 3> gradient;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto lower = LoadDoubles(batch->lower_gradients[k].data() + i);
      const auto upper = LoadDoubles(batch->upper_gradients[k].data() + i);
      gradient[k] = hn::Add(lower, hn::Mul(t, hn::Sub(upper, lower)));
    }
    const GradientNormal normal = NormalOf(gradient, *task.to_world);
    for (std::size_t k = 0; k < 3; ++k) {
      hn::Store(hn::DemoteTo(df, position[k]), df, batch->positions[k].data() + i);
      hn::Store(hn::DemoteTo(df, normal.components[k]), df, batch->normals[k].data() + i);
    }
    if (task.keeps_gradient_magnitudes) {
      hn::Store(MagnitudeOf(normal), df, batch->gradient_magnitudes.data() + i);
    }
  }
}

// Step 3 writes vectors of three floats, in whole registers: up to 63 vectors past `count`.
inline void Interleave(const std::array<std::array<float, kBatch>, 3>& from, std::size_t count,
                       math::Vec3f* to) {
  const hn::CappedTag<float, 64> d;
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    hn::StoreInterleaved3(hn::Load(d, from[0].data() + i), hn::Load(d, from[1].data() + i),
                          hn::Load(d, from[2].data() + i), d, &to[i].x);
  }
}

// Keeps the values of a batch whose vertex ids begin at `first_vertex`: the lengths of gradients,
// or those of another field. Out of line, so that blocks without them are as fast as ever.
template <typename D>
HWY_NOINLINE void KeepValues(const BlockTask& task, const std::uint32_t* samples,
                             std::size_t upper_distance, std::size_t count,
                             std::size_t first_vertex, const VertexBatch<D>& batch,
                             BlockScratch* scratch) {
  if (task.keeps_gradient_magnitudes) {
    std::copy_n(batch.gradient_magnitudes.begin(), count,
                scratch->values.begin() + static_cast<std::ptrdiff_t>(first_vertex));
    return;
  }
  const VerticesOnEdges vertices{.count = count,
                                 .lower_samples = samples,
                                 .upper_distance = upper_distance,
                                 .numerators = batch.numerators.data(),
                                 .denominators = batch.denominators.data()};
  if (HasWideValues(task.field->type)) {
    FillFieldValues(*task.field, vertices, scratch->wide_values.data() + first_vertex);
  } else {
    FillFieldValues(*task.field, vertices, scratch->values.data() + first_vertex);
  }
}

// Runs the steps on all vertices on edges along kAxis, whose ids begin at `first_vertex`.
template <typename T, Care kCare, std::size_t kAxis>
void PlaceVerticesOfAxis(const BlockTask& task, const Strides& strides, std::size_t first_vertex,
                         BlockScratch* scratch, VertexBatch<Difference<T>>* batch) {
  const std::size_t all = scratch->edge_counts[kAxis];
  for (std::size_t begin = 0; begin < all; begin += kBatch) {
    const std::size_t count = std::min(kBatch, all - begin);
    const std::uint32_t* samples = scratch->edge_samples[kAxis].data() + begin;
#if ISOSCOPE_EXTRACT_HAS_GATHER
    if constexpr (kCare == Care::kFull) {
      GatherVertices<T, kCare>(task.bytes, strides, task.shape->interior, kAxis, task.isovalue,
                               samples, count, batch);
    } else if constexpr (kCare == Care::kBorder) {
      GatherNearBorder<T, kAxis>(task, strides, samples, count, batch);
    } else {
      GatherInterior<T, kAxis>(task, strides, samples, count, batch);
    }
#else
    GatherVertices<T, kCare>(task.bytes, strides, task.shape->interior, kAxis, task.isovalue,
                             samples, count, batch);
#endif
    ComputeVertices<kAxis>(task, samples, count, batch);
    Interleave(batch->positions, count, scratch->positions.data() + first_vertex + begin);
    Interleave(batch->normals, count, scratch->normals.data() + first_vertex + begin);
    if (task.keeps_values()) {
      KeepValues(task, samples, strides.samples[kAxis], count, first_vertex + begin, *batch,
                 scratch);
    }
  }
}

// Pass 4 fills positions and normals from edge_samples.
template <typename T, Care kCare>
void PlaceVertices(const BlockTask& task, BlockScratch* scratch) {
  const BlockShape& shape = *task.shape;
  const Strides strides{
      {1, shape.row, shape.slice},
      {static_cast<std::size_t>(shape.stored_dims.x), static_cast<std::size_t>(shape.stored_dims.y),
       static_cast<std::size_t>(shape.stored_dims.z)}};
  VertexBatch<Difference<T>> batch;
  const std::array<std::size_t, 3>& counts = scratch->edge_counts;
  PlaceVerticesOfAxis<T, kCare, 0>(task, strides, 0, scratch, &batch);
  PlaceVerticesOfAxis<T, kCare, 1>(task, strides, counts[0], scratch, &batch);
  PlaceVerticesOfAxis<T, kCare, 2>(task, strides, counts[0] + counts[1], scratch, &batch);
}

#undef ISOSCOPE_EXTRACT_HAS_GATHER

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace isoscope::extract
HWY_AFTER_NAMESPACE();

#endif  // ISOSCOPE_CORE_EXTRACT_VERTEX_PLACEMENT_INL_H_
