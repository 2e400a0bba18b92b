// The terms of light_kernel.h, made once per frame, and batches of fragments for it:
//
//   1. LightTermOf turns a light into world space, and multiplies its colour by its intensity.
//   2. AddMaterial tabulates s^shininess for s from the least share that shows to 1. Surfaces of
//      equal shininess copy the table.
//   3. Append puts a fragment into a batch. BaseOf gives its base colour: the surface's, or that of
//      its colour map at a step. The step comes with the normal (values), or from the position
//      (coordinates).
//   4. ComputeLight shades a full batch.
//
// Caps that show samples have owners behind those of the surfaces. TakeSampleCap gives them back
// their own owner; they have their colour already.

#include "core/picture/deferred_shading.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/base/check.h"
#include "core/image/normal_and_step.h"
#include "core/math/elementary.h"

namespace isoscope::picture {
namespace {

constexpr double kChannelMax = 255;
// Highlights below this share are 0: a 250th of a level.
constexpr double kLeastPower = 0x1p-16;

std::array<float, 3> ToFloats(const math::Vec3d& v) {
  return {static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)};
}

LightTerm LightTermOf(const frame::Light& light, const view::View& view) {
  math::Vec3d direction = light.direction;
  if (light.space == frame::Light::Space::kView) {
    direction = view.right() * direction.x + view.up() * direction.y - view.forward() * direction.z;
  }
  const auto strength = [&](std::uint8_t channel) {
    return static_cast<float>(static_cast<double>(light.intensity) * channel / kChannelMax);
  };
  return {.direction = ToFloats(math::Normalized(direction)),
          .strength = {strength(light.color.r), strength(light.color.g), strength(light.color.b)}};
}

// Adds the material of a surface. Those before it are added.
void AddMaterial(const std::vector<frame::Surface>& surfaces, std::size_t index,
                 MaterialTerms* terms) {
  const frame::Surface& surface = surfaces[index];
  const frame::Appearance& appearance = surface.appearance;
  terms->ambient[index] = appearance.ambient;
  terms->diffuse[index] = appearance.diffuse.value_or(1.0F - appearance.ambient);
  terms->specular[index] = appearance.specular;
  terms->is_by_normal[index] =
      surface.color_by && surface.color_by->quantity == frame::ColorBy::Quantity::kNormal ? 1.0F
                                                                                          : 0.0F;
  // Mostly all surfaces have one shininess, and its powers take long to compute.
  for (std::size_t known = 0; known < index; ++known) {
    if (surfaces[known].appearance.shininess == appearance.shininess) {
      terms->first_power[index] = terms->first_power[known];
      terms->power_scale[index] = terms->power_scale[known];
      const std::size_t first = known * (kPowerSteps + 1);
      for (std::size_t i = 0; i <= kPowerSteps; ++i) {
        terms->powers.push_back(terms->powers[first + i]);
      }
      return;
    }
  }
  const auto shininess = static_cast<double>(appearance.shininess);
  const double first = math::Pow(kLeastPower, 1 / shininess);
  terms->first_power[index] = static_cast<float>(first);
  terms->power_scale[index] = static_cast<float>(kPowerSteps / (1 - first));
  terms->powers.push_back(0);
  for (std::size_t i = 1; i <= kPowerSteps; ++i) {
    const double s = first + (1 - first) * static_cast<double>(i) / kPowerSteps;
    terms->powers.push_back(static_cast<float>(math::Pow(s, shininess)));
  }
}

}  // namespace

bool NeedsDeferredShading(const frame::FrameSpec& spec) {
  return !spec.lights.empty() ||
         std::any_of(spec.surfaces.begin(), spec.surfaces.end(),
                     [](const frame::Surface& surface) { return surface.color_by.has_value(); });
}

DeferredShader::DeferredShader(const frame::FrameSpec& spec, const view::View& view,
                               const image::FragmentOrder& order)
    : order_(order),
      unprojection_(view),
      first_x_(static_cast<float>(view.region().x) + 0.5F),
      first_y_(static_cast<float>(view.region().y) + 0.5F),
      rays_(view::ToFloats(view.image_plane().rays.direction)),
      has_sample_caps_(frame::HasSampleCaps(spec)),
      nan_color_of_caps_(has_sample_caps_ ? frame::NanColorOf(spec, *spec.caps->map)
                                          : image::Rgba8()) {
  ISOSCOPE_CHECK_LE(spec.surfaces.size(), frame::kMaxSurfaces);
  for (const frame::Light& light : spec.lights) {
    lights_.push_back(LightTermOf(light, view));
  }
  for (const frame::Surface& surface : spec.surfaces) {
    AddMaterial(spec.surfaces, bases_.size(), &materials_);
    BaseColor& base = bases_.emplace_back();
    base.color = surface.appearance.base_color;
    if (surface.color_by && surface.color_by->quantity != frame::ColorBy::Quantity::kNormal) {
      base.map = &ColorMapTableOf(surface.color_by->map);
      base.has_step = surface.shows_values();
      if (!base.has_step) {
        base.range = ColorRangeOf(*surface.color_by, view.geometry());
        base.axis = AxisOf(surface.color_by->quantity);
      }
      base.keeps_step = surface.color_by->is_translucent();
      base.nan_color = frame::NanColorOf(spec, surface.color_by->map);
      base.step_of_nan = StepOfNan(*surface.color_by);
    }
  }
}

