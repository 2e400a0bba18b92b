#include "core/image/fragment.h"

#include <array>
#include <cstdint>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::image {
namespace {

struct Fragment {
  std::uint64_t key = kBackgroundKey;
  Rgba8 color;
};

constexpr Rgba8 kDark{10, 200, 200, 255};
constexpr Rgba8 kLight{20, 0, 0, 255};

bool IsBefore(const FragmentOrder& order, const Fragment& a, const Fragment& b) {
  return order.IsBefore(a.key, a.color, b.key, b.color);
}

TEST(FragmentOrderTest, DepthDecidesBeforeAllElse) {
  for (const TieRule ties : {TieRule::kColor, TieRule::kOwner}) {
    const FragmentOrder order{.block_count = 10, .ties = ties};
    const Fragment near{FragmentKey(0.25F, order.OwnerOf(3, 9)), kLight};
    const Fragment far{FragmentKey(0.5F, order.OwnerOf(0, 0)), kDark};
    EXPECT_TRUE(IsBefore(order, near, far));
    EXPECT_FALSE(IsBefore(order, far, near));
  }
}

TEST(FragmentOrderTest, EqualDepthsGoBySurfaceThenColorThenBlock) {
  const FragmentOrder order{.block_count = 10, .ties = TieRule::kColor};
  // Ascending.
  const std::vector<Fragment> sorted{{FragmentKey(0.5F, order.OwnerOf(0, 9)), kDark},
                                     {FragmentKey(0.5F, order.OwnerOf(0, 2)), kLight},
                                     {FragmentKey(0.5F, order.OwnerOf(0, 3)), kLight},
                                     {FragmentKey(0.5F, order.OwnerOf(1, 0)), kDark}};
  for (std::size_t i = 0; i < sorted.size(); ++i) {
    for (std::size_t j = 0; j < sorted.size(); ++j) {
      EXPECT_EQ(IsBefore(order, sorted[i], sorted[j]), i < j) << i << " " << j;
    }
  }
}

TEST(FragmentOrderTest, WithoutColorsTheOwnerDecides) {
  const FragmentOrder order{.block_count = 10, .ties = TieRule::kOwner};
  const Fragment low{FragmentKey(0.5F, order.OwnerOf(0, 2)), kLight};
  const Fragment high{FragmentKey(0.5F, order.OwnerOf(0, 9)), kDark};
  EXPECT_TRUE(IsBefore(order, low, high));
  EXPECT_FALSE(IsBefore(order, high, low));
}

TEST(FragmentOrderTest, TheBackgroundComesAfterEveryFragment) {
  // The most owners there can be, in several ways.
  for (const std::uint32_t block_count : {1U, 3U, 65535U, 0x10000000U, 0xfffffffeU, 0xffffffffU}) {
    const std::uint32_t surface_count = kNoOwner / block_count;
    const FragmentOrder order{.block_count = block_count, .ties = TieRule::kColor};
    const Fragment last{FragmentKey(kFarDepth, order.OwnerOf(surface_count - 1, block_count - 1)),
                        {255, 255, 255, 255}};
    EXPECT_LT(OwnerOf(last.key), kNoOwner);
    EXPECT_TRUE(IsBefore(order, last, Fragment())) << block_count;
    EXPECT_FALSE(IsBefore(order, Fragment(), last)) << block_count;
  }
}

TEST(FragmentOrderTest, OwnersTellSurfacesApart) {
  const FragmentOrder order{.block_count = 1000};
  EXPECT_EQ(order.OwnerOf(0, 999), 999U);
  EXPECT_EQ(order.OwnerOf(2, 7), 2007U);
  EXPECT_EQ(order.SurfaceOf(2007), 2U);
  EXPECT_EQ(order.SurfaceOf(999), 0U);
}

TEST(FragmentTest, NegativeZeroIsTheSameDepthAsZero) {
  EXPECT_EQ(FragmentKey(-0.0F, 5), FragmentKey(0.0F, 5));
}

}  // namespace
}  // namespace isoscope::image
