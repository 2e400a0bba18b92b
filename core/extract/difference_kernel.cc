// Three registers keep the largest differences, one for each axis. Signed samples are moved up by
// half their range, which keeps differences and lets unsigned arithmetic hold all of them.
//
// A row that is no multiple of the lanes ends with a register that overlaps the one before: a
// difference that counts twice changes no maximum. Only rows shorter than a register are loaded in
// part.

#include "core/extract/difference_kernel.h"

#include <cstring>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/extract/difference_kernel.cc"
#include "hwy/foreach_target.h"  // IWYU pragma: keep
//
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::extract {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

template <typename T>
using LaneOf = typename std::conditional_t<std::is_floating_point_v<T>, std::type_identity<T>,
                                           std::make_unsigned<T>>::type;

// Returns samples in the order of their unsigned lanes.
template <typename T, typename D>
HWY_INLINE hn::Vec<D> Moved(D d, hn::Vec<D> samples) {
  if constexpr (std::is_signed_v<T> && std::is_integral_v<T>) {
    using Lane = hn::TFromD<D>;
    return hn::Xor(samples, hn::Set(d, static_cast<Lane>(Lane{1} << (8 * sizeof(Lane) - 1))));
  } else {
    return samples;
  }
}

template <typename T, typename D>
HWY_INLINE void Raise(D d, hn::Vec<D> before, hn::Vec<D> after, hn::Vec<D>* largest) {
  if constexpr (std::is_floating_point_v<T>) {
    const auto difference = hn::Abs(hn::Sub(after, before));
    // False for NaN.
    *largest = hn::IfThenElse(hn::Gt(difference, *largest), difference, *largest);
  } else {
    const auto a = Moved<T>(d, before);
    const auto b = Moved<T>(d, after);
    *largest = hn::Max(*largest, hn::Sub(hn::Max(a, b), hn::Min(a, b)));
  }
}

template <typename T>
std::array<double, 3> Largest(const char* bytes, const Strides& grid, const math::IndexBox& box) {
  using Lane = LaneOf<T>;
  // 16 cells are the usual edge of a block.
  const hn::CappedTag<Lane, 16> d;
  const std::size_t lanes = hn::Lanes(d);
  const auto columns = static_cast<std::size_t>(box.end.x - box.begin.x);
  auto x = hn::Zero(d);
  auto y = hn::Zero(d);
  auto z = hn::Zero(d);
  const auto raise = [&](const auto& load, const char* row) HWY_ATTR {
    const std::size_t line = grid.samples[1] * sizeof(T);
    const std::size_t plane = grid.samples[2] * sizeof(T);
    Raise<T>(d, load(row - sizeof(T)), load(row + sizeof(T)), &x);
    Raise<T>(d, load(row - line), load(row + line), &y);
    Raise<T>(d, load(row - plane), load(row + plane), &z);
  };
  const auto load_all = [&](const char* at)
                            HWY_ATTR { return hn::LoadU(d, reinterpret_cast<const Lane*>(at)); };
  const auto load_some = [&](const char* at) HWY_ATTR {
    HWY_ALIGN std::array<Lane, hn::MaxLanes(d)> samples{};
    std::memcpy(samples.data(), at, columns * sizeof(T));
    return hn::Load(d, samples.data());
  };
  for (std::int64_t iz = box.begin.z; iz < box.end.z; ++iz) {
    for (std::int64_t iy = box.begin.y; iy < box.end.y; ++iy) {
      const std::size_t first = static_cast<std::size_t>(box.begin.x) +
                                static_cast<std::size_t>(iy) * grid.samples[1] +
                                static_cast<std::size_t>(iz) * grid.samples[2];
      const char* const row = bytes + first * sizeof(T);
      if (columns < lanes) {
        raise(load_some, row);
        continue;
      }
      std::size_t i = 0;
      for (; i + lanes <= columns; i += lanes) {
        raise(load_all, row + i * sizeof(T));
      }
      if (i < columns) {
        raise(load_all, row + (columns - lanes) * sizeof(T));
      }
    }
  }
  const auto largest_of = [&](hn::Vec<decltype(d)> of) HWY_ATTR {
    HWY_ALIGN std::array<Lane, hn::MaxLanes(d)> all{};
    hn::Store(of, d, all.data());
    Lane largest = 0;
    for (const Lane one : all) {
      largest = one > largest ? one : largest;
    }
    return static_cast<double>(largest);
  };
  return {largest_of(x), largest_of(y), largest_of(z)};
}

// One name for each type, because a table of targets has no template.
std::array<double, 3> LargestOfUint8(const char* bytes, const Strides& grid,
                                     const math::IndexBox& box) {
  return Largest<std::uint8_t>(bytes, grid, box);
}
std::array<double, 3> LargestOfInt8(const char* bytes, const Strides& grid,
                                    const math::IndexBox& box) {
  return Largest<std::int8_t>(bytes, grid, box);
}
std::array<double, 3> LargestOfUint16(const char* bytes, const Strides& grid,
                                      const math::IndexBox& box) {
  return Largest<std::uint16_t>(bytes, grid, box);
}
std::array<double, 3> LargestOfInt16(const char* bytes, const Strides& grid,
                                     const math::IndexBox& box) {
  return Largest<std::int16_t>(bytes, grid, box);
}
std::array<double, 3> LargestOfFloat(const char* bytes, const Strides& grid,
                                     const math::IndexBox& box) {
  return Largest<float>(bytes, grid, box);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace isoscope::extract
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isoscope::extract {
namespace {
HWY_EXPORT(LargestOfUint8);
HWY_EXPORT(LargestOfInt8);
HWY_EXPORT(LargestOfUint16);
HWY_EXPORT(LargestOfInt16);
HWY_EXPORT(LargestOfFloat);
}  // namespace

template <typename T>
std::array<double, 3> LargestDifferences(const char* bytes, const Strides& grid,
                                         const math::IndexBox& box) {
  if constexpr (std::is_same_v<T, std::uint8_t>) {
    return HWY_DYNAMIC_DISPATCH(LargestOfUint8)(bytes, grid, box);
  } else if constexpr (std::is_same_v<T, std::int8_t>) {
    return HWY_DYNAMIC_DISPATCH(LargestOfInt8)(bytes, grid, box);
  } else if constexpr (std::is_same_v<T, std::uint16_t>) {
    return HWY_DYNAMIC_DISPATCH(LargestOfUint16)(bytes, grid, box);
  } else if constexpr (std::is_same_v<T, std::int16_t>) {
    return HWY_DYNAMIC_DISPATCH(LargestOfInt16)(bytes, grid, box);
  } else {
    return HWY_DYNAMIC_DISPATCH(LargestOfFloat)(bytes, grid, box);
  }
}

template std::array<double, 3> LargestDifferences<std::uint8_t>(const char*, const Strides&,
                                                                const math::IndexBox&);
template std::array<double, 3> LargestDifferences<std::int8_t>(const char*, const Strides&,
                                                               const math::IndexBox&);
template std::array<double, 3> LargestDifferences<std::uint16_t>(const char*, const Strides&,
                                                                 const math::IndexBox&);
template std::array<double, 3> LargestDifferences<std::int16_t>(const char*, const Strides&,
                                                                const math::IndexBox&);
template std::array<double, 3> LargestDifferences<float>(const char*, const Strides&,
                                                         const math::IndexBox&);

}  // namespace isoscope::extract
#endif  // HWY_ONCE
