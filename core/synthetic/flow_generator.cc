#include "core/synthetic/flow_generator.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>
#include <numbers>

#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/math/elementary.h"

namespace isoscope::source {
namespace {

// Names and values as in the head of flow_generator.h.
constexpr math::Vec3d kStart{-0.08, -0.05, -0.12};  // c
constexpr math::Vec3d kWind{0.03, 0.02, 0.05};      // w
constexpr math::Vec3d kCloudWidth{0.1, 0.1, 0.2};   // h
constexpr double kDecay = 0.4;                      // d
constexpr double kSpeed = 0.1;                      // u
constexpr double kA = 1;
constexpr double kB = 0.8;
constexpr double kC = 0.6;
constexpr double kTurnsPerMetre = 2;  // k / (2 pi)
constexpr double kHalfDensity = 500;
constexpr double kRestTemperature = 293.15;
constexpr double kCloudTemperature = 60;
constexpr double kDiffusivity = 1e-4;  // D
constexpr int kTransportSteps = 2;

// Added and taken away again, it leaves the nearest whole number, of values below 2^51; before that
// the last bits of the sum are that number.
constexpr double kShift = 0x1.8p52;

// Samples side by side: loops over all of them are vectorised.
constexpr std::size_t kLanes = 64;
using Lanes = std::array<double, kLanes>;
struct SinesAndCosines {
  Lanes sine;
  Lanes cosine;
};

// sin(2 pi turns), by the Taylor series. REQUIRES: |turns| <= 1/4.
inline double SineOfQuarterTurn(double turns) {
  const double x = turns * (2 * std::numbers::pi);
  const double s = x * x;
  return x * (1 + s * (-1.0 / 6 +
                       s * (1.0 / 120 +
                            s * (-1.0 / 5040 +
                                 s * (1.0 / 362880 +
                                      s * (-1.0 / 39916800 + s * (1.0 / 6227020800 +
                                                                  s * (-1.0 / 1307674368000))))))));
}

// Returns what the turns of a position leave beyond whole ones, in [-1/2, 1/2]. REQUIRES: they are
// below 2^51.
inline double TurnsOf(double position) {
  const double turns = kTurnsPerMetre * position;
  return turns - ((turns + kShift) - kShift);
}

// One shear of the transport: positions -= shear * (a * a_factor + b * b_factor), and the sines and
// cosines of the new positions, at most 1e-11 off. math::Sin would take 2 us for each of them.
void ShearLanes(double shear, double a, const Lanes& a_factor, double b, const Lanes& b_factor,
                Lanes* __restrict positions, SinesAndCosines* __restrict result) {
  for (std::size_t i = 0; i < kLanes; ++i) {
    (*positions)[i] -= shear * (a * a_factor[i] + b * b_factor[i]);
    const double turns = TurnsOf((*positions)[i]);
    const double size = std::abs(turns);
    const double folded = 0.25 - std::abs(size - 0.25);
    result->sine[i] = std::copysign(SineOfQuarterTurn(folded), turns);
    result->cosine[i] = SineOfQuarterTurn(0.25 - size);
  }
}

// exp(-x), at most 1e-12 off, relative to it. REQUIRES: x >= 0; from 693 on x counts as 693.
inline double ExpOfMinus(double x) {
  constexpr double kMaxPower = 1000;  // of two
  const double power = std::min(x * std::numbers::log2e, kMaxPower);
  const double shifted = power + kShift;
  const double r = ((shifted - kShift) - power) * std::numbers::ln2;
  const double value =
      1 +
      r * (1 + r * (1.0 / 2 +
                    r * (1.0 / 6 +
                         r * (1.0 / 24 +
                              r * (1.0 / 120 +
                                   r * (1.0 / 720 +
                                        r * (1.0 / 5040 +
                                             r * (1.0 / 40320 +
                                                  r * (1.0 / 362880 + r * (1.0 / 3628800))))))))));
  // 2^-n, n being the last bits of `shifted`: what lies above them leaves with the shift.
  return value * std::bit_cast<double>((1023 - std::bit_cast<std::uint64_t>(shifted)) << 52);
}

// e(t) and the like. Pow of a constant, as math has no Exp.
double Exp(double x) { return math::Pow(std::numbers::e, x); }

// Returns the position of sample i: a ratio of whole numbers, so that the grid's middle is 0.
double Position(const math::Index3& dims, int axis, std::int64_t i) {
  const std::int64_t longest = std::max({dims.x, dims.y, dims.z});
  return static_cast<double>(2 * i - (dims[axis] - 1)) / static_cast<double>(2 * (longest - 1));
}

}  // namespace

absl::StatusOr<volume::GridGeometry> FlowGrid(const math::Index3& dims) {
  volume::GridGeometry grid;
  grid.sample_dims = dims;
  ISOSCOPE_RETURN_IF_ERROR(volume::Validate(grid));
  if (math::Volume(dims) > std::numeric_limits<std::int64_t>::max() / 64) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%d x %d x %d samples: more than any file holds", dims.x, dims.y, dims.z));
  }
  const double spacing = 1.0 / static_cast<double>(std::max({dims.x, dims.y, dims.z}) - 1);
  grid.spacing = {spacing, spacing, spacing};
  grid.origin = {Position(dims, 0, 0), Position(dims, 1, 0), Position(dims, 2, 0)};
  ISOSCOPE_RETURN_IF_ERROR(volume::Validate(grid));
  return grid;
}