// REQUIRES: the surface has a map.
std::size_t DeferredShader::StepOf(const BaseColor& base, const NormalFragment& fragment) const {
  if (base.has_step) {
    return image::HasStep(fragment.normal) ? image::StepOf(fragment.normal) : base.step_of_nan;
  }
  const float distance = unprojection_.DistanceOf(image::DepthOf(fragment.key));
  return ColorMapStepOf(unprojection_.CoordinateOf(base.axis, fragment.x, fragment.y, distance),
                        base.range);
}

std::size_t DeferredShader::OpacityStepOf(const NormalFragment& fragment) const {
  return StepOf(bases_[order_.SurfaceOf(image::OwnerOf(fragment.key))], fragment);
}

image::Rgba8 DeferredShader::BaseOf(const BaseColor& base, const NormalFragment& fragment) const {
  if (base.map == nullptr) {
    return base.color;
  }
  const std::size_t step = StepOf(base, fragment);
  const bool is_nan = base.has_step && !image::HasStep(fragment.normal);
  image::Rgba8 color = is_nan ? base.nan_color : (*base.map)[step];
  color.a = base.keeps_step ? static_cast<std::uint8_t>(step) : base.color.a;
  return color;
}

void DeferredShader::Append(const NormalFragment& fragment, LightBatch* batch) const {
  const std::size_t surface =
      bases_.size() == 1 ? 0 : order_.SurfaceOf(image::OwnerOf(fragment.key));
  const std::size_t i = batch->count++;
  batch->x[i] = first_x_ + static_cast<float>(fragment.x);
  batch->y[i] = first_y_ + static_cast<float>(fragment.y);
  batch->normal[i] = bases_[surface].has_step ? image::NormalOf(fragment.normal) : fragment.normal;
  batch->surface[i] = static_cast<std::int32_t>(surface);
  batch->base[i] = BaseOf(bases_[surface], fragment);
}

void DeferredShader::Shade(std::span<const NormalFragment> fragments,
                           std::span<image::Rgba8> colors) const {
  LightBatch batch{};
  for (std::size_t begin = 0; begin < fragments.size(); begin += LightBatch::kCapacity) {
    const std::size_t count = std::min(fragments.size() - begin, LightBatch::kCapacity);
    batch.count = 0;
    for (const NormalFragment& fragment : fragments.subspan(begin, count)) {
      Append(fragment, &batch);
    }
    ComputeLight(lights_, rays_, materials_, &batch);
    std::copy_n(batch.color.begin(), count, colors.begin() + static_cast<std::ptrdiff_t>(begin));
  }
}

bool DeferredShader::TakeSampleCap(std::uint64_t* key) const {
  const auto first_owner = order_.OwnerOf(static_cast<std::uint32_t>(bases_.size()), 0);
  const std::uint32_t owner = image::OwnerOf(*key);
  if (owner == image::kNoOwner || owner < first_owner) {
    return false;
  }
  *key = (*key >> 32 << 32) | std::uint64_t{owner - first_owner};
  return true;
}

void DeferredShader::ShadeTileRow(int row, image::FrameImage* image) const {
  constexpr int kTilePx = image::TileSet::kTilePx;
  LightBatch batch{};
  std::array<std::size_t, LightBatch::kCapacity> pixels{};
  const auto flush = [&] {
    ComputeLight(lights_, rays_, materials_, &batch);
    for (std::size_t i = 0; i < batch.count; ++i) {
      image->colors[pixels[i]] = batch.color[i];
    }
    batch.count = 0;
  };
  image->touched.ForEachInRow(row, [&](int column) {
    const image::TileMask& covered = image->CoveredOf(column, row);
    if (batch.count + covered.size() * kTilePx > LightBatch::kCapacity) {
      flush();
    }
    for (std::size_t k = 0; k < covered.size(); ++k) {
      const int y = row * kTilePx + static_cast<int>(k);
      for (unsigned rest = covered[k]; rest != 0; rest &= rest - 1) {
        const int x = column * kTilePx + std::countr_zero(rest);
        const std::size_t pixel = image->IndexOf(x, y);
        if (has_sample_caps_ && TakeSampleCap(&image->keys[pixel])) {
          if (image->colors[pixel] == kNoSample) {
            image->colors[pixel] = nan_color_of_caps_;
          }
          continue;
        }
        if (image::OwnerOf(image->keys[pixel]) != image::kNoOwner) {
          pixels[batch.count] = pixel;
          Append({x, y, image->keys[pixel], image->colors[pixel]}, &batch);
        }
      }
    }
  });
  flush();
}

void DeferredShader::ShadeImage(image::FrameImage* image) const {
  tbb::parallel_for(tbb::blocked_range<int>(0, image->touched.rows()),
                    [&](const tbb::blocked_range<int>& rows) {
                      for (int row = rows.begin(); row < rows.end(); ++row) {
                        ShadeTileRow(row, image);
                      }
                    });
}

}  // namespace isoscope::picture
