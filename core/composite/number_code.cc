// A number's class is found without a table and without branches: it is the count of classes whose
// first number is not above it. That takes 15 comparisons for a register of numbers.

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

// Flipping the top bit turns unsigned order into signed order, which vectors compare faster.
constexpr std::uint32_t kFlip = 0x80000000U;

// Returns the class of each number: how many classes after 0 begin at or below it.
HWY_INLINE hn::Vec<DI> ClassesOf(const NumberCode& code, const std::uint32_t* numbers) {
  const DI di;
  const DU du;
  const auto value = hn::BitCast(di, hn::Xor(hn::LoadU(du, numbers), hn::Set(du, kFlip)));
  auto classes = hn::Zero(di);
  for (std::size_t c = 1; c < code.bases.size(); ++c) {
    // value >= base is value > base - 1, which exists because these bases are at least 1.
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
