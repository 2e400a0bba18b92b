// A field is a function of x, y, z in [-1, 1], computed a few rows at a time:
//
// - Random and mixing are sums of plane waves. A wave is a product of factors for each axis, so
//   sines and cosines come from tables (Phases).
// - Gyroid gets the sines and cosines along x by rotation, from sample to sample.
// - Shells and marschner-lobb interpolate a table by radius; marschner-lobb adds a function of z.
//
// Then Quantize clamps values to [0, 1] and scales them to the sample type. Labels are whole
// numbers that every type has, and are stored as they are.
//
// Invariant: a sample is computed by the same operations in the same order, however rows are
// grouped, so the bytes do not depend on threads or on calls.

#include "core/synthetic/volume_generator.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <type_traits>

#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/random.h"
#include "core/base/status_macros.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {
namespace {

constexpr double kPi = std::numbers::pi;
// Rows that share one pass over the waves' tables, and samples of them at a time: the sums stay in
// the first-level cache.
constexpr std::int64_t kRowsAtOnce = 4;
constexpr std::int64_t kSamplesAtOnce = 256;
// Steps of the table of radial fields, up to the corner of the cube at sqrt(3).
constexpr int kRadialSteps = 1 << 16;
constexpr float kMaxRadius = 1.7320510F;
// The smallest wave number of random fields, in half-periods over the longest axis.
constexpr double kMinWaveNumber = 2;
// The scale of a random sum of unit variance: 3.5 standard deviations on each side.
constexpr float kRandomScale = 1.0F / 7;
// Half the height over which the two fluids of the mixing layer change into each other.
constexpr float kInterface = 0.06F;

// sums[x] += a * cosine[x] - b * sine[x], for kRowsAtOnce rows. The same operations in the same
// order for every sample, vectorised or not.
void AddWave(const float* __restrict cosine, const float* __restrict sine, std::int64_t count,
             const std::array<float, kRowsAtOnce>& a, const std::array<float, kRowsAtOnce>& b,
             float* __restrict sums) {
  for (std::int64_t x = 0; x < count; ++x) {
    const float c = cosine[x];
    const float s = sine[x];
    sums[x] += a[0] * c - b[0] * s;
    sums[x + kSamplesAtOnce] += a[1] * c - b[1] * s;
    sums[x + 2 * kSamplesAtOnce] += a[2] * c - b[2] * s;
    sums[x + 3 * kSamplesAtOnce] += a[3] * c - b[3] * s;
  }
}

// values[i], in [0, 1] or clamped to it, scaled to T.
template <typename T>
void Quantize(const float* __restrict values, std::int64_t count, char* __restrict out) {
  constexpr std::int64_t kChunk = 256;
  std::array<T, kChunk> samples;
  for (std::int64_t first = 0; first < count; first += kChunk) {
    const std::int64_t n = std::min(kChunk, count - first);
    for (std::int64_t i = 0; i < n; ++i) {
      float value = values[first + i];
      value = value > 0.0F ? value : 0.0F;
      value = value < 1.0F ? value : 1.0F;
      auto& sample = samples[static_cast<std::size_t>(i)];
      if constexpr (std::is_floating_point_v<T>) {
        sample = static_cast<T>(value);
      } else if constexpr (sizeof(T) < 4) {
        constexpr auto kLowest = static_cast<float>(std::numeric_limits<T>::lowest());
        constexpr auto kRange = static_cast<float>(std::numeric_limits<T>::max()) - kLowest;
        const float shifted = value * kRange + 0.5F;
        sample = static_cast<T>(static_cast<int>(shifted) + static_cast<int>(kLowest));
      } else {
        constexpr auto kLowest = static_cast<double>(std::numeric_limits<T>::lowest());
        constexpr double kRange = static_cast<double>(std::numeric_limits<T>::max()) - kLowest;
        const double shifted = static_cast<double>(value) * kRange + 0.5;
        sample =
            static_cast<T>(static_cast<std::int64_t>(shifted) + static_cast<std::int64_t>(kLowest));
      }
    }
    std::copy_n(reinterpret_cast<const char*>(samples.data()),
                static_cast<std::size_t>(n) * sizeof(T),
                out + static_cast<std::size_t>(first) * sizeof(T));
  }
}

template <typename T>
void Store(const float* values, std::int64_t count, char* out) {
  std::vector<T> samples(values, values + count);
  std::copy_n(reinterpret_cast<const char*>(samples.data()), samples.size() * sizeof(T), out);
}

absl::Status Validate(const GeneratorParameters& p) {
  const auto positive = [](double value) { return std::isfinite(value) && value > 0; };
  if (p.wave_count < 1 || p.wave_count > GeneratorParameters::kMaxWaves) {
    return absl::InvalidArgumentError(absl::StrFormat("%d waves: expected 1 to %d", p.wave_count,
                                                      GeneratorParameters::kMaxWaves));
  }
  if (!(std::isfinite(p.max_wave_number) && p.max_wave_number >= kMinWaveNumber)) {
    return absl::InvalidArgumentError(absl::StrFormat("largest wave number %g: expected %g or more",
                                                      p.max_wave_number, kMinWaveNumber));
  }
  if (!std::isfinite(p.spectrum_exponent) || std::abs(p.spectrum_exponent) > 20) {
    return absl::InvalidArgumentError(
        absl::StrFormat("spectrum exponent %g: expected -20 to 20", p.spectrum_exponent));
  }
  if (!positive(p.periods) || !positive(p.frequency) || !positive(p.alpha) ||
      !positive(p.thickness) || p.shell_count < 1) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "periods %g, frequency %g, alpha %g, thickness %g, %d shells: expected numbers above 0",
        p.periods, p.frequency, p.alpha, p.thickness, p.shell_count));
  }
  if (p.region_count < 2 || p.region_count > GeneratedRegions::kMaxRegions) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%d regions: expected 2 to %d", p.region_count, GeneratedRegions::kMaxRegions));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeGenerator>> VolumeGenerator::Make(
    const GeneratorParameters& parameters, const math::Index3& dims, volume::ScalarType type) {
  ISOSCOPE_RETURN_IF_ERROR(Validate(parameters));
  volume::GridGeometry geometry;
  geometry.sample_dims = dims;
  ISOSCOPE_RETURN_IF_ERROR(volume::Validate(geometry));
  if (math::Volume(dims) > std::numeric_limits<std::int64_t>::max() / 16) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%d x %d x %d samples: more than any file holds", dims.x, dims.y, dims.z));
  }
  auto generator = std::unique_ptr<VolumeGenerator>(new VolumeGenerator(parameters, dims, type));
  switch (parameters.field) {
    case GeneratedField::kRandom:
    case GeneratedField::kMixing:
      generator->MakeWaves();
      break;
    case GeneratedField::kMarschnerLobb:
    case GeneratedField::kShells:
      generator->MakeRadialTable();
      break;
    case GeneratedField::kLabels:
      generator->regions_.emplace(parameters.seed, parameters.region_count);
      break;
    case GeneratedField::kGyroid:
      break;
  }
  return generator;
}

