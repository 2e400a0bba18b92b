#include "core/synthetic/flow_generator.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/crc32c.h"
#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::HasSubstr;

volume::GridGeometry Grid(const math::Index3& dims) {
  const absl::StatusOr<volume::GridGeometry> grid = FlowGrid(dims);
  EXPECT_THAT(grid.status(), testing::IsOk());
  return *grid;
}

std::vector<float> Values(const FlowInstant& flow, const FlowFieldRow& field,
                          const math::Index3& dims) {
  std::vector<float> values(static_cast<std::size_t>(math::Volume(dims) * field.component_count));
  flow.FillRows(field.field, 0, dims.y * dims.z, std::bit_cast<char*>(values.data()));
  return values;
}

struct Fluid {
  double pressure = 0;
  double temperature = 0;
  math::Vec3d velocity;
};

// The formulas of --help, by libm.
Fluid FluidAt(const math::Vec3d& position, double t) {
  constexpr double kWaveNumber = 4 * std::numbers::pi;
  const auto sin_k = [](double value) { return std::sin(kWaveNumber * value); };
  const auto cos_k = [](double value) { return std::cos(kWaveNumber * value); };
  double x = position.x + 0.08 - 0.03 * t;
  double y = position.y + 0.05 - 0.02 * t;
  double z = position.z + 0.12 - 0.05 * t;
  const double speed = 0.1 * std::exp(-0.4 * t);
  const math::Vec3d v{speed * (sin_k(z) + 0.6 * cos_k(y)), speed * (0.8 * sin_k(x) + cos_k(z)),
                      speed * (0.6 * sin_k(y) + 0.8 * cos_k(x))};
  Fluid fluid;
  fluid.velocity = {0.03 + v.x, 0.02 + v.y, 0.05 + v.z};
  fluid.pressure = -500 * (v.x * v.x + v.y * v.y + v.z * v.z);
  const double s = (1 - std::exp(-0.4 * t)) / 8;
  for (int i = 0; i < 2; ++i) {
    x -= s * (sin_k(z) + 0.6 * cos_k(y));
    y -= s * (0.8 * sin_k(x) + cos_k(z));
    z -= s * (0.6 * sin_k(y) + 0.8 * cos_k(x));
  }
  const auto g = [t](double q, double h) {
    const double b = std::sqrt(h * h + 0.0002 * t);
    return h / b * std::exp(-q * q / (2 * b * b));
  };
  fluid.temperature = 293.15 + 60 * g(x, 0.1) * g(y, 0.1) * g(z, 0.2);
  return fluid;
}

TEST(FlowGridTest, LongestAxisIsOneMetreAroundTheOrigin) {
  const volume::GridGeometry grid = Grid({9, 5, 3});
  EXPECT_EQ(grid.spacing, (math::Vec3d{0.125, 0.125, 0.125}));
  EXPECT_EQ(grid.origin, (math::Vec3d{-0.5, -0.25, -0.125}));
  EXPECT_EQ(grid.direction, math::Mat3d{});
}

TEST(FlowGridTest, DimsThatNoFileHoldsAreRefused) {
  EXPECT_THAT(FlowGrid({1, 4, 4}).status(), StatusIs(absl::StatusCode::kInvalidArgument, _));
  EXPECT_THAT(FlowGrid({1 << 20, 1 << 20, 1 << 20}).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("more than any file holds")));
}

TEST(FlowInstantTest, ValuesAreTheFormulas) {
  const math::Index3 dims{21, 33, 12};
  const volume::GridGeometry grid = Grid(dims);
  for (const double t : {0.0, 0.1, 2.5, 40.0}) {
    const FlowInstant flow(grid, t);
    const std::vector<float> pressure = Values(flow, kFlowFields[0], dims);
    const std::vector<float> temperature = Values(flow, kFlowFields[1], dims);
    const std::vector<float> velocity = Values(flow, kFlowFields[2], dims);
    for (std::int64_t i = 0; i < math::Volume(dims); ++i) {
      const auto at = static_cast<std::size_t>(i);
      const math::Index3 index{i % dims.x, i / dims.x % dims.y, i / dims.x / dims.y};
      math::Vec3d position;
      for (int axis = 0; axis < 3; ++axis) {
        position[axis] = grid.origin[axis] + grid.spacing[axis] * static_cast<double>(index[axis]);
      }
      const Fluid fluid = FluidAt(position, t);
      // Half a unit of float32, and a little for the positions.
      ASSERT_NEAR(pressure[at], fluid.pressure, 1e-12 - 6e-8 * fluid.pressure) << t << " " << i;
      ASSERT_NEAR(temperature[at], fluid.temperature, 1.6e-5) << t << " " << i;
      for (int axis = 0; axis < 3; ++axis) {
        ASSERT_NEAR(velocity[3 * at + static_cast<std::size_t>(axis)], fluid.velocity[axis], 8e-9)
            << t << " " << i;
      }
    }
  }
}

