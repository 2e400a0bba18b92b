#include "clients/cpp/picture_file/picture_scaling.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "core/picture/linear_light.h"

namespace isoscope::client {
namespace {

constexpr float kOpaque = 255;

int RoundedSide(double side, int limit) {
  return std::clamp(static_cast<int>(std::lround(side)), 1, limit);
}

}  // namespace

view::Viewport FitInside(const view::Viewport& picture, const view::Viewport& limit,
                         double pixel_aspect) {
  const double width = picture.width_px;
  const double height = picture.height_px / pixel_aspect;
  const double scale =
      std::min({limit.width_px / width, limit.height_px / height, 1.0, picture.height_px / height});
  return {.width_px = RoundedSide(width * scale, std::max(limit.width_px, 1)),
          .height_px = RoundedSide(height * scale, std::max(limit.height_px, 1))};
}

PictureScaler::Shares PictureScaler::SharesOf(int from, int to) {
  Shares result;
  const double scale = static_cast<double>(to) / from;
  for (int i = 0; i < from; ++i) {
    result.begins.push_back(result.shares.size());
    const double begin = i * scale;
    const double end = i + 1 == from ? to : (i + 1) * scale;
    for (int index = static_cast<int>(begin); index < to && index < end; ++index) {
      const double covered =
          std::min(end, index + 1.0) - std::max(begin, static_cast<double>(index));
      if (covered > 0) {
        result.shares.push_back({index, static_cast<float>(covered)});
      }
    }
  }
  result.begins.push_back(result.shares.size());
  return result;
}

PictureScaler::PictureScaler(const view::Viewport& from, const view::Viewport& to)
    : to_(to),
      columns_(SharesOf(from.width_px, to.width_px)),
      rows_(SharesOf(from.height_px, to.height_px)),
      sums_(static_cast<std::size_t>(to.width_px) * static_cast<std::size_t>(to.height_px)) {}

void PictureScaler::Add(int x, int y, const image::RgbaImage& piece) {
  const picture::LinearLightTables& tables = picture::LinearLight();
  const auto width = static_cast<std::size_t>(piece.width);
  for (std::size_t row = 0; row < static_cast<std::size_t>(piece.height); ++row) {
    const std::size_t old_row = static_cast<std::size_t>(y) + row;
    for (std::size_t i = rows_.begins[old_row]; i < rows_.begins[old_row + 1]; ++i) {
      const Share& row_share = rows_.shares[i];
      Sum* const sums = &sums_[static_cast<std::size_t>(row_share.index) *
                               static_cast<std::size_t>(to_.width_px)];
      const image::Rgba8* pixel = &piece.pixels[row * width];
      for (std::size_t column = static_cast<std::size_t>(x);
           column < static_cast<std::size_t>(x) + width; ++column, ++pixel) {
        const float alpha = static_cast<float>(pixel->a) * row_share.weight;
        for (std::size_t j = columns_.begins[column]; j < columns_.begins[column + 1]; ++j) {
          const float weight = alpha * columns_.shares[j].weight;
          Sum& sum = sums[columns_.shares[j].index];
          sum.r += weight * static_cast<float>(tables.light[pixel->r]);
          sum.g += weight * static_cast<float>(tables.light[pixel->g]);
          sum.b += weight * static_cast<float>(tables.light[pixel->b]);
          sum.a += weight;
        }
      }
    }
  }
}

image::RgbaImage PictureScaler::Finish() const {
  const picture::LinearLightTables& tables = picture::LinearLight();
  const auto srgb = [&tables](float sum, float alpha) {
    const auto light = static_cast<std::uint32_t>(sum / alpha + 0.5F);
    return tables.srgb[std::min(light, picture::kFullLight)];
  };
  image::RgbaImage picture{.width = to_.width_px, .height = to_.height_px, .pixels = {}};
  picture.pixels.resize(sums_.size());
  for (std::size_t i = 0; i < sums_.size(); ++i) {
    const Sum& sum = sums_[i];
    if (sum.a > 0) {
      const float alpha = std::min(sum.a, kOpaque);
      picture.pixels[i] = {srgb(sum.r, sum.a), srgb(sum.g, sum.a), srgb(sum.b, sum.a),
                           static_cast<std::uint8_t>(std::lround(alpha))};
    }
  }
  return picture;
}

image::RgbaImage ScalePicture(image::RgbaImage picture, const view::Viewport& to) {
  if (picture.width == to.width_px && picture.height == to.height_px) {
    return picture;
  }
  PictureScaler scaler({.width_px = picture.width, .height_px = picture.height}, to);
  scaler.Add(0, 0, picture);
  return scaler.Finish();
}

}  // namespace isoscope::client
