// The largest gradient length of a block, in up to three steps:
//
// 1. A bound of all lengths. Most blocks of a large volume need no more than that. Of small types in
//    the interior it comes from the largest difference along each axis (difference_kernel.h), else
//    from the block's range of values (RoughBound).
// 2. Other blocks go row by row, over the squared lengths of the doubled gradients. Each x keeps
//    its largest square. A missing neighbour is replaced by the sample itself, and the difference
//    then counts twice.
// 3. Some blocks go one sample at a time, with all checks: those with samples that are not finite,
//    or with squares that overflow or nearly vanish. Gradients are then scaled by powers of two.
//
// Scaling by a power of two changes no bit, so steps 2 and 3 agree wherever both are possible.

#include "core/extract/gradient_bound.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <vector>

#include "core/extract/difference_kernel.h"
#include "core/extract/vertex_batch.h"
#include "core/math/vec.h"
#include "core/volume/min_max.h"
#include "core/volume/scalar_span.h"
#include "core/volume/scalar_type.h"

namespace isoscope::extract {
namespace {

// The samples before and after those of a row along an axis, and the weight of their difference.
struct Neighbours {
  const char* before = nullptr;
  const char* after = nullptr;
  double factor = 1;
};

struct BoundTask {
  const char* bytes = nullptr;
  Strides grid{};
  math::Mat3d to_world;
  math::IndexBox box;       // counted from the first stored sample
  bool is_interior = true;  // all samples of the box have all neighbours
};

// By axis, for the samples (begin + i, y, z); along x for samples with both neighbours.
template <typename T>
std::array<Neighbours, 3> NeighboursOf(const BoundTask& task, std::size_t begin, std::size_t y,
                                       std::size_t z) {
  const std::array<std::size_t, 3> at{begin, y, z};
  const std::size_t first = begin + y * task.grid.samples[1] + z * task.grid.samples[2];
  std::array<Neighbours, 3> all;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const bool has_lower = at[axis] > 0;
    const bool has_upper = at[axis] + 1 < task.grid.dims[axis];
    const std::size_t stride = task.grid.samples[axis];
    all[axis].before = task.bytes + (first - (has_lower ? stride : 0)) * sizeof(T);
    all[axis].after = task.bytes + (first + (has_upper ? stride : 0)) * sizeof(T);
    all[axis].factor = has_lower && has_upper ? 1 : 2;
  }
  return all;
}

// Raises maxima[i] to the squared length of the doubled gradient of sample i. A plain loop, which
// compilers turn into SIMD.
template <typename T>
void RaiseRow(const std::array<Neighbours, 3>& neighbours, const math::Mat3d& to_world,
              std::size_t count, double* maxima) {
  const auto [x, y, z] = neighbours;
  const math::Vec3d& cx = to_world.columns[0];
  const math::Vec3d& cy = to_world.columns[1];
  const math::Vec3d& cz = to_world.columns[2];
  for (std::size_t i = 0; i < count; ++i) {
    const auto along = [i](const Neighbours& n) {
      return static_cast<double>(
                 Subtract<T>(LoadSample<T>(n.after, i), LoadSample<T>(n.before, i))) *
             n.factor;
    };
    const double gx = along(x);
    const double gy = along(y);
    const double gz = along(z);
    const double wx = cx.x * gx + cy.x * gy + cz.x * gz;
    const double wy = cx.y * gx + cy.y * gy + cz.y * gz;
    const double wz = cx.z * gx + cy.z * gy + cz.z * gz;
    const double square = wx * wx + wy * wy + wz * wz;
    maxima[i] = square > maxima[i] ? square : maxima[i];
  }
}

// Squares below this may have lost digits.
constexpr double kLeastSquare = 0x1p-900;

// Returns the largest squared length of a doubled gradient.
template <typename T>
double MaxSquarePlainly(const BoundTask& task) {
  const auto begin = static_cast<std::size_t>(task.box.begin.x);
  const auto end = static_cast<std::size_t>(task.box.end.x);
  std::vector<double> maxima(end - begin, 0.0);
  const auto raise = [&](std::size_t first, std::size_t last, std::size_t y, std::size_t z) {
    RaiseRow<T>(NeighboursOf<T>(task, first, y, z), task.to_world, last - first,
                maxima.data() + (first - begin));
  };
  for (auto z = static_cast<std::size_t>(task.box.begin.z);
       z < static_cast<std::size_t>(task.box.end.z); ++z) {
    for (auto y = static_cast<std::size_t>(task.box.begin.y);
         y < static_cast<std::size_t>(task.box.end.y); ++y) {
      std::size_t first = begin;
      std::size_t last = end;
      if (first == 0) {
        raise(0, 1, y, z);
        first = 1;
      }
      if (last == task.grid.dims[0] && last > first) {
        raise(last - 1, last, y, z);
        --last;
      }
      if (first < last) {
        raise(first, last, y, z);
      }
    }
  }
  return *std::max_element(maxima.begin(), maxima.end());
}

// Returns half the length of to_world * `doubled`. Its largest component is brought to [1, 2)
// before squares are taken. NaN or infinite if a component is.
double LengthOfHalf(const math::Mat3d& to_world, const math::Vec3d& doubled) {
  const double largest = std::max({std::abs(doubled.x), std::abs(doubled.y), std::abs(doubled.z)});
  if (!(largest > 0) || !std::isfinite(largest)) {
    return largest;
  }
  const int exponent = std::ilogb(largest);
  const auto scaled = [exponent](double value) { return std::ldexp(value, -exponent); };
  const math::Vec3d world =
      to_world * math::Vec3d{scaled(doubled.x), scaled(doubled.y), scaled(doubled.z)};
  return std::ldexp(math::Length(world), exponent - 1);
}

template <typename T>
double MaxCarefully(const BoundTask& task) {
  double largest = 0;
  for (std::int64_t z = task.box.begin.z; z < task.box.end.z; ++z) {
    for (std::int64_t y = task.box.begin.y; y < task.box.end.y; ++y) {
      for (std::int64_t x = task.box.begin.x; x < task.box.end.x; ++x) {
        const std::size_t sample = static_cast<std::size_t>(x) +
                                   static_cast<std::size_t>(y) * task.grid.samples[1] +
                                   static_cast<std::size_t>(z) * task.grid.samples[2];
        math::Vec3d doubled;
        for (std::size_t axis = 0; axis < 3; ++axis) {
          doubled[static_cast<int>(axis)] =
              static_cast<double>(CarefulGradient<T>(task.bytes, task.grid, sample, axis));
        }
        const double length = LengthOfHalf(task.to_world, doubled);
        if (std::isfinite(length)) {
          largest = std::max(largest, length);
        }
      }
    }
  }
  return largest;
}

template <typename T>
bool AllFinite(const char* bytes, std::size_t count) {
  bool all = true;
  for (std::size_t i = 0; i < count; ++i) {
    all &= std::isfinite(LoadSample<T>(bytes, i));
  }
  return all;
}

// Squares below this may have lost terms to underflow.
constexpr double kLeastBoundSquare = 0x1p-600;

// Returns a bound of all lengths from the largest difference along each axis; infinite where it is
// not sure. |W g|^2 is the sum over axes i, k of g_i g_k (w_i . w_k), with the columns w of W.
// REQUIRES: task.is_interior.
template <typename T>
double BoundByDifferences(const BoundTask& task) {
  const std::array<double, 3> doubled = LargestDifferences<T>(task.bytes, task.grid, task.box);
  if (doubled == std::array<double, 3>{}) {
    return 0;
  }
  double square = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t k = 0; k < 3; ++k) {
      square += doubled[i] * doubled[k] *
                std::abs(math::Dot(task.to_world.columns[i], task.to_world.columns[k]));
    }
  }
  // False for NaN.
  if (!(square >= kLeastBoundSquare)) {
    return std::numeric_limits<double>::infinity();
  }
  // Floats round each difference once, by less than 2^-23 of it.
  return std::sqrt(square) / 2 * (1 + (std::is_integral_v<T> ? 1e-9 : 1e-6));
}