VolumeGenerator::VolumeGenerator(const GeneratorParameters& parameters, const math::Index3& dims,
                                 volume::ScalarType type)
    : parameters_(parameters), dims_(dims), type_(type) {}

std::vector<volume::Label> VolumeGenerator::labels() const {
  return regions_ ? regions_->Labels() : std::vector<volume::Label>();
}

double VolumeGenerator::Coordinate(int axis, std::int64_t i) const {
  const std::int64_t longest = std::max({dims_.x, dims_.y, dims_.z});
  return static_cast<double>(2 * i - (dims_[axis] - 1)) / static_cast<double>(longest - 1);
}

void VolumeGenerator::MakeWaves() {
  const auto wave_count = static_cast<std::size_t>(parameters_.wave_count);
  struct Wave {
    math::Vec3d vector;
    double phase = 0;
    double amplitude = 0;
  };
  std::vector<Wave> waves(wave_count);
  double square_sum = 0;
  std::uint64_t counter = 0;
  for (std::size_t i = 0; i < wave_count; ++i, counter += 4) {
    const auto random = [&](std::uint64_t n) {
      return base::RandomUnit(parameters_.seed, counter + n);
    };
    const double cos_polar = 2 * random(0) - 1;
    const double sin_polar = std::sqrt(1 - cos_polar * cos_polar);
    const double azimuth = 2 * kPi * random(1);
    // Stratified: every part of the spectrum has its waves, for every seed.
    const double part = (static_cast<double>(i) + random(2)) / static_cast<double>(wave_count);
    const double wave_number =
        kMinWaveNumber * std::pow(parameters_.max_wave_number / kMinWaveNumber, part);
    const double k = kPi * wave_number;
    Wave& wave = waves[i];
    wave.vector = {k * sin_polar * std::cos(azimuth), k * sin_polar * std::sin(azimuth),
                   k * cos_polar};
    wave.phase = 2 * kPi * random(3);
    // Waves are as dense as 1 / k, so E(k) ~ amplitude^2 / k.
    wave.amplitude = std::pow(wave_number, (1 - parameters_.spectrum_exponent) / 2);
    square_sum += wave.amplitude * wave.amplitude / 2;
  }
  Phases* const along[3] = {&along_x_, &along_y_, &along_z_};
  for (int axis = 0; axis < 3; ++axis) {
    const auto samples = static_cast<std::size_t>(dims_[axis]);
    along[axis]->cosine.resize(wave_count * samples);
    along[axis]->sine.resize(wave_count * samples);
    for (std::size_t w = 0; w < wave_count; ++w) {
      const double amplitude = axis == 1 ? waves[w].amplitude / std::sqrt(square_sum) : 1;
      const double phase = axis == 2 ? waves[w].phase : 0;
      for (std::size_t i = 0; i < samples; ++i) {
        const double angle =
            waves[w].vector[axis] * Coordinate(axis, static_cast<std::int64_t>(i)) + phase;
        along[axis]->cosine[w * samples + i] = static_cast<float>(amplitude * std::cos(angle));
        along[axis]->sine[w * samples + i] = static_cast<float>(amplitude * std::sin(angle));
      }
    }
  }
}

