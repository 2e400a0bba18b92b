// The arithmetic of deferred_shading.h, many fragments at a time. Internal to core/picture. It is
// compiled for several instruction sets, and all of them give the same bits.

#ifndef ISOSCOPE_CORE_PICTURE_LIGHT_KERNEL_H_
#define ISOSCOPE_CORE_PICTURE_LIGHT_KERNEL_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/frame/frame_spec.h"
#include "core/image/fragment.h"
#include "core/view/view.h"

namespace isoscope::picture {

// s^shininess is interpolated between kPowerSteps + 1 values; below the first one it is 0.
inline constexpr std::size_t kPowerSteps = 1024;

// A light: world space, unit length, with intensity * colour for each channel.
struct LightTerm {
  std::array<float, 3> direction{};
  std::array<float, 3> strength{};
};

// The materials of all surfaces, by surface index.
struct MaterialTerms {
  template <typename T>
  using BySurface = std::array<T, frame::kMaxSurfaces>;

  BySurface<float> ambient{};
  BySurface<float> diffuse{};
  BySurface<float> specular{};
  BySurface<float> is_by_normal{};  // 1: the normal is the base colour
  BySurface<float> first_power{};   // the s of the table's first value
  BySurface<float> power_scale{};   // steps of the table for each 1 of s
  // kPowerSteps + 1 values of each surface, one surface after the other.
  std::vector<float> powers;
};

// NOLINTNEXTLINE(clang-analyzer-optin.performance.Padding): lanes begin at cache lines.
struct LightBatch {
  static constexpr std::size_t kCapacity = 512;
  static constexpr std::size_t kSize = kCapacity + 16;  // vector operations write whole vectors
  template <typename T>
  using Lane = std::array<T, kSize>;

  std::size_t count = 0;
  alignas(64) Lane<float> x;  // pixel centres, in pixels of the whole viewport
  alignas(64) Lane<float> y;
  alignas(64) Lane<image::Rgba8> normal;  // image::EncodeNormal
  alignas(64) Lane<image::Rgba8> base;
  alignas(64) Lane<std::int32_t> surface;
  alignas(64) Lane<image::Rgba8> color;  // the result
};

// Fills color for the first `count` fragments. Without lights there is the head light.
void ComputeLight(const std::vector<LightTerm>& lights, const view::LinearVec3f& rays,
                  const MaterialTerms& materials, LightBatch* batch);

}  // namespace isoscope::picture

#endif  // ISOSCOPE_CORE_PICTURE_LIGHT_KERNEL_H_
