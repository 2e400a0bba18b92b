#include "core/image/tile_coverage.h"

#include <cstddef>
#include <cstdint>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/random.h"
#include "hwy/targets.h"

namespace isoscope::image {
namespace {

constexpr int kTilePx = TileSet::kTilePx;

TEST(TileCoverageTest, IsTheDefinitionOnEveryInstructionSetForEverySize) {
  constexpr std::size_t kStride = 37;
  constexpr std::uint64_t kEmpty = ~std::uint64_t{0};
  constexpr std::uint64_t kHigh = 0xffffffff00000000;
  for (const std::uint64_t ignored : {std::uint64_t{0}, kHigh}) {
    std::vector<std::uint64_t> words(kStride * kTilePx);
    for (std::size_t i = 0; i < words.size(); ++i) {
      // Empty, empty except for the ignored bits, or different from that in one bit.
      const double dice = base::RandomUnit(3, 2 * i);
      const auto bit = static_cast<unsigned>(64 * base::RandomUnit(3, 2 * i + 1));
      words[i] = dice < 0.4   ? kEmpty
                 : dice < 0.7 ? kEmpty ^ (std::uint64_t{1} << 32 << bit % 32)
                              : kEmpty ^ (std::uint64_t{1} << bit);
    }
    for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
      hwy::SetSupportedTargetsForTest(target);
      for (std::uint64_t set = 0; set < 20; ++set) {
        // None, all, then any.
        const auto rows = static_cast<std::uint16_t>(set == 0   ? 0
                                                     : set == 1 ? 0xffff
                                                                : base::RandomBits(7, set));
        for (int columns = 1; columns <= kTilePx; ++columns) {
          TileMask expected{};
          for (int y = 0; y < kTilePx; ++y) {
            if ((rows >> y & 1) == 0) {
              continue;
            }
            for (int x = 0; x < columns; ++x) {
              const std::uint64_t word =
                  words[kStride * static_cast<std::size_t>(y) + static_cast<std::size_t>(x)];
              if ((word | ignored) != kEmpty) {
                expected[static_cast<std::size_t>(y)] |= static_cast<std::uint16_t>(1 << x);
              }
            }
          }
          ASSERT_EQ(CoverageOf(words.data(), kStride, columns, rows, kEmpty, ignored), expected)
              << columns << " columns, rows " << rows << ", " << hwy::TargetName(target);
        }
      }
    }
    hwy::SetSupportedTargetsForTest(0);
  }
}

}  // namespace
}  // namespace isoscope::image
