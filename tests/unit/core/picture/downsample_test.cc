#include "core/picture/downsample.h"

#include <cmath>
#include <vector>

#include "gtest/gtest.h"
#include <oneapi/tbb/task_arena.h>

#include "core/base/random.h"

namespace isoscope::picture {
namespace {

using image::FrameImage;
using image::Rgba8;

constexpr Rgba8 kBlack{0, 0, 0, 255};
constexpr Rgba8 kClear{0, 0, 0, 0};
constexpr std::uint64_t kKey = image::FragmentKey(0.5F, 3);

// The picture of one pixel with these samples.
Rgba8 MeanOf(const std::vector<Rgba8>& samples, Rgba8 background) {
  const int side = samples.size() == 4 ? 2 : samples.size() == 9 ? 3 : 4;
  FrameImage drawn(side, side);
  for (int i = 0; i < side * side; ++i) {
    if (samples[static_cast<std::size_t>(i)].a != 0) {
      drawn.Set(i % side, i / side, kKey, samples[static_cast<std::size_t>(i)]);
    }
  }
  FrameImage picture(1, 1);
  Downsample(drawn, {.samples_per_side = side}, background, &picture);
  EXPECT_EQ(picture.keys[0], image::kBackgroundKey);
  return picture.colors[0];
}

TEST(DownsampleTest, AHalfCoveredPixelIsTheMeanOfLightNotOfValues) {
  const Rgba8 white{255, 255, 255, 255};
  EXPECT_EQ(MeanOf({white, white, kClear, kClear}, kBlack), (Rgba8{188, 188, 188, 255}));
  // Half of the light of (200, 100, 50) and half of (0, 0, 255).
  EXPECT_EQ(MeanOf({{200, 100, 50, 255}, kClear, kClear, {200, 100, 50, 255}}, {0, 0, 255, 255}),
            (Rgba8{146, 71, 190, 255}));
}

TEST(DownsampleTest, OverATransparentBackgroundAPixelKeepsItsColorAndLosesAlpha) {
  const Rgba8 clay{201, 120, 33, 255};
  EXPECT_EQ(MeanOf({clay, kClear, kClear, kClear}, {255, 255, 255, 0}), (Rgba8{201, 120, 33, 64}));
  EXPECT_EQ(MeanOf({clay, clay, clay, kClear}, kClear), (Rgba8{201, 120, 33, 191}));
  std::vector<Rgba8> sixteen(16, kClear);
  sixteen[5] = clay;
  EXPECT_EQ(MeanOf(sixteen, kClear), (Rgba8{201, 120, 33, 16}));
}

TEST(DownsampleTest, AFullyCoveredPixelOfOneColorIsThatColor) {
  for (int value = 0; value < 256; ++value) {
    const auto v = static_cast<std::uint8_t>(value);
    const Rgba8 color{v, static_cast<std::uint8_t>(255 - v), v, 255};
    for (const std::size_t count : {4U, 9U, 16U}) {
      EXPECT_EQ(MeanOf(std::vector<Rgba8>(count, color), kBlack), color);
    }
  }
}

TEST(DownsampleTest, APixelWithoutSamplesIsBackgroundAndNotTouched) {
  FrameImage drawn(64, 64);
  drawn.Set(63, 63, kKey, {9, 9, 9, 255});
  FrameImage picture(32, 32);
  Downsample(drawn, {.samples_per_side = 2}, {10, 20, 30, 255}, &picture);
  EXPECT_EQ(picture.colors[0], kClear);
  EXPECT_FALSE(picture.touched.Contains(0, 0));
  EXPECT_TRUE(picture.touched.Contains(1, 1));
  EXPECT_EQ(picture.CoveredOf(1, 1)[15], 0x8000);
  EXPECT_EQ(picture.CoveredOf(1, 1)[14], 0);
  EXPECT_NE(picture.colors[picture.IndexOf(31, 31)], kClear);
}

// The definition, in double.
Rgba8 ExpectedMean(const std::vector<Rgba8>& samples, Rgba8 background) {
  const auto light = [](std::uint8_t value) {
    const double srgb = value / 255.0;
    return srgb <= 0.04045 ? srgb / 12.92 : std::pow((srgb + 0.055) / 1.055, 2.4);
  };
  double sum[3] = {};
  double alpha = 0;
  for (const Rgba8& sample : samples) {
    const Rgba8 s = sample.a == 0 ? background : sample;
    const double weight = s.a / 255.0;
    sum[0] += weight * light(s.r);
    sum[1] += weight * light(s.g);
    sum[2] += weight * light(s.b);
    alpha += weight;
  }
  const auto value = [&](double premultiplied) {
    const double linear = alpha > 0 ? premultiplied / alpha : 0;
    const double srgb =
        linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
    return static_cast<std::uint8_t>(std::lround(255 * srgb));
  };
  return {
      value(sum[0]), value(sum[1]), value(sum[2]),
      static_cast<std::uint8_t>(std::lround(255 * alpha / static_cast<double>(samples.size())))};
}

TEST(DownsampleTest, AnySamplesAreTheMeanInLightWithAlphaToOneStep) {
  for (std::uint64_t seed = 0; seed < 3000; ++seed) {
    std::uint64_t counter = 0;
    const auto random = [&](int limit) {
      return static_cast<int>(limit * base::RandomUnit(seed, counter++));
    };
    const auto byte = [&] { return static_cast<std::uint8_t>(random(256)); };
    const int side = 2 + random(3);
    std::vector<Rgba8> samples;
    for (int i = 0; i < side * side; ++i) {
      const int kind = random(3);
      const Rgba8 color{byte(), byte(), byte(), byte()};
      samples.push_back(kind == 0 || color.a == 0 ? kClear
                        : kind == 1               ? Rgba8{color.r, color.g, color.b, 255}
                                                  : color);
    }
    const Rgba8 background{byte(), byte(), byte(), random(2) == 0 ? byte() : std::uint8_t{255}};
    bool is_all_clear = true;
    for (const Rgba8& sample : samples) {
      is_all_clear = is_all_clear && sample.a == 0;
    }
    const Rgba8 expected = is_all_clear ? kClear : ExpectedMean(samples, background);
    const Rgba8 mean = MeanOf(samples, background);
    EXPECT_NEAR(mean.a, expected.a, 1) << seed;
    if (expected.a > 1) {  // a colour that nearly nothing shows is rounded more
      EXPECT_NEAR(mean.r, expected.r, 1) << seed;
      EXPECT_NEAR(mean.g, expected.g, 1) << seed;
      EXPECT_NEAR(mean.b, expected.b, 1) << seed;
    }
  }
}

FrameImage RandomImage(int width, int height) {
  FrameImage image(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const std::uint64_t bits = base::RandomBits(5, image.IndexOf(x, y));
      if (x > y / 2 && bits % 5 != 0) {
        image.Set(x, y, image::FragmentKey(0.25F, static_cast<std::uint32_t>(bits % 100)),
                  {static_cast<std::uint8_t>(bits >> 8), static_cast<std::uint8_t>(bits >> 16),
                   static_cast<std::uint8_t>(bits >> 24), 255});
      }
    }
  }
  return image;
}

TEST(DownsampleTest, AWindowOfTheSamplesHasTheWholesPixelsForAnyNumberOfThreads) {
  for (const int side : {2, 3, 4}) {
    const FrameImage drawn = RandomImage(60 * side, 50 * side);
    FrameImage whole(60, 50);
    tbb::task_arena(1).execute(
        [&] { Downsample(drawn, {.samples_per_side = side}, kBlack, &whole); });
    FrameImage part(37, 21);
    tbb::task_arena(4).execute([&] {
      Downsample(drawn, {.samples_per_side = side, .begin_x = 11 * side, .begin_y = 23 * side},
                 kBlack, &part);
    });
    for (int y = 0; y < part.height; ++y) {
      for (int x = 0; x < part.width; ++x) {
        ASSERT_EQ(part.colors[part.IndexOf(x, y)], whole.colors[whole.IndexOf(x + 11, y + 23)]);
      }
    }
  }
}

TEST(CropTest, KeepsColorsAndKeys) {
  const FrameImage drawn = RandomImage(70, 50);
  FrameImage part(33, 20);
  Crop(drawn, 30, 17, &part);
  for (int y = 0; y < part.height; ++y) {
    for (int x = 0; x < part.width; ++x) {
      ASSERT_EQ(part.colors[part.IndexOf(x, y)], drawn.colors[drawn.IndexOf(x + 30, y + 17)]);
      ASSERT_EQ(part.keys[part.IndexOf(x, y)], drawn.keys[drawn.IndexOf(x + 30, y + 17)]);
    }
  }
}

}  // namespace
}  // namespace isoscope::picture