void VolumeGenerator::MakeRadialTable() {
  radial_.resize(kRadialSteps + 2);
  for (std::size_t i = 0; i < radial_.size(); ++i) {
    const double r = static_cast<double>(i) * static_cast<double>(kMaxRadius) / kRadialSteps;
    if (parameters_.field == GeneratedField::kShells) {
      radial_[i] =
          r >= 1 ? 0.0F
                 : static_cast<float>(0.5 - 0.5 * std::cos(2 * kPi * parameters_.shell_count * r));
    } else {
      const double rho = std::cos(2 * kPi * parameters_.frequency * std::cos(kPi * r / 2));
      radial_[i] =
          static_cast<float>(parameters_.alpha * (1 + rho) / (2 * (1 + parameters_.alpha)));
    }
  }
}

float VolumeGenerator::AtRadius(float radius) const {
  const float position = std::min(radius, kMaxRadius) * (kRadialSteps / kMaxRadius);
  const auto i = std::min(static_cast<std::size_t>(position), std::size_t{kRadialSteps});
  const float rest = position - static_cast<float>(i);
  return radial_[i] + rest * (radial_[i + 1] - radial_[i]);
}

void VolumeGenerator::FillWaves(std::int64_t row, std::int64_t count, float* values) const {
  const auto wave_count = static_cast<std::size_t>(parameters_.wave_count);
  const auto dims_x = static_cast<std::size_t>(dims_.x);
  // cos(x + y + z) = cos(y + z) cos x - sin(y + z) sin x: the factors of the rows.
  std::vector<std::array<float, kRowsAtOnce>> a(wave_count);
  std::vector<std::array<float, kRowsAtOnce>> b(wave_count);
  for (std::int64_t r = 0; r < count; ++r) {
    const auto y = static_cast<std::size_t>((row + r) % dims_.y);
    const auto z = static_cast<std::size_t>((row + r) / dims_.y);
    for (std::size_t w = 0; w < wave_count; ++w) {
      const std::size_t at_y = w * static_cast<std::size_t>(dims_.y) + y;
      const std::size_t at_z = w * static_cast<std::size_t>(dims_.z) + z;
      const auto lane = static_cast<std::size_t>(r);
      a[w][lane] =
          along_y_.cosine[at_y] * along_z_.cosine[at_z] - along_y_.sine[at_y] * along_z_.sine[at_z];
      b[w][lane] =
          along_y_.sine[at_y] * along_z_.cosine[at_z] + along_y_.cosine[at_y] * along_z_.sine[at_z];
    }
  }
  std::array<float, kRowsAtOnce * kSamplesAtOnce> sums;
  for (std::int64_t x = 0; x < dims_.x; x += kSamplesAtOnce) {
    const std::int64_t n = std::min(kSamplesAtOnce, dims_.x - x);
    sums.fill(0);
    for (std::size_t w = 0; w < wave_count; ++w) {
      const std::size_t first = w * dims_x + static_cast<std::size_t>(x);
      AddWave(&along_x_.cosine[first], &along_x_.sine[first], n, a[w], b[w], sums.data());
    }
    for (std::int64_t r = 0; r < count; ++r) {
      std::copy_n(sums.data() + r * kSamplesAtOnce, n, values + r * dims_.x + x);
    }
  }
}

