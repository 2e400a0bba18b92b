// The largest differences of neighbouring samples, compiled for several instruction sets with
// Highway. They bound the gradients of a block in a fraction of the time of its gradients.

#ifndef ISOSCOPE_CORE_EXTRACT_DIFFERENCE_KERNEL_H_
#define ISOSCOPE_CORE_EXTRACT_DIFFERENCE_KERNEL_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "core/extract/vertex_batch.h"
#include "core/math/box.h"

namespace isoscope::extract {

// Types that have a kernel.
template <typename T>
inline constexpr bool kHasDifferenceKernel = std::is_same_v<T, float> ||
                                             (std::is_integral_v<T> && sizeof(T) <= 2);

// Returns, by axis, the largest |sample after - sample before| of the samples of `box`. Of floats it
// is rounded to float; pairs whose difference is NaN are left out. O(samples). Thread-safe.
//
// bytes: samples of `grid`, [z][y][x], x fastest, little-endian, any alignment
// box:   of `grid`. REQUIRES: all its samples have both neighbours on each axis
template <typename T>
std::array<double, 3> LargestDifferences(const char* bytes, const Strides& grid,
                                         const math::IndexBox& box);

extern template std::array<double, 3> LargestDifferences<std::uint8_t>(const char*, const Strides&,
                                                                       const math::IndexBox&);
extern template std::array<double, 3> LargestDifferences<std::int8_t>(const char*, const Strides&,
                                                                      const math::IndexBox&);
extern template std::array<double, 3> LargestDifferences<std::uint16_t>(const char*, const Strides&,
                                                                        const math::IndexBox&);
extern template std::array<double, 3> LargestDifferences<std::int16_t>(const char*, const Strides&,
                                                                       const math::IndexBox&);
extern template std::array<double, 3> LargestDifferences<float>(const char*, const Strides&,
                                                                const math::IndexBox&);

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_DIFFERENCE_KERNEL_H_
