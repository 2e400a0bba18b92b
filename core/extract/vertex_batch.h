// Gathers, for a batch of vertices, the samples that their positions and normals are computed from:
// one vertex at a time, for any block. vertex_placement-inl.h does the same with SIMD for most
// vertices, and gives the same bits.
//
// Three variants differ in the checks that they make (docs/numerics.md, "Vertex position" and
// "Normals"): GatherPlainly makes none, GatherAtBorder looks for missing neighbours,
// GatherCarefully also for samples that are not finite or so large that differences overflow.

#ifndef ISOSCOPE_CORE_EXTRACT_VERTEX_BATCH_H_
#define ISOSCOPE_CORE_EXTRACT_VERTEX_BATCH_H_

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "core/extract/bit_row.h"

namespace isoscope::extract {

template <typename T>
T LoadSample(const char* bytes, std::size_t index) {
  T value;
  std::memcpy(&value, bytes + index * sizeof(T), sizeof(T));
  return value;
}

// The type of the difference of two samples: exact for integers of up to 16 bits, double for
// others.
template <typename T>
using Difference =
    std::conditional_t<std::is_integral_v<T> && sizeof(T) <= 2, std::int32_t, double>;

template <typename T>
Difference<T> Subtract(T a, T b) {
  return static_cast<Difference<T>>(a) - static_cast<Difference<T>>(b);
}

// Vertices in a batch: a multiple of every register's lanes.
inline constexpr std::size_t kBatch = 128;

// A batch of vertices on edges of one axis. The gather fills the inputs, ComputeVertices the
// outputs.
template <typename D>
struct VertexBatch {
  // Position along the edge: t = numerator / denominator.
  alignas(64) std::array<double, kBatch> numerators;
  alignas(64) std::array<double, kBatch> denominators;
  // Twice the gradient in index space at the edge's lower and upper sample.
  alignas(64) std::array<std::array<D, kBatch>, 3> lower_gradients;
  alignas(64) std::array<std::array<D, kBatch>, 3> upper_gradients;
  alignas(64) std::array<std::array<float, kBatch>, 3> positions;
  alignas(64) std::array<std::array<float, kBatch>, 3> normals;
  alignas(64) std::array<float, kBatch> gradient_magnitudes;  // only if the task keeps them
};

// The block's stored samples, by axis: distance from a sample to the next, and their count.
struct Strides {
  std::array<std::size_t, 3> samples;
  std::array<std::size_t, 3> dims;
};

// The samples that a vertex is computed from, as distances from the lower sample of its edge. All
// gathers of interior edges read this table.
struct EdgeStencil {
  EdgeStencil(const Strides& grid, std::size_t axis)
      : upper(static_cast<std::int32_t>(grid.samples[axis])) {
    for (std::size_t k = 0; k < 3; ++k) {
      const auto step = static_cast<std::int32_t>(grid.samples[k]);
      lower_before[k] = -step;
      lower_after[k] = step;
      upper_before[k] = upper - step;
      upper_after[k] = upper + step;
    }
  }