void VolumeGenerator::FillMixing(std::int64_t row, std::int64_t count, float* values) const {
  constexpr double kCalm = 1e-4;
  std::array<double, kRowsAtOnce> stir{};
  const auto stir_of = [&](std::int64_t r) {
    const double z = Coordinate(2, (row + r) / dims_.y) / parameters_.thickness;
    return std::exp(-z * z);
  };
  bool is_calm = true;
  for (std::int64_t r = 0; r < count; ++r) {
    stir[static_cast<std::size_t>(r)] = stir_of(r);
    is_calm = is_calm && stir[static_cast<std::size_t>(r)] < kCalm;
  }
  if (is_calm) {
    std::fill_n(values, count * dims_.x, 0.0F);
  } else {
    FillWaves(row, count, values);
  }
  for (std::int64_t r = 0; r < count; ++r) {
    const double strength = stir[static_cast<std::size_t>(r)];
    const auto height = static_cast<float>(Coordinate(2, (row + r) / dims_.y));
    // A row's values must not depend on the other rows of the call.
    const float scale =
        strength < kCalm ? 0.0F : static_cast<float>(0.5 * parameters_.thickness * strength);
    float* const line = values + r * dims_.x;
    for (std::int64_t x = 0; x < dims_.x; ++x) {
      float t = 0.5F + (height + scale * line[x]) * (0.5F / kInterface);
      t = t > 0.0F ? t : 0.0F;
      t = t < 1.0F ? t : 1.0F;
      line[x] = t * t * (3.0F - 2.0F * t);
    }
  }
}

