#include "core/image/png_filter.h"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/random.h"
#include "hwy/highway.h"

namespace isoscope::image {
namespace {

std::vector<Rgba8> MakeNoise(std::size_t count, std::uint64_t seed) {
  std::vector<Rgba8> pixels(count);
  for (std::size_t i = 0; i < count; ++i) {
    pixels[i] = std::bit_cast<Rgba8>(static_cast<std::uint32_t>(base::RandomBits(seed, i)));
  }
  return pixels;
}

std::vector<std::uint8_t> FilteredByHand(const std::vector<Rgba8>& row,
                                         const std::vector<Rgba8>& above, PngChannels channels) {
  std::vector<std::uint8_t> out;
  for (std::size_t i = 0; i < row.size(); ++i) {
    out.push_back(static_cast<std::uint8_t>(row[i].r - above[i].r));
    out.push_back(static_cast<std::uint8_t>(row[i].g - above[i].g));
    out.push_back(static_cast<std::uint8_t>(row[i].b - above[i].b));
    if (channels == PngChannels::kRgba) {
      out.push_back(static_cast<std::uint8_t>(row[i].a - above[i].a));
    }
  }
  return out;
}

// Once for each instruction set that this machine has.
class PngFilterTest : public ::testing::TestWithParam<std::int64_t> {
 protected:
  void SetUp() override { hwy::SetSupportedTargetsForTest(GetParam()); }
  void TearDown() override { hwy::SetSupportedTargetsForTest(0); }
};

std::vector<std::int64_t> TargetsOfThisMachine() {
  std::vector<std::int64_t> targets;
  for (std::int64_t left = hwy::SupportedTargets(); left != 0; left &= left - 1) {
    targets.push_back(left & -left);
  }
  return targets;
}

INSTANTIATE_TEST_SUITE_P(Targets, PngFilterTest, ::testing::ValuesIn(TargetsOfThisMachine()),
                         [](const auto& target) { return hwy::TargetName(target.param); });

TEST_P(PngFilterTest, EveryLengthIsSubtractedAsByHandAndNothingBehindTheSlackIsWritten) {
  constexpr std::uint8_t kUntouched = 0xa5;
  for (std::size_t count = 0; count < 150; ++count) {
    const std::vector<Rgba8> row = MakeNoise(count, 1);
    const std::vector<Rgba8> above = MakeNoise(count, 2);
    for (const PngChannels channels : {PngChannels::kRgb, PngChannels::kRgba}) {
      const std::vector<std::uint8_t> expected = FilteredByHand(row, above, channels);
      // At an odd address, as after a row's filter type, and no larger than promised.
      std::vector<std::uint8_t> out(1 + expected.size() + kFilterSlackBytes, kUntouched);
      out.shrink_to_fit();
      const std::uint8_t* const end = FilterUp(row, above, channels, out.data() + 1);
      ASSERT_EQ(end - out.data() - 1, static_cast<std::ptrdiff_t>(expected.size()));
      ASSERT_TRUE(std::equal(expected.begin(), expected.end(), out.begin() + 1)) << count;
      ASSERT_EQ(out.front(), kUntouched);
    }
  }
}

TEST_P(PngFilterTest, OneTransparentPixelAnywhereIsFound) {
  for (std::size_t count = 0; count < 150; ++count) {
    std::vector<Rgba8> pixels = MakeNoise(count, 3);
    for (Rgba8& pixel : pixels) {
      pixel.a = 255;
    }
    ASSERT_TRUE(AllOpaque(pixels)) << count;
    for (std::size_t i = 0; i < count; ++i) {
      for (const int alpha : {0, 127, 254}) {
        pixels[i].a = static_cast<std::uint8_t>(alpha);
        ASSERT_FALSE(AllOpaque(pixels)) << count << " pixels, number " << i;
      }
      pixels[i].a = 255;
    }
  }
}

}  // namespace
}  // namespace isoscope::image
