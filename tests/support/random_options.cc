#include "tests/support/random_options.h"

#include <algorithm>
#include <functional>
#include <utility>

#include "core/base/random.h"
#include "core/base/status_macros.h"
#include "core/picture/deferred_shading.h"
#include "core/picture/layer_blending.h"
#include "core/view/view.h"
#include "tests/support/scenes.h"

namespace isoscope::testing {
namespace {

// A map, a range for the gradient, and now and then opacities.
void AddRandomMap(const std::function<double()>& random, frame::ColorBy* color_by) {
  color_by->map = static_cast<frame::ColorMap>(static_cast<int>(6 * random()));
  if (color_by->quantity == frame::ColorBy::Quantity::kGradientMagnitude ||
      color_by->quantity == frame::ColorBy::Quantity::kField) {
    color_by->range = frame::ColorRange{random(), 1 + 20 * random()};
  }
  if (random() < 0.4) {
    color_by->opacity_at_min = random() < 0.5 ? 0.0F : static_cast<float>(random());
    color_by->opacity_at_max = static_cast<float>(random());
  }
}

}  // namespace

image::FrameImage Crop(const image::FrameImage& whole, const view::Region& region) {
  image::FrameImage part(region.width_px, region.height_px);
  for (int y = 0; y < region.height_px; ++y) {
    for (int x = 0; x < region.width_px; ++x) {
      const std::size_t from = whole.IndexOf(region.x + x, region.y + y);
      part.keys[part.IndexOf(x, y)] = whole.keys[from];
      part.colors[part.IndexOf(x, y)] = whole.colors[from];
    }
  }
  return part;
}

view::Region RandomRegion(std::uint64_t seed, const view::Viewport& viewport) {
  const auto part = [seed](std::uint64_t counter, int size) {
    const int begin = static_cast<int>(size * base::RandomUnit(seed, counter));
    return std::pair(begin,
                     1 + static_cast<int>((size - begin) * base::RandomUnit(seed, counter + 1)));
  };
  const auto [x, width] = part(1000, viewport.width_px);
  const auto [y, height] = part(1002, viewport.height_px);
  return {x, y, std::min(width, viewport.width_px - x), std::min(height, viewport.height_px - y)};
}

std::vector<frame::Surface> ThreeSurfaces(double isovalue, double step) {
  std::vector<frame::Surface> surfaces(3);
  surfaces[0].rule.isovalue = isovalue + step;
  surfaces[0].appearance.base_color = {200, 60, 60, 255};
  surfaces[1].rule.isovalue = isovalue;
  surfaces[1].appearance.base_color = {60, 200, 60, 255};
  surfaces[2].rule.isovalue = isovalue;
  surfaces[2].appearance.base_color = {60, 60, 200, 255};
  return surfaces;
}

view::ClipRegion RandomClip(std::uint64_t seed, const math::Box3d& bounds) {
  std::uint64_t counter = 0;
  const auto random = [&] { return base::RandomUnit(seed, 900'000 + counter++); };
  const auto point = [&] {
    math::Vec3d p;
    for (int axis = 0; axis < 3; ++axis) {
      p[axis] = bounds.min[axis] + (bounds.max[axis] - bounds.min[axis]) * random();
    }
    return p;
  };
  view::ClipRegion clip;
  const auto count = static_cast<int>(4 * random());
  for (int i = 0; i < count; ++i) {
    math::Vec3d normal{random() - 0.5, random() - 0.5, random() - 0.5};
    if (i == 2) {
      normal = {0, 0, random() < 0.5 ? -2.0 : 2.0};  // along faces of blocks
    }
    clip.half_spaces.push_back({normal, math::Dot(normal, point())});
  }
  if (count == 0 || random() < 0.3) {
    clip.box.emplace();
    clip.box->Add(point());
    clip.box->Add(point());
  }
  return clip;
}

void AddRandomCaps(std::uint64_t seed, frame::FrameSpec* spec) {
  const double choice = base::RandomUnit(seed, 700'000);
  if (choice < 0.33) {
    return;
  }
  spec->caps.emplace();
  if (choice > 0.66) {
    spec->caps->map = static_cast<frame::ColorMap>(static_cast<int>(600 * choice) % 6);
    spec->caps->range = frame::ColorRange{0.0, 200 * choice};
  }
}

void MakeRandomlyTranslucent(std::uint64_t seed, frame::FrameSpec* spec) {
  std::uint64_t counter = 0;
  const auto random = [&] { return base::RandomUnit(seed, 800'000 + counter++); };
  const bool all = random() < 0.25;
  for (frame::Surface& surface : spec->surfaces) {
    if (all || random() < 0.5) {
      surface.opacity = static_cast<float>(0.05 + 0.9 * random());
    }
  }
  constexpr int kMaxLayers[] = {1, 2, 3, 8, 16};
  spec->max_layers = kMaxLayers[static_cast<std::size_t>(5 * random())];
  if (random() < 0.5) {
    spec->background_color = {20, 40, 80, static_cast<std::uint8_t>(255 * random())};
  }
}

void AddRandomLook(std::uint64_t seed, frame::FrameSpec* spec) {
  std::uint64_t counter = 0;
  const auto random = [&] { return base::RandomUnit(seed, 800'000 + counter++); };
  for (auto count = static_cast<int>(5 * random()); count > 0; --count) {
    frame::Light& light = spec->lights.emplace_back();
    light.direction = {random() - 0.5, random() - 0.5, random() - 0.4};
    light.space = random() < 0.5 ? frame::Light::Space::kView : frame::Light::Space::kWorld;
    light.intensity = static_cast<float>(1.5 * random());
    light.color.g = static_cast<std::uint8_t>(256 * random());
  }
  for (frame::Surface& surface : spec->surfaces) {
    if (spec->lights.empty() || random() < 0.7) {
      frame::ColorBy& color_by = surface.color_by.emplace();
      color_by.quantity = static_cast<frame::ColorBy::Quantity>(static_cast<int>(5 * random()));
      if (color_by.quantity != frame::ColorBy::Quantity::kNormal) {
        AddRandomMap(random, &color_by);
      }
      spec->sends_map_steps = spec->sends_map_steps || surface.shows_values();
    }
    surface.appearance.shininess = static_cast<float>(1 + 99 * random());
  }
  spec->sends_normals = true;
}

void ShowRandomFields(std::uint64_t seed, const std::vector<std::string>& fields,
                      frame::FrameSpec* spec) {
  std::uint64_t counter = 0;
  const auto random = [&] { return base::RandomUnit(seed, 600'000 + counter++); };
  const auto chosen =
      static_cast<std::size_t>(static_cast<double>(spec->surfaces.size()) * random());
  for (std::size_t i = 0; i < spec->surfaces.size(); ++i) {
    if (i == chosen || random() < 0.5) {
      frame::ColorBy& color_by = spec->surfaces[i].color_by.emplace();
      color_by.quantity = frame::ColorBy::Quantity::kField;
      color_by.field =
          fields[static_cast<std::size_t>(static_cast<double>(fields.size()) * random())];
      AddRandomMap(random, &color_by);
    }
  }
  if (random() < 0.5) {
    spec->nan_color = image::Rgba8{250, 20, 200, 255};
  }
  spec->sends_normals = true;
  spec->sends_map_steps = true;
}

absl::StatusOr<Picture> PictureOf(server::FrameResult result, const frame::FrameSpec& spec,
                                  const volume::BlockLayout& layout,
                                  const volume::GridGeometry& geometry) {
  Picture picture;
  ISOSCOPE_ASSIGN_OR_RETURN(const view::View view,
                            view::View::Make(*spec.camera, spec.viewport, geometry, spec.region));
  const image::FragmentOrder order{.block_count = static_cast<std::uint32_t>(layout.block_count())};
  std::optional<picture::DeferredShader> shader;
  if (spec.sends_normals) {
    shader.emplace(spec, view, order);
  }
  picture.contents = picture::FindContents({.spec = &spec,
                                            .order = order,
                                            .image = &result.image,
                                            .layers = &result.layers,
                                            .shader = shader ? &*shader : nullptr},
                                           {0, 0, result.image.width, result.image.height},
                                           /*with_shown=*/true);
  if (shader.has_value()) {
    shader->ShadeImage(&result.image);
    for (image::FrameImage* const layer_image : result.layers.MutableLayerImages()) {
      shader->ShadeImage(layer_image);
    }
  } else {
    picture::ColorCapsWithoutSamples(spec, &result.image);
  }
  picture.image = std::move(result.image);
  picture.truncated_pixel_count = picture::BlendLayers(result.layers, spec, &picture.image);
  if (!result.layers.empty()) {
    picture.layer_pixel_count = CoveredPixels(*result.layers.LayerImages().front());
  }
  return picture;
}

}  // namespace isoscope::testing
