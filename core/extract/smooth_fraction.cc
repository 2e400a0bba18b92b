#include "core/extract/smooth_fraction.h"

#include <algorithm>
#include <array>
#include <cstddef>

#include "core/base/coding.h"
#include "core/volume/scalar_type.h"

namespace isoscope::extract {
namespace {

using math::Index3;

// No label loses more than half of its width: thin ones stay.
constexpr double kLeastFraction = 0.25;
constexpr std::array<int, 3> kLabelWeights{1, 2, 1};

// lower, upper: d at both ends of the edge, times 64
double FractionOfShares(int lower, int upper) {
  if (lower > 0 && upper < 0) {
    // Whole numbers of at most 64: the quotient is rounded once, and the same if both signs change.
    return std::clamp(static_cast<double>(lower) / static_cast<double>(lower - upper),
                      kLeastFraction, 1 - kLeastFraction);
  }
  if (lower <= 0 && upper >= 0) {
    return 0.5;  // each end is alone among samples of the other label
  }
  return upper < 0 ? kLeastFraction : 1 - kLeastFraction;  // one end is alone
}

template <typename T>
double SmoothFractionAt(const char* bytes, const Index3& dims, const Index3& lower, int axis) {
  const std::array<std::int64_t, 3> strides{1, dims.x, dims.x * dims.y};
  // By axis: offsets of the samples before, at, after, and two after the lower one.
  std::array<std::array<std::size_t, 4>, 3> offsets{};
  for (int a = 0; a < 3; ++a) {
    const auto at = static_cast<std::size_t>(a);
    for (int k = 0; k < 4; ++k) {
      offsets[at][static_cast<std::size_t>(k)] = static_cast<std::size_t>(
          strides[at] * std::clamp<std::int64_t>(lower[a] + k - 1, 0, dims[a] - 1));
    }
  }
  const std::array<std::size_t, 4>& along = offsets[static_cast<std::size_t>(axis)];
  const std::array<std::size_t, 4>& across = offsets[static_cast<std::size_t>((axis + 1) % 3)];
  const std::array<std::size_t, 4>& beside = offsets[static_cast<std::size_t>((axis + 2) % 3)];
  const auto load = [&](std::size_t sample) {
    return base::LoadLittleEndian<T>(bytes + sample * sizeof(T));
  };
  const T lower_label = load(along[1] + across[1] + beside[1]);
  const T upper_label = load(along[2] + across[1] + beside[1]);
  std::array<int, 4> layers{};  // the weighted difference of both labels in each layer
  for (std::size_t j = 0; j < 3; ++j) {
    for (std::size_t i = 0; i < 3; ++i) {
      const int weight = kLabelWeights[i] * kLabelWeights[j];
      for (std::size_t k = 0; k < 4; ++k) {
        const T label = load(along[k] + across[i] + beside[j]);
        layers[k] += label == lower_label ? weight : label == upper_label ? -weight : 0;
      }
    }
  }
  return FractionOfShares(layers[0] + 2 * layers[1] + layers[2],
                          layers[1] + 2 * layers[2] + layers[3]);
}

}  // namespace

double SmoothFraction(const volume::BlockSamples& samples, const math::IndexBox& stored,
                      const Index3& lower, int axis) {
  return volume::VisitScalarType(samples.type, [&]<typename T>() {
    return SmoothFractionAt<T>(samples.bytes, stored.dims(), lower - stored.begin, axis);
  });
}

void FillSmoothFractions(const volume::BlockSamples& samples, const Index3& dims, int axis,
                         std::span<const std::uint32_t> lower_samples, double* fractions) {
  volume::VisitScalarType(samples.type, [&]<typename T>() {
    for (std::size_t i = 0; i < lower_samples.size(); ++i) {
      const auto sample = static_cast<std::int64_t>(lower_samples[i]);
      fractions[i] = SmoothFractionAt<T>(
          samples.bytes, dims,
          {sample % dims.x, sample / dims.x % dims.y, sample / (dims.x * dims.y)}, axis);
    }
  });
}

}  // namespace isoscope::extract
