#include "core/composite/number_code.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/composite/number_code.cc"
#include "hwy/foreach_target.h"  // IWYU pragma: keep
//
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::composite {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using DI = hn::CappedTag<std::int32_t, 16>;
using DU = hn::RebindToUnsigned<DI>;
using DB = hn::Rebind<std::uint8_t, DI>;

// Unsigned order as signed order: vectors compare signed numbers faster.
constexpr std::uint32_t kFlip = 0x80000000U;

// How many classes begin at or below each number, but for class 0.
HWY_INLINE hn::Vec<DI> ClassesOf(const NumberCode& code, const std::uint32_t* numbers) {
  const DI di;
  const DU du;
  const auto value = hn::BitCast(di, hn::Xor(hn::LoadU(du, numbers), hn::Set(du, kFlip)));
  auto classes = hn::Zero(di);
  for (std::size_t c = 1; c < code.bases.size(); ++c) {
    // Bases are at least 1: one less is a number.
    const auto before = hn::BitCast(di, hn::Set(du, (code.bases[c] - 1) ^ kFlip));
    classes = hn::Sub(classes, hn::VecFromMask(di, hn::Gt(value, before)));
  }
  return classes;
}

void ClassifyNumbers(const std::uint32_t* depths, const std::uint32_t* colors, std::size_t count,
                     std::uint8_t* controls) {
  const DI di;
  const DB db;
  static_assert(hn::MaxLanes(DI()) <= kClassifyPadding + 1);
  for (std::size_t i = 0; i < count; i += hn::Lanes(di)) {
    const auto both = hn::Or(ClassesOf(kDepthCode, depths + i),
                             hn::ShiftLeft<4>(ClassesOf(kColorCode, colors + i)));
    hn::StoreU(hn::DemoteTo(db, both), db, controls + i);
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace isoscope::composite
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isoscope::composite {
namespace {
HWY_EXPORT(ClassifyNumbers);
}  // namespace

void ClassifyNumbers(const std::uint32_t* depths, const std::uint32_t* colors, std::size_t count,
                     std::uint8_t* controls) {
  HWY_DYNAMIC_DISPATCH(ClassifyNumbers)(depths, colors, count, controls);
}

}  // namespace isoscope::composite
#endif  // HWY_ONCE
