#include "server/admission/band_grid.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "core/frame/drawn_window.h"

namespace isoscope::server {
namespace {

frame::FrameSpec SpecOf(int width, int height) {
  frame::FrameSpec spec;
  spec.viewport = {width, height};
  return spec;
}

std::int64_t PixelsOf(const view::Viewport& size) {
  return std::int64_t{size.width_px} * size.height_px;
}

TEST(BandGridTest, BandsHaveEachPixelOnceInRowsFromTheTop) {
  for (const auto& [picture, band] : {std::pair(view::Viewport{70, 50}, view::Viewport{70, 50}),
                                      {{70, 50}, {70, 20}},
                                      {{70, 50}, {33, 17}},
                                      {{1, 9}, {64, 2}},
                                      {{9, 1}, {2, 64}},
                                      {{64, 64}, {1, 1}}}) {
    const BandGrid grid(picture, band);
    std::vector<int> times(static_cast<std::size_t>(PixelsOf(picture)));
    view::Region last;
    for (int i = 0; i < grid.count(); ++i) {
      const view::Region at = grid.At(i);
      EXPECT_LE(at.width_px, band.width_px);
      EXPECT_LE(at.height_px, band.height_px);
      EXPECT_TRUE(i == 0 || at.y > last.y || (at.y == last.y && at.x > last.x));
      EXPECT_TRUE(i == 0 || at.y > last.y || at.height_px == last.height_px);
      for (int y = at.y; y < at.y + at.height_px; ++y) {
        for (int x = at.x; x < at.x + at.width_px; ++x) {
          ++times[static_cast<std::size_t>(y) * static_cast<std::size_t>(picture.width_px) +
                  static_cast<std::size_t>(x)];
        }
      }
      last = at;
    }
    EXPECT_EQ(std::count(times.begin(), times.end(), 1), std::ssize(times));
  }
}

TEST(BandGridTest, ABandOfARegionLiesInTheViewport) {
  frame::FrameSpec spec = SpecOf(1000, 800);
  EXPECT_EQ(SpecOfBand(spec, {10, 20, 30, 40}).region, (view::Region{10, 20, 30, 40}));
  spec.region = view::Region{100, 200, 500, 500};
  EXPECT_EQ(SpecOfBand(spec, {10, 20, 30, 40}).region, (view::Region{110, 220, 30, 40}));
  EXPECT_EQ(SpecOfBand(spec, {10, 20, 30, 40}).viewport, spec.viewport);
  EXPECT_EQ(BandInTheMiddle(spec, {100, 50}).region, (view::Region{450, 375, 100, 50}));
}

// The whole has one tie rule and one renderer: bands of another would show.
TEST(BandGridTest, EachBandIsDrawnByTheBackEndOfTheWhole) {
  frame::FrameSpec spec = SpecOf(1000, 800);
  spec.surfaces.resize(2);
  for (const bool shows_values : {false, true}) {
    if (shows_values) {
      spec.surfaces[1].color_by =
          frame::ColorBy{.quantity = frame::ColorBy::Quantity::kGradientMagnitude};
    }
    ASSERT_EQ(frame::ShowsValues(spec), shows_values);
    const BandGrid grid(frame::ImageSizeOf(spec), {100, 300});
    for (const frame::BackEnd of_agents : {frame::BackEnd::kCpu, frame::BackEnd::kEgl}) {
      for (int i = 0; i < grid.count(); ++i) {
        EXPECT_EQ(frame::DrawnBy(SpecOfBand(spec, grid.At(i)), of_agents),
                  frame::DrawnBy(spec, of_agents));
      }
    }
  }
}

TEST(BandGridTest, WholeRowsOfAboutTheSameHeightAreTakenWhereTheyAreNoDearer) {
  const frame::FrameSpec spec = SpecOf(4000, 3001);
  const auto bands =
      BestBands(spec, [](const view::Viewport& band) { return PixelsOf(band) <= 4'000'000; });
  ASSERT_TRUE(bands.has_value());
  EXPECT_EQ(bands->columns(), 1);
  EXPECT_EQ(bands->rows(), 4);
  EXPECT_EQ(bands->band(), (view::Viewport{4000, 751}));
}

TEST(BandGridTest, ColumnsAreMadeWhereNoRowFits) {
  const frame::FrameSpec spec = SpecOf(4000, 3000);
  const auto bands = BestBands(spec, [](const view::Viewport& band) {
    return band.width_px <= 1500 && PixelsOf(band) <= 1'000'000;
  });
  ASSERT_TRUE(bands.has_value());
  EXPECT_EQ(bands->columns(), 3);
  EXPECT_LE(bands->band().width_px, 1500);
  EXPECT_LE(PixelsOf(bands->band()), 1'000'000);
}

// Each call of `fits` copies a frame, and a thread of gRPC waits for the plan.
TEST(BandGridTest, ColumnsThatCantBeCheaperAreNotTried) {
  int tried = 0;
  const auto bands = BestBands(SpecOf(16384, 16384), [&](const view::Viewport& band) {
    ++tried;
    return PixelsOf(band) <= 60'000'000;
  });
  ASSERT_TRUE(bands.has_value());
  EXPECT_EQ(bands->columns(), 1);
  EXPECT_EQ(bands->rows(), 5);
  EXPECT_LE(tried, 5 * 16);
}

// With thin rows most drawn pixels would be margins.
TEST(BandGridTest, WideMarginsMakeBandsSquarer) {
  frame::FrameSpec spec = SpecOf(8000, 8000);
  const auto fits = [&](const view::Viewport& band) {
    return PixelsOf(frame::DrawnWindowOf(BandInTheMiddle(spec, band)).image_size()) <= 2'000'000;
  };
  const auto without = BestBands(spec, fits);
  spec.effects.ambient_occlusion = frame::AmbientOcclusion{.radius_px = 56};
  const auto with = BestBands(spec, fits);
  ASSERT_TRUE(without.has_value() && with.has_value());
  EXPECT_EQ(without->columns(), 1);
  EXPECT_GT(with->columns(), 1);
  EXPECT_TRUE(fits(with->band()));
}

TEST(BandGridTest, NoBandIsSmallerThanTheSmallest) {
  EXPECT_EQ(SmallestBand({1000, 1000}), (view::Viewport{kMinBandSidePx, kMinBandSidePx}));
  EXPECT_EQ(SmallestBand({1000, 3}), (view::Viewport{kMinBandSidePx, 3}));
  const frame::FrameSpec spec = SpecOf(1000, 1000);
  EXPECT_FALSE(BestBands(spec, [](const view::Viewport&) { return false; }).has_value());
  EXPECT_FALSE(BestBands(spec, [](const view::Viewport& band) {
                 return band.width_px < kMinBandSidePx / 2 || band.height_px < kMinBandSidePx;
               }).has_value());
  const auto smallest = BestBands(spec, [](const view::Viewport& band) {
    return band.width_px <= kMinBandSidePx && band.height_px <= kMinBandSidePx;
  });
  ASSERT_TRUE(smallest.has_value());
  EXPECT_EQ(smallest->columns(), 16);
  EXPECT_EQ(smallest->rows(), 16);
}

}  // namespace
}  // namespace isoscope::server