FlowInstant::FlowInstant(const volume::GridGeometry& grid, double time)
    : dims_(grid.sample_dims), warmest_(kCloudTemperature) {
  ISOSCOPE_CHECK(0 <= time && time <= kMaxFlowTime);
  const double decay = Exp(-kDecay * time);
  speed_ = kSpeed * decay;
  shear_ = kSpeed * (1 - decay) / (kDecay * kTransportSteps);
  for (int axis = 0; axis < 3; ++axis) {
    const double square = kCloudWidth[axis] * kCloudWidth[axis] + 2 * kDiffusivity * time;
    sharpness_[axis] = 1 / (2 * square);
    warmest_ *= kCloudWidth[axis] / std::sqrt(square);
    Axis& samples = axes_[static_cast<std::size_t>(axis)];
    for (std::int64_t i = 0; i < dims_[axis]; ++i) {
      const double position = Position(dims_, axis, i) - kStart[axis] - kWind[axis] * time;
      const double radians = 2 * std::numbers::pi * kTurnsPerMetre * position;
      samples.position.push_back(position);
      samples.sine.push_back(math::Sin(radians));
      samples.cosine.push_back(math::Cos(radians));
    }
  }
}

void FlowInstant::FillPressure(const RowStart& row, float* values) const {
  const double vx = kA * axes_[2].sine[row.z] + kC * axes_[1].cosine[row.y];
  const double y_part = kA * axes_[2].cosine[row.z];
  const double z_part = kC * axes_[1].sine[row.y];
  const double scale = -kHalfDensity * speed_ * speed_;
  for (std::size_t x = 0; x < axes_[0].sine.size(); ++x) {
    const double vy = kB * axes_[0].sine[x] + y_part;
    const double vz = z_part + kB * axes_[0].cosine[x];
    values[x] = static_cast<float>(scale * (vx * vx + vy * vy + vz * vz));
  }
}

void FlowInstant::FillVelocity(const RowStart& row, float* values) const {
  const double vx = kWind.x + speed_ * (kA * axes_[2].sine[row.z] + kC * axes_[1].cosine[row.y]);
  const double y_part = kA * axes_[2].cosine[row.z];
  const double z_part = kC * axes_[1].sine[row.y];
  for (std::size_t x = 0; x < axes_[0].sine.size(); ++x) {
    values[3 * x] = static_cast<float>(vx);
    values[3 * x + 1] = static_cast<float>(kWind.y + speed_ * (kB * axes_[0].sine[x] + y_part));
    values[3 * x + 2] = static_cast<float>(kWind.z + speed_ * (z_part + kB * axes_[0].cosine[x]));
  }
}

void FlowInstant::FillTemperature(const RowStart& row, float* values) const {
  const std::vector<double>& positions = axes_[0].position;
  for (std::size_t first = 0; first < positions.size(); first += kLanes) {
    const std::size_t count = std::min(kLanes, positions.size() - first);
    // The samples behind the last of a row are computed, too, and dropped.
    Lanes x{};
    Lanes y;
    Lanes z;
    std::copy_n(positions.begin() + static_cast<std::ptrdiff_t>(first), count, x.begin());
    y.fill(axes_[1].position[row.y]);
    z.fill(axes_[2].position[row.z]);
    SinesAndCosines y_wave;
    SinesAndCosines z_wave;
    y_wave.cosine.fill(axes_[1].cosine[row.y]);
    z_wave.sine.fill(axes_[2].sine[row.z]);
    z_wave.cosine.fill(axes_[2].cosine[row.z]);
    for (int step = 0; step < kTransportSteps; ++step) {
      SinesAndCosines x_wave;
      ShearLanes(shear_, kA, z_wave.sine, kC, y_wave.cosine, &x, &x_wave);
      ShearLanes(shear_, kB, x_wave.sine, kA, z_wave.cosine, &y, &y_wave);
      ShearLanes(shear_, kC, y_wave.sine, kB, x_wave.cosine, &z, &z_wave);
    }
    std::array<float, kLanes> temperatures;
    for (std::size_t i = 0; i < kLanes; ++i) {
      const double exponent =
          x[i] * x[i] * sharpness_.x + y[i] * y[i] * sharpness_.y + z[i] * z[i] * sharpness_.z;
      temperatures[i] = static_cast<float>(kRestTemperature + warmest_ * ExpOfMinus(exponent));
    }
    std::copy_n(temperatures.begin(), count, values + first);
  }
}

void FlowInstant::FillRows(FlowField field, std::int64_t begin, std::int64_t end, char* out) const {
  ISOSCOPE_CHECK(0 <= begin && begin <= end && end <= dims_.y * dims_.z);
  const int components = kFlowFields[static_cast<std::size_t>(field)].component_count;
  std::vector<float> values(static_cast<std::size_t>(dims_.x * components));
  for (std::int64_t index = begin; index < end; ++index) {
    const RowStart row{static_cast<std::size_t>(index % dims_.y),
                       static_cast<std::size_t>(index / dims_.y)};
    switch (field) {
      case FlowField::kPressure:
        FillPressure(row, values.data());
        break;
      case FlowField::kTemperature:
        FillTemperature(row, values.data());
        break;
      case FlowField::kVelocity:
        FillVelocity(row, values.data());
        break;
    }
    std::memcpy(out, values.data(), values.size() * sizeof(float));
    out += values.size() * sizeof(float);
  }
}

}  // namespace isoscope::source