// The formulas solve what they are said to solve: div v = 0 and
// dv/dt + (v . grad) v = -grad p / r + d / k^2 laplace v, by central differences.
TEST(FlowInstantTest, FormulasSolveTheNavierStokesEquations) {
  constexpr double kStep = 1e-4;
  constexpr double kViscosity = 0.4 / (16 * std::numbers::pi * std::numbers::pi);
  constexpr double kTime = 1.5;
  for (const math::Vec3d& p : {math::Vec3d{0, 0, 0}, math::Vec3d{0.1, -0.3, 0.22}}) {
    const auto moved = [&p](int axis, double by) {
      math::Vec3d q = p;
      q[axis] += by;
      return q;
    };
    const math::Vec3d velocity = FluidAt(p, kTime).velocity;
    double divergence = 0;
    for (int axis = 0; axis < 3; ++axis) {
      divergence += (FluidAt(moved(axis, kStep), kTime).velocity[axis] -
                     FluidAt(moved(axis, -kStep), kTime).velocity[axis]) /
                    (2 * kStep);
    }
    EXPECT_NEAR(divergence, 0, 1e-6);
    for (int i = 0; i < 3; ++i) {
      double rest =
          (FluidAt(p, kTime + kStep).velocity[i] - FluidAt(p, kTime - kStep).velocity[i]) /
          (2 * kStep);
      for (int axis = 0; axis < 3; ++axis) {
        const double up = FluidAt(moved(axis, kStep), kTime).velocity[i];
        const double down = FluidAt(moved(axis, -kStep), kTime).velocity[i];
        rest += velocity[axis] * (up - down) / (2 * kStep);
        rest -= kViscosity * (up - 2 * velocity[i] + down) / (kStep * kStep);
      }
      rest +=
          (FluidAt(moved(i, kStep), kTime).pressure - FluidAt(moved(i, -kStep), kTime).pressure) /
          (2 * kStep * 1000);
      EXPECT_NEAR(rest, 0, 1e-5) << "of terms of about 0.1";
    }
  }
}

TEST(FlowInstantTest, BitsAreTheSameOnEveryMachine) {
  const math::Index3 dims{24, 20, 16};
  const volume::GridGeometry grid = Grid(dims);
  std::vector<std::uint32_t> checksums;
  for (const double t : {0.0, 2.5}) {
    const FlowInstant flow(grid, t);
    for (const FlowFieldRow& field : kFlowFields) {
      const std::vector<float> values = Values(flow, field, dims);
      checksums.push_back(base::Crc32c(absl::string_view(std::bit_cast<const char*>(values.data()),
                                                         values.size() * sizeof(float))));
    }
  }
  EXPECT_THAT(checksums, ::testing::ElementsAre(2222445785, 2787665073, 2515197992, 1763186417,
                                                3517644388, 1806741494));
}

TEST(FlowInstantTest, RowsDoNotDependOnTheOthersOfACall) {
  const math::Index3 dims{17, 6, 5};
  const FlowInstant flow(Grid(dims), 1);
  for (const FlowFieldRow& field : kFlowFields) {
    const std::vector<float> values = Values(flow, field, dims);
    const auto row_values = static_cast<std::size_t>(dims.x * field.component_count);
    for (std::int64_t row = 0; row < dims.y * dims.z; ++row) {
      std::vector<float> alone(row_values);
      flow.FillRows(field.field, row, row + 1, std::bit_cast<char*>(alone.data()));
      EXPECT_TRUE(std::equal(alone.begin(), alone.end(),
                             values.begin() + row * static_cast<std::int64_t>(row_values)))
          << field.name << row;
    }
  }
}

TEST(FlowInstantTest, FlowComesToRestAtAnyTime) {
  const math::Index3 dims{5, 4, 3};
  const FlowInstant flow(Grid(dims), kMaxFlowTime);
  EXPECT_THAT(Values(flow, kFlowFields[0], dims), ::testing::Each(0));
  EXPECT_THAT(Values(flow, kFlowFields[1], dims), ::testing::Each(293.15F));
  const std::vector<float> velocity = Values(flow, kFlowFields[2], dims);
  for (std::size_t i = 0; i < velocity.size(); i += 3) {
    EXPECT_EQ(velocity[i], 0.03F);
    EXPECT_EQ(velocity[i + 1], 0.02F);
    EXPECT_EQ(velocity[i + 2], 0.05F);
  }
}

}  // namespace
}  // namespace isoscope::source