void VolumeGenerator::FillGyroid(std::int64_t row, float* values) const {
  const double a = kPi * parameters_.periods;
  const double y = a * Coordinate(1, row % dims_.y);
  const double z = a * Coordinate(2, row / dims_.y);
  const double sin_factor = std::cos(y) / 3;
  const double cos_factor = std::sin(z) / 3;
  const double rest = 0.5 + std::sin(y) * std::cos(z) / 3;
  // sin and cos of the row's angles by rotation, made exact again every few samples.
  constexpr std::int64_t kExactEvery = 32;
  const double step = a * (Coordinate(0, 1) - Coordinate(0, 0));
  const double cos_step = std::cos(step);
  const double sin_step = std::sin(step);
  double sin_x = 0;
  double cos_x = 0;
  for (std::int64_t x = 0; x < dims_.x; ++x) {
    if (x % kExactEvery == 0) {
      sin_x = std::sin(a * Coordinate(0, x));
      cos_x = std::cos(a * Coordinate(0, x));
    }
    values[x] = static_cast<float>(rest + sin_factor * sin_x + cos_factor * cos_x);
    const double next_sin = sin_x * cos_step + cos_x * sin_step;
    cos_x = cos_x * cos_step - sin_x * sin_step;
    sin_x = next_sin;
  }
}

void VolumeGenerator::FillRadial(std::int64_t row, float* values) const {
  const bool is_shells = parameters_.field == GeneratedField::kShells;
  const double y = Coordinate(1, row % dims_.y);
  const double z = Coordinate(2, row / dims_.y);
  const auto square = static_cast<float>(is_shells ? y * y + z * z : y * y);
  const float slope =
      is_shells ? 0.0F
                : static_cast<float>((1 - std::sin(kPi * z / 2)) / (2 * (1 + parameters_.alpha)));
  const double scale = Coordinate(0, 1) - Coordinate(0, 0);
  const double first = Coordinate(0, 0);
  for (std::int64_t i = 0; i < dims_.x; ++i) {
    const auto x = static_cast<float>(first + scale * static_cast<double>(i));
    values[i] = slope + AtRadius(std::sqrt(x * x + square));
  }
}

void VolumeGenerator::FillLabels(std::int64_t row, float* values) const {
  const double y = Coordinate(1, row % dims_.y);
  const double z = Coordinate(2, row / dims_.y);
  for (std::int64_t i = 0; i < dims_.x; ++i) {
    values[i] = static_cast<float>(regions_->At({Coordinate(0, i), y, z}));
  }
}

void VolumeGenerator::FillValues(std::int64_t row, std::int64_t count, float* values) const {
  switch (parameters_.field) {
    case GeneratedField::kRandom:
      FillWaves(row, count, values);
      for (std::int64_t i = 0; i < count * dims_.x; ++i) {
        values[i] = 0.5F + values[i] * kRandomScale;
      }
      return;
    case GeneratedField::kMixing:
      return FillMixing(row, count, values);
    case GeneratedField::kGyroid:
      for (std::int64_t r = 0; r < count; ++r) {
        FillGyroid(row + r, values + r * dims_.x);
      }
      return;
    case GeneratedField::kMarschnerLobb:
    case GeneratedField::kShells:
      for (std::int64_t r = 0; r < count; ++r) {
        FillRadial(row + r, values + r * dims_.x);
      }
      return;
    case GeneratedField::kLabels:
      for (std::int64_t r = 0; r < count; ++r) {
        FillLabels(row + r, values + r * dims_.x);
      }
      return;
  }
}

void VolumeGenerator::FillRows(std::int64_t begin, std::int64_t end, char* out) const {
  ISOSCOPE_CHECK(0 <= begin && begin <= end && end <= row_count());
  std::vector<float> values(static_cast<std::size_t>(kRowsAtOnce * dims_.x));
  for (std::int64_t row = begin; row < end; row += kRowsAtOnce) {
    const std::int64_t count = std::min(kRowsAtOnce, end - row);
    FillValues(row, count, values.data());
    const std::int64_t samples = count * dims_.x;
    volume::VisitScalarType(type_, [&]<typename T>() {
      regions_ ? Store<T>(values.data(), samples, out) : Quantize<T>(values.data(), samples, out);
    });
    out += static_cast<std::size_t>(samples) * volume::SizeOf(type_);
  }
}

}  // namespace isoscope::source