// Returns a bound of all lengths. A component of the gradient is at most the range R of the samples
// (half of it where both neighbours are there), so |W g|^2 is at most R^2 times the sum of
// |w_i . w_k|.
template <typename T>
double RoughBound(const BoundTask& task) {
  volume::MinMax<T> min_max;
  min_max.AddRow(task.bytes, task.grid.dims[0] * task.grid.dims[1] * task.grid.dims[2]);
  const volume::ScalarSpan span = min_max.Get();
  if (!(span.min <= span.max)) {
    return 0;  // all samples are NaN
  }
  double products = 0;
  for (const math::Vec3d& a : task.to_world.columns) {
    for (const math::Vec3d& b : task.to_world.columns) {
      products += std::abs(math::Dot(a, b));
    }
  }
  const double most = (span.max - span.min) * (task.is_interior && std::is_integral_v<T> ? 0.5 : 1);
  if (most == 0) {
    return 0;
  }
  // The two terms allow for rounding, also of denormal numbers.
  return most * std::sqrt(products) * (1 + 1e-9) + 4 * std::numeric_limits<double>::denorm_min();
}

template <typename T>
double LengthBound(const BoundTask& task) {
  if constexpr (kHasDifferenceKernel<T>) {
    if (task.is_interior) {
      return BoundByDifferences<T>(task);
    }
  }
  return RoughBound<T>(task);
}

template <typename T>
double MaxOf(const BoundTask& task, double so_far) {
  // False for NaN.
  if (LengthBound<T>(task) <= so_far) {
    return so_far;
  }
  if constexpr (std::is_floating_point_v<T>) {
    if (!AllFinite<T>(task.bytes, task.grid.dims[0] * task.grid.dims[1] * task.grid.dims[2])) {
      return std::max(so_far, MaxCarefully<T>(task));
    }
  }
  const double square = MaxSquarePlainly<T>(task);
  const bool is_sure = std::isfinite(square) && square >= kLeastSquare;
  return std::max(so_far, is_sure ? std::sqrt(square) / 2 : MaxCarefully<T>(task));
}

}  // namespace

double MaxGradientMagnitude(const volume::BlockLayout& layout,
                            const math::Mat3d& world_gradient_from_index,
                            const volume::BlockSamples& samples, const math::IndexBox& box,
                            double so_far) {
  const math::IndexBox stored = layout.StoredSamplesOf(samples.block_id);
  if (math::Volume(box.dims()) == 0) {
    return so_far;
  }
  const math::Index3 dims = stored.dims();
  BoundTask task{.bytes = samples.bytes,
                 .to_world = world_gradient_from_index,
                 .box = {.begin = box.begin - stored.begin, .end = box.end - stored.begin}};
  for (int axis = 0; axis < 3; ++axis) {
    task.grid.dims[static_cast<std::size_t>(axis)] = static_cast<std::size_t>(dims[axis]);
    task.is_interior =
        task.is_interior && task.box.begin[axis] > 0 && task.box.end[axis] < dims[axis];
  }
  task.grid.samples = {1, task.grid.dims[0], task.grid.dims[0] * task.grid.dims[1]};
  return volume::VisitScalarType(samples.type,
                                 [&]<typename T>() { return MaxOf<T>(task, so_far); });
}

}  // namespace isoscope::extract
