// The filter "up" of a pixel is its bytes minus those of the pixel above, modulo 256. For RGBA that
// is one subtraction a register. For RGB, four pixels are subtracted with their alphas, and a byte
// shuffle drops these: 16 bytes become 12, and stores overlap by 4.
//
// Example: the pixel 10 20 30 255 below 250 20 31 255 gives 16 0 255 (and 0 for RGBA).

#include "core/image/png_filter.h"

#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/image/png_filter.cc"
#include "hwy/foreach_target.h"  // must come before highway.h
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::image {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

std::uint8_t* SubtractRgba(std::span<const Rgba8> row, std::span<const Rgba8> above,
                           std::uint8_t* out) {
  const hn::ScalableTag<std::uint8_t> d;
  const auto* a = reinterpret_cast<const std::uint8_t*>(row.data());
  const auto* b = reinterpret_cast<const std::uint8_t*>(above.data());
  const std::size_t size = row.size() * sizeof(Rgba8);
  const std::size_t step = hn::Lanes(d);
  std::size_t i = 0;
  for (; i + step <= size; i += step) {
    hn::StoreU(hn::Sub(hn::LoadU(d, a + i), hn::LoadU(d, b + i)), d, out + i);
  }
  for (; i < size; ++i) {
    out[i] = static_cast<std::uint8_t>(a[i] - b[i]);
  }
  return out + size;
}

std::uint8_t* SubtractRgb(std::span<const Rgba8> row, std::span<const Rgba8> above,
                          std::uint8_t* out) {
  std::size_t i = 0;
#if HWY_TARGET != HWY_SCALAR
  // Four pixels become 12 bytes, and 4 more that the next store overwrites.
  constexpr std::size_t kPixels = 4;
  const hn::FixedTag<std::uint8_t, kPixels * sizeof(Rgba8)> d;
  HWY_ALIGN static constexpr std::uint8_t kWithoutAlpha[] = {0,  1,  2,  4,  5, 6, 8, 9,
                                                             10, 12, 13, 14, 0, 0, 0, 0};
  const auto without_alpha = hn::Load(d, kWithoutAlpha);
  const auto* a = reinterpret_cast<const std::uint8_t*>(row.data());
  const auto* b = reinterpret_cast<const std::uint8_t*>(above.data());
  for (; i + kPixels <= row.size(); i += kPixels) {
    const auto difference =
        hn::Sub(hn::LoadU(d, a + i * sizeof(Rgba8)), hn::LoadU(d, b + i * sizeof(Rgba8)));
    hn::StoreU(hn::TableLookupBytes(difference, without_alpha), d, out);
    out += kPixels * 3;
  }
#endif
  for (; i < row.size(); ++i) {
    *out++ = static_cast<std::uint8_t>(row[i].r - above[i].r);
    *out++ = static_cast<std::uint8_t>(row[i].g - above[i].g);
    *out++ = static_cast<std::uint8_t>(row[i].b - above[i].b);
  }
  return out;
}

bool AlphasAreFull(std::span<const Rgba8> pixels) {
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(pixels.data());
  const std::size_t size = pixels.size() * sizeof(Rgba8);
  std::size_t i = 0;
#if HWY_TARGET != HWY_SCALAR
  const hn::ScalableTag<std::uint8_t> d;
  const hn::Repartition<std::uint32_t, decltype(d)> d32;
  const auto full = hn::Set(d, std::uint8_t{255});
  auto all = full;
  for (; i + hn::Lanes(d) <= size; i += hn::Lanes(d)) {
    all = hn::And(all, hn::LoadU(d, bytes + i));
  }
  const auto colors =
      hn::BitCast(d, hn::Set(d32, std::bit_cast<std::uint32_t>(Rgba8{255, 255, 255, 0})));
  if (!hn::AllTrue(d, hn::Eq(hn::Or(all, colors), full))) {
    return false;
  }
#endif
  for (i += offsetof(Rgba8, a); i < size; i += sizeof(Rgba8)) {
    if (bytes[i] != 255) {
      return false;
    }
  }
  return true;
}

}  // namespace HWY_NAMESPACE
}  // namespace isoscope::image
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isoscope::image {

HWY_EXPORT(SubtractRgba);
HWY_EXPORT(SubtractRgb);
HWY_EXPORT(AlphasAreFull);

std::uint8_t* FilterUp(std::span<const Rgba8> row, std::span<const Rgba8> above,
                       PngChannels channels, std::uint8_t* out) {
  return channels == PngChannels::kRgb ? HWY_DYNAMIC_DISPATCH(SubtractRgb)(row, above, out)
                                       : HWY_DYNAMIC_DISPATCH(SubtractRgba)(row, above, out);
}

bool AllOpaque(std::span<const Rgba8> pixels) {
  return HWY_DYNAMIC_DISPATCH(AlphasAreFull)(pixels);
}

}  // namespace isoscope::image
#endif  // HWY_ONCE
