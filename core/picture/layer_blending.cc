// With T the light that passes all nearer layers (1 before the first), a layer of opacity a and
// colour c adds T a c and leaves T (1 - a). The opaque fragment, or the background with its alpha,
// gets the rest. A layer of opacity 0 adds nothing and leaves all light, so it changes no bit. But
// it counts as one of the max_layers, because the layers that an agent keeps must not depend on
// other agents. All sums are in float, in the order of the layers, so that the result depends on
// the layers alone.
//
// Source: Porter, Duff 1984, "Compositing digital images" (over).

#include "core/picture/layer_blending.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cstddef>
#include <vector>

#include <oneapi/tbb/parallel_for.h>

#include "core/base/check.h"
#include "core/picture/color_map.h"
#include "core/picture/linear_light.h"

namespace isoscope::picture {
namespace {

constexpr int kTilePx = image::TileSet::kTilePx;

// Light in linear values, each times its alpha.
struct Light {
  explicit Light(const LinearLightTables& light_tables) : tables(light_tables) {}

  void Add(image::Rgba8 color, float share) {
    r += share * static_cast<float>(tables.light[color.r]);
    g += share * static_cast<float>(tables.light[color.g]);
    b += share * static_cast<float>(tables.light[color.b]);
    alpha += share;
  }

  const LinearLightTables& tables;
  float r = 0;
  float g = 0;
  float b = 0;
  float alpha = 0;
};

// REQUIRES: value >= 0. Halves go up.
constexpr std::uint32_t RoundToNearest(float value) {
  return (static_cast<std::uint32_t>(value * 2) + 1) / 2;
}

// Straight alpha.
image::Rgba8 ColorOf(const Light& light, bool is_opaque) {
  // The shares of an opaque pixel add up to 1, except for rounding.
  const float alpha = is_opaque ? 1.0F : light.alpha;
  if (!(alpha > 0)) {
    return {};
  }
  const auto value = [&](float sum) {
    return light.tables.srgb[std::min(RoundToNearest(sum / alpha), kFullLight)];
  };
  return {value(light.r), value(light.g), value(light.b),
          static_cast<std::uint8_t>(RoundToNearest(std::min(alpha, 1.0F) * 255))};
}

// Calls fn(pixel index) for each pixel that has a layer, rows of tiles in parallel, and counts
// these pixels as drawn on.
template <typename Fn>
void ForEachPixel(const image::FrameImage& first_image, image::FrameImage* image, const Fn& fn) {
  ISOSCOPE_CHECK_EQ(first_image.width, image->width);
  ISOSCOPE_CHECK_EQ(first_image.height, image->height);
  tbb::parallel_for(0, first_image.touched.rows(), [&](int row) {
    first_image.touched.ForEachInRow(row, [&](int column) {
      const image::TileMask& mask = first_image.CoveredOf(column, row);
      for (int y = 0; y < kTilePx; ++y) {
        const std::size_t begin = image->IndexOf(column * kTilePx, row * kTilePx + y);
        for (std::uint32_t rest = mask[static_cast<std::size_t>(y)]; rest != 0; rest &= rest - 1) {
          fn(begin + static_cast<std::size_t>(std::countr_zero(rest)));
        }
      }
      image->touched.Insert(column, row);
      image::UniteInto(mask, &image->CoveredOf(column, row));
    });
  });
}

// The opacities of a surface by the step of its colour map; of one without map opacities, all
// alike.
using OpacityTable = std::array<float, kColorMapSteps>;

std::vector<OpacityTable> OpacityTablesOf(const frame::FrameSpec& spec) {
  std::vector<OpacityTable> tables(spec.surfaces.size());
  for (std::size_t surface = 0; surface < tables.size(); ++surface) {
    for (std::size_t step = 0; step < kColorMapSteps; ++step) {
      const frame::Surface& of = spec.surfaces[surface];
      tables[surface][step] =
          of.color_by.has_value() ? of.opacity * OpacityOf(*of.color_by, step) : of.opacity;
    }
  }
  return tables;
}

}  // namespace

std::int64_t BlendLayers(const image::LayerStack& layers, const frame::FrameSpec& spec,
                         image::FrameImage* image) {
  return BlendLayers(layers, spec, {0, 0, image->width, image->height}, image);
}

std::int64_t BlendLayers(const image::LayerStack& layers, const frame::FrameSpec& spec,
                         const view::PixelRect& counted, image::FrameImage* image) {
  const std::vector<const image::FrameImage*> layer_images = layers.LayerImages();
  if (layer_images.empty()) {
    return 0;
  }
  const LinearLightTables& tables = LinearLight();
  const std::vector<OpacityTable> opacities = OpacityTablesOf(spec);
  const image::Rgba8 background = spec.background_color;
  const float background_alpha = static_cast<float>(background.a) / 255.0F;
  const auto counts = [&](std::size_t pixel) {
    const auto x = static_cast<int>(pixel % static_cast<std::size_t>(image->width));
    const auto y = static_cast<int>(pixel / static_cast<std::size_t>(image->width));
    return x >= counted.begin_x && x < counted.end_x && y >= counted.begin_y && y < counted.end_y;
  };
  std::atomic<std::int64_t> truncated_count{0};
  ForEachPixel(*layer_images.front(), image, [&](std::size_t pixel) {
    const std::uint64_t opaque = image->keys[pixel];
    Light light(tables);
    float left = 1;
    int count = 0;
    for (const image::FrameImage* layer_image : layer_images) {
      const std::uint64_t key = layer_image->keys[pixel];
      if (key == image::kBackgroundKey || !layers.IsBefore(key, opaque)) {
        break;
      }
      if (count == spec.max_layers) {
        truncated_count.fetch_add(counts(pixel) ? 1 : 0, std::memory_order_relaxed);
        break;
      }
      ++count;
      const image::Rgba8 color = layer_image->colors[pixel];
      const float opacity = opacities[layers.order().SurfaceOf(image::OwnerOf(key))][color.a];
      light.Add(color, left * opacity);
      left *= 1 - opacity;
    }
    if (!(light.alpha > 0)) {
      return;  // no visible layer
    }
    const bool is_opaque = opaque != image::kBackgroundKey || background.a == 255;
    if (opaque != image::kBackgroundKey) {
      light.Add(image->colors[pixel], left);
    } else {
      light.Add(background, left * background_alpha);
    }
    image->colors[pixel] = ColorOf(light, is_opaque);
  });
  return truncated_count.load();
}

void ShowNearest(const image::LayerStack& layers, image::FrameImage* image) {
  if (!layers.empty()) {
    const image::FrameImage& first = *layers.LayerImages().front();
    ForEachPixel(first, image, [&](std::size_t pixel) {
      if (layers.IsBefore(first.keys[pixel], image->keys[pixel])) {
        image->keys[pixel] = first.keys[pixel];
        image->colors[pixel] = first.colors[pixel];
      }
    });
  }
}

void ShowNearestKeys(const image::LayerStack& layers, image::FrameImage* image) {
  if (!layers.empty()) {
    const image::FrameImage& first = *layers.LayerImages().front();
    ForEachPixel(first, image, [&](std::size_t pixel) {
      if (layers.IsBefore(first.keys[pixel], image->keys[pixel])) {
        image->keys[pixel] = first.keys[pixel];
      }
    });
  }
}

}  // namespace isoscope::picture
