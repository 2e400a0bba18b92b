// Byte sizes.

#ifndef ISOSCOPE_CORE_BASE_UNITS_H_
#define ISOSCOPE_CORE_BASE_UNITS_H_

#include <cstdint>

namespace isoscope::base {

inline constexpr std::int64_t kKiB = 1024;
inline constexpr std::int64_t kMiB = 1024 * kKiB;
inline constexpr std::int64_t kGiB = 1024 * kMiB;

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_UNITS_H_
