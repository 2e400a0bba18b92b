// BestBands tries 1, 2, 3 ... columns, until more can't be cheaper. For each it finds the greatest
// height that fits, and makes all rows about as high. So a band may have half of kMinBandSidePx a
// side, and less at the right and at the bottom. A band costs the pixels that are drawn for
// it, and something for its rays, its messages, and blocks that lie in its neighbours, too.

#include "server/admission/band_grid.h"

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/base/check.h"
#include "core/frame/drawn_window.h"

namespace isoscope::server {
namespace {

// The cost of a band besides its pixels, in drawn pixels.
constexpr std::int64_t kBandCostPx = std::int64_t{1} << 18;

// More columns must be cheaper by this share: whole rows are joined and encoded sooner.
constexpr std::int64_t kColumnsWorth = 16;

int DivideUp(int value, int divisor) { return (value + divisor - 1) / divisor; }

// The greatest height in [least, most] that fits. REQUIRES: `least` fits.
int GreatestHeight(int width, int least, int most,
                   absl::FunctionRef<bool(const view::Viewport& band)> fits) {
  int enough = least;
  int too_much = most + 1;
  while (too_much - enough > 1) {
    const int middle = enough + (too_much - enough) / 2;
    (fits({width, middle}) ? enough : too_much) = middle;
  }
  return enough;
}

// The least that `columns` columns can cost, however high their bands are.
std::int64_t LeastCostOf(const frame::FrameSpec& spec, int columns) {
  const view::Viewport picture = frame::ImageSizeOf(spec);
  return std::int64_t{picture.width_px} * picture.height_px * spec.effects.samples() +
         columns * kBandCostPx;
}

std::int64_t CostOf(const frame::FrameSpec& spec, const BandGrid& grid) {
  const view::Viewport drawn =
      frame::DrawnWindowOf(BandInTheMiddle(spec, grid.band())).image_size();
  return grid.count() * (std::int64_t{drawn.width_px} * drawn.height_px + kBandCostPx);
}

}  // namespace

BandGrid::BandGrid(const view::Viewport& picture, const view::Viewport& band)
    : picture_(picture),
      band_{std::min(band.width_px, picture.width_px), std::min(band.height_px, picture.height_px)},
      columns_(DivideUp(picture.width_px, band_.width_px)),
      rows_(DivideUp(picture.height_px, band_.height_px)) {}

view::Region BandGrid::At(int index) const {
  ISOSCOPE_CHECK_LT(index, count());
  const int x = index % columns_ * band_.width_px;
  const int y = index / columns_ * band_.height_px;
  return {x, y, std::min(band_.width_px, picture_.width_px - x),
          std::min(band_.height_px, picture_.height_px - y)};
}

view::Viewport SmallestBand(const view::Viewport& picture) {
  return {std::min(picture.width_px, kMinBandSidePx), std::min(picture.height_px, kMinBandSidePx)};
}

frame::FrameSpec BandInTheMiddle(const frame::FrameSpec& spec, const view::Viewport& band) {
  frame::FrameSpec of_band = spec;
  of_band.region =
      view::Region{(spec.viewport.width_px - band.width_px) / 2,
                   (spec.viewport.height_px - band.height_px) / 2, band.width_px, band.height_px};
  return of_band;
}

BandCosts BandCostsOf(const frame::FrameSpec& spec) {
  std::vector<std::string> costs;
  std::vector<std::string> advice;
  if (const int samples = spec.effects.samples(); samples > 1) {
    costs.push_back(absl::StrCat(samples, " samples"));
    advice.emplace_back("fewer samples");
  }
  if (const int margin = spec.effects.margin_px(); margin > 0) {
    costs.push_back(absl::StrCat(margin, " pixels around it for effects"));
    advice.emplace_back("a smaller ambient_occlusion or silhouette");
  }
  if (frame::HasLayers(spec)) {
    costs.push_back(absl::StrCat(spec.max_layers, " layers"));
    advice.emplace_back("fewer max_layers");
  }
  if (costs.empty()) {
    return {};
  }
  return {.text = absl::StrCat(" with ", absl::StrJoin(costs, " and ")),
          .advice = absl::StrCat("ask for ", absl::StrJoin(advice, ", for "))};
}

frame::FrameSpec SpecOfBand(const frame::FrameSpec& spec, const view::Region& band) {
  frame::FrameSpec of_band = spec;
  of_band.region = band;
  if (spec.region.has_value()) {
    of_band.region->x += spec.region->x;
    of_band.region->y += spec.region->y;
  }
  return of_band;
}

std::optional<BandGrid> BestBands(const frame::FrameSpec& spec,
                                  absl::FunctionRef<bool(const view::Viewport& band)> fits) {
  const view::Viewport picture = frame::ImageSizeOf(spec);
  const view::Viewport smallest = SmallestBand(picture);
  std::optional<BandGrid> best;
  std::int64_t best_cost = 0;
  const int most_columns = DivideUp(picture.width_px, smallest.width_px);
  for (int columns = 1; columns <= most_columns; ++columns) {
    if (best.has_value() && LeastCostOf(spec, columns) >= best_cost) {
      break;
    }
    const int width = DivideUp(picture.width_px, columns);
    if (!fits({width, smallest.height_px})) {
      continue;
    }
    const int height = GreatestHeight(width, smallest.height_px, picture.height_px, fits);
    const int rows = DivideUp(picture.height_px, height);
    const BandGrid grid(picture, {width, DivideUp(picture.height_px, rows)});
    const std::int64_t cost = CostOf(spec, grid);
    if (!best.has_value() || cost + cost / kColumnsWorth < best_cost) {
      best = grid;
      best_cost = cost;
    }
  }
  return best;
}

}  // namespace isoscope::server
