#include "tests/support/synthetic_fields.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <type_traits>
#include <vector>

#include "core/base/coding.h"
#include "core/base/random.h"

namespace isoscope::testing {
namespace {

// `value` as a T; integers are rounded to nearest (halves away from zero) and clamped.
template <typename T>
T ToScalar(double value) {
  if constexpr (std::is_integral_v<T>) {
    constexpr auto kLowest = static_cast<double>(std::numeric_limits<T>::lowest());
    constexpr auto kMax = static_cast<double>(std::numeric_limits<T>::max());
    return static_cast<T>(std::clamp(std::round(value), kLowest, kMax));
  } else {
    return static_cast<T>(value);
  }
}

// Calls value_of(linear sample index, x, y, z) for every sample and stores the results as `type`.
template <typename ValueOf>
std::string MakeSamples(const math::Index3& dims, volume::ScalarType type,
                        const ValueOf& value_of) {
  return volume::VisitScalarType(type, [&]<typename T>() {
    std::string bytes(static_cast<std::size_t>(math::Volume(dims)) * sizeof(T), '\0');
    char* out = bytes.data();
    std::uint64_t linear = 0;
    for (std::int64_t z = 0; z < dims.z; ++z) {
      for (std::int64_t y = 0; y < dims.y; ++y) {
        for (std::int64_t x = 0; x < dims.x; ++x, ++linear, out += sizeof(T)) {
          base::StoreLittleEndian(ToScalar<T>(value_of(linear, math::Index3{x, y, z})), out);
        }
      }
    }
    return bytes;
  });
}

}  // namespace

Field SphereField(double radius) {
  return [radius](const math::Vec3d& p) { return radius - math::Length(p); };
}

Field TorusField(double major_radius, double minor_radius) {
  return [major_radius, minor_radius](const math::Vec3d& p) {
    const double from_circle = std::sqrt(p.x * p.x + p.y * p.y) - major_radius;
    return minor_radius - std::sqrt(from_circle * from_circle + p.z * p.z);
  };
}

Field GyroidField(double periods) {
  const double a = std::numbers::pi * periods;
  return [a](const math::Vec3d& p) {
    return std::sin(a * p.x) * std::cos(a * p.y) + std::sin(a * p.y) * std::cos(a * p.z) +
           std::sin(a * p.z) * std::cos(a * p.x);
  };
}

Field MarschnerLobbField(double frequency, double alpha) {
  constexpr double kPi = std::numbers::pi;
  return [frequency, alpha](const math::Vec3d& p) {
    const double r = std::sqrt(p.x * p.x + p.y * p.y);
    const double rho = std::cos(2 * kPi * frequency * std::cos(kPi * r / 2));
    return (1 - std::sin(kPi * p.z / 2) + alpha * (1 + rho)) / (2 * (1 + alpha));
  };
}

Field RandomField(std::uint64_t seed, int mode_count, double max_wave_number) {
  struct Mode {
    math::Vec3d wave;
    double phase = 0;
    double amplitude = 0;
  };
  std::vector<Mode> modes(static_cast<std::size_t>(mode_count));
  std::uint64_t counter = 0;
  double square_sum = 0;
  for (Mode& mode : modes) {
    const double cos_polar = 2 * base::RandomUnit(seed, counter) - 1;
    const double azimuth = 2 * std::numbers::pi * base::RandomUnit(seed, counter + 1);
    const double wave_number = 1 + (max_wave_number - 1) * base::RandomUnit(seed, counter + 2);
    const double sin_polar = std::sqrt(1 - cos_polar * cos_polar);
    const double k = std::numbers::pi * wave_number;
    mode.wave = {k * sin_polar * std::cos(azimuth), k * sin_polar * std::sin(azimuth),
                 k * cos_polar};
    mode.phase = 2 * std::numbers::pi * base::RandomUnit(seed, counter + 3);
    mode.amplitude = 1 / wave_number;
    square_sum += 0.5 * mode.amplitude * mode.amplitude;
    counter += 4;
  }
  // Unit variance, so that isovalues mean the same for any number of modes.
  for (Mode& mode : modes) {
    mode.amplitude /= std::sqrt(square_sum);
  }
  return [modes = std::move(modes)](const math::Vec3d& p) {
    double sum = 0;
    for (const Mode& mode : modes) {
      sum += mode.amplitude * std::cos(math::Dot(mode.wave, p) + mode.phase);
    }
    return sum;
  };
}

std::string SampleField(const Field& field, const math::Index3& dims, volume::ScalarType type,
                        double scale, double offset) {
  const auto coordinate = [](std::int64_t i, std::int64_t n) {
    return -1 + 2 * static_cast<double>(i) / static_cast<double>(n - 1);
  };
  return MakeSamples(dims, type, [&](std::uint64_t /*linear*/, const math::Index3& i) {
    return offset + scale * field({coordinate(i.x, dims.x), coordinate(i.y, dims.y),
                                   coordinate(i.z, dims.z)});
  });
}

std::string SampleNoise(std::uint64_t seed, const math::Index3& dims, volume::ScalarType type,
                        double max_value) {
  return MakeSamples(dims, type, [&](std::uint64_t linear, const math::Index3& /*index*/) {
    return max_value * base::RandomUnit(seed, linear);
  });
}

}  // namespace isoscope::testing