  std::int32_t upper;
  // By axis: the neighbours of both ends.
  std::array<std::int32_t, 3> lower_before;
  std::array<std::int32_t, 3> lower_after;
  std::array<std::int32_t, 3> upper_before;
  std::array<std::int32_t, 3> upper_after;
};

// Returns twice the gradient component along `axis` at `sample`: the central difference; the
// one-sided one where a neighbour is missing or not finite; 0 where neither is possible.
template <typename T>
Difference<T> CarefulGradient(const char* bytes, const Strides& grid, std::size_t sample,
                              std::size_t axis) {
  const std::size_t stride = grid.samples[axis];
  const std::size_t coordinate = sample / stride % grid.dims[axis];
  const T center = LoadSample<T>(bytes, sample);
  T lower = center;
  T upper = center;
  bool has_lower = coordinate > 0;
  bool has_upper = coordinate + 1 < grid.dims[axis];
  if (has_lower) {
    lower = LoadSample<T>(bytes, sample - stride);
  }
  if (has_upper) {
    upper = LoadSample<T>(bytes, sample + stride);
  }
  if constexpr (std::is_floating_point_v<T>) {
    has_lower = has_lower && std::isfinite(lower);
    has_upper = has_upper && std::isfinite(upper);
    if (!(has_lower && has_upper) && !std::isfinite(center)) {
      return 0;
    }
  }
  if (has_lower && has_upper) {
    return Subtract<T>(upper, lower);
  }
  if (has_upper) {
    return 2 * Subtract<T>(upper, center);
  }
  return has_lower ? 2 * Subtract<T>(center, lower) : Difference<T>{0};
}

struct Fraction {
  double numerator = 0;
  double denominator = 1;
};

// Returns t of a crossed edge whose samples may be infinite, or overflow when subtracted: the
// limit.
inline Fraction CarefulFraction(double lower, double upper, double isovalue) {
  if (std::isinf(lower)) {
    return std::isinf(upper) ? Fraction{1, 2} : Fraction{1, 1};
  }
  if (std::isinf(upper)) {
    return {0, 1};
  }
  const double denominator = upper - lower;
  if (std::isinf(denominator)) {
    return {isovalue / 2 - lower / 2, upper / 2 - lower / 2};
  }
  return {isovalue - lower, denominator};
}

// Gathers vertex `i` of the batch, on the edge along `axis` from sample `lower`, with all checks.
template <typename T>
void GatherCarefully(const char* bytes, const Strides& grid, std::size_t axis, double isovalue,
                     std::size_t lower, std::size_t i, VertexBatch<Difference<T>>* batch) {
  const std::size_t upper = lower + grid.samples[axis];
  const Fraction t = CarefulFraction(static_cast<double>(LoadSample<T>(bytes, lower)),
                                     static_cast<double>(LoadSample<T>(bytes, upper)), isovalue);
  batch->numerators[i] = t.numerator;
  batch->denominators[i] = t.denominator;
  for (std::size_t k = 0; k < 3; ++k) {
    batch->lower_gradients[k][i] = CarefulGradient<T>(bytes, grid, lower, k);
    batch->upper_gradients[k][i] = CarefulGradient<T>(bytes, grid, upper, k);
  }
}

// Does the same in a block without extreme samples.
template <typename T>
void GatherAtBorder(const char* bytes, const Strides& grid, std::size_t axis, double isovalue,
                    std::uint32_t lower, std::size_t i, VertexBatch<Difference<T>>* batch) {
  const std::size_t upper = lower + grid.samples[axis];
  const auto a = static_cast<double>(LoadSample<T>(bytes, lower));
  const auto b = static_cast<double>(LoadSample<T>(bytes, upper));
  batch->numerators[i] = isovalue - a;
  batch->denominators[i] = b - a;
  const auto row = static_cast<std::uint32_t>(grid.samples[1]);
  const auto slice = static_cast<std::uint32_t>(grid.samples[2]);
  std::array<std::size_t, 3> at{lower % slice % row, lower % slice / row, lower / slice};
  // Computes the same as CarefulGradient, without branches.
  const auto gradient = [&](std::size_t sample, std::size_t k) {
    const bool has_lower = at[k] > 0;
    const bool has_upper = at[k] + 1 < grid.dims[k];
    const std::size_t before = sample - (has_lower ? grid.samples[k] : 0);
    const std::size_t after = sample + (has_upper ? grid.samples[k] : 0);
    const Difference<T> difference =
        Subtract<T>(LoadSample<T>(bytes, after), LoadSample<T>(bytes, before));
    return difference * static_cast<Difference<T>>(has_lower && has_upper ? 1 : 2);
  };
  for (std::size_t k = 0; k < 3; ++k) {
    batch->lower_gradients[k][i] = gradient(lower, k);
  }
  ++at[axis];
  for (std::size_t k = 0; k < 3; ++k) {
    batch->upper_gradients[k][i] = gradient(upper, k);
  }
}

// Does the same for an interior edge in a block without extreme samples.
template <typename T>
void GatherPlainly(const char* bytes, const EdgeStencil& stencil, double isovalue,
                   std::uint32_t lower, std::size_t i, VertexBatch<Difference<T>>* batch) {
  const char* const center = bytes + lower * sizeof(T);
  const auto at = [&](std::int32_t delta) {
    T value;
    std::memcpy(&value, center + delta * static_cast<std::ptrdiff_t>(sizeof(T)), sizeof(T));
    return value;
  };
  const auto a = static_cast<double>(at(0));
  batch->numerators[i] = isovalue - a;
  batch->denominators[i] = static_cast<double>(at(stencil.upper)) - a;
  for (std::size_t k = 0; k < 3; ++k) {
    batch->lower_gradients[k][i] =
        Subtract<T>(at(stencil.lower_after[k]), at(stencil.lower_before[k]));
    batch->upper_gradients[k][i] =
        Subtract<T>(at(stencil.upper_after[k]), at(stencil.upper_before[k]));
  }
}

// The checks that the vertices of a block need.
enum class Care {
  kNone,    // none: no sample is extreme, and the block has ghosts all around
  kBorder,  // no sample is extreme; edges that are not interior may lack neighbours
  kFull,    // all: some sample is extreme
};

// Gathers `count` vertices on edges along `axis`, whose lower samples are `samples`.
template <typename T, Care kCare>
void GatherVertices(const char* bytes, const Strides& grid, const BitRow& interior,
                    std::size_t axis, double isovalue, const std::uint32_t* samples,
                    std::size_t count, VertexBatch<Difference<T>>* batch) {
  const EdgeStencil stencil(grid, axis);
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint32_t lower = samples[i];
    if constexpr (kCare == Care::kFull) {
      GatherCarefully<T>(bytes, grid, axis, isovalue, lower, i, batch);
    } else if (kCare == Care::kBorder && (interior[lower / 64] >> lower % 64 & 1) == 0) {
      GatherAtBorder<T>(bytes, grid, axis, isovalue, lower, i, batch);
    } else {
      GatherPlainly<T>(bytes, stencil, isovalue, lower, i, batch);
    }
  }
}

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_VERTEX_BATCH_H_
