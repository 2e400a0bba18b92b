#include "core/image/fragment.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <ios>
#include <numeric>
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

// A pixel keeps the first of its fragments, whatever their order of arrival: compositing is
// associative, commutative and idempotent.
TEST(FragmentOrderTest, APixelKeepsTheFirstFragmentInEachOrderOfArrival) {
  constexpr FragmentOrder kOrder{.block_count = 10};
  const auto at = [&](float depth, std::uint32_t surface, std::uint32_t block) {
    return FragmentKey(depth, kOrder.OwnerOf(surface, block));
  };
  struct Case {
    const char* name;
    std::vector<Fragment> fragments;
    TieRule ties;
    std::size_t first;  // among them
  };
  const std::vector<Case> cases = {
      {"nothing", {{}}, TieRule::kColor, 0},
      {"one", {{}, {at(kFarDepth, 1, 9), kLight}}, TieRule::kColor, 1},
      {"the nearest", {{at(0.5F, 0, 0), kDark}, {at(0.25F, 1, 9), kLight}, {}}, TieRule::kColor, 1},
      {"equal depths: the lower surface",
       {{at(0.5F, 1, 0), kDark}, {at(0.5F, 0, 9), kLight}},
       TieRule::kColor,
       1},
      {"equal surfaces: the darker colour",
       {{at(0.5F, 0, 2), kLight}, {at(0.5F, 0, 9), kDark}, {at(0.75F, 0, 0), kDark}},
       TieRule::kColor,
       1},
      {"equal colours: the lower block",
       {{at(0.5F, 0, 3), kDark}, {at(0.5F, 0, 2), kDark}, {at(0.5F, 0, 1), kLight}},
       TieRule::kColor,
       1},
      {"equal depths by owner: the lower block of any colour",
       {{at(0.5F, 0, 3), kDark}, {at(0.5F, 0, 2), kLight}, {at(0.5F, 1, 1), kDark}},
       TieRule::kOwner,
       1},
      {"equal owners by owner, a cap and a triangle: the darker colour",
       {{at(0.5F, 0, 3), kLight}, {at(0.5F, 0, 3), kDark}, {at(0.5F, 0, 4), kDark}},
       TieRule::kOwner,
       1},
      {"equal owners, a cap and a triangle: the darker colour",
       {{at(0.5F, 0, 3), kLight}, {at(0.5F, 0, 3), kDark}, {at(0.75F, 0, 3), kDark}},
       TieRule::kColor,
       1},
  };
  for (const Case& c : cases) {
    const FragmentOrder order{.block_count = kOrder.block_count, .ties = c.ties};
    std::vector<std::size_t> arrivals(c.fragments.size());
    std::iota(arrivals.begin(), arrivals.end(), 0);
    do {
      Fragment pixel;
      for (const std::size_t i : arrivals) {
        order.KeepFirst(c.fragments[i].key, c.fragments[i].color, &pixel.key, &pixel.color);
      }
      EXPECT_EQ(pixel.key, c.fragments[c.first].key) << c.name;
      EXPECT_EQ(pixel.color, c.fragments[c.first].color) << c.name;
      for (const Fragment& again : c.fragments) {
        order.KeepFirst(again.key, again.color, &pixel.key, &pixel.color);
      }
      EXPECT_EQ(pixel.key, c.fragments[c.first].key) << c.name << ", twice";
    } while (std::next_permutation(arrivals.begin(), arrivals.end()));
  }
}

TEST(FragmentTest, NegativeZeroIsTheSameDepthAsZero) {
  EXPECT_EQ(FragmentKey(-0.0F, 5), FragmentKey(0.0F, 5));
}

}  // namespace
}  // namespace isoscope::image
