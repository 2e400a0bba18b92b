// A simulated flow with three fields, row by row: the series of `isoscope generate flow`.
//
// Positions (x, y, z) in m, times t in s. The longest axis spans 1 m; the middle of the grid is the
// origin. A decaying ABC vortex (Arnold, Beltrami, Childress) and a warm cloud are carried along:
//
//   (X, Y, Z)   = (x, y, z) - c - w t                     c = (-0.08, -0.05, -0.12) m
//                                                         w = (0.03, 0.02, 0.05) m/s
//   e(t)        = exp(-d t)                               d = 0.4 /s, k = 4 pi /m
//   v           = u e(t) (A sin kZ + C cos kY,            u = 0.1 m/s
//                         B sin kX + A cos kZ,            (A, B, C) = (1, 0.8, 0.6)
//                         C sin kY + B cos kX)
//
//   velocity    = w + v                                   in m/s
//   pressure    = -(r / 2) |v|^2                          in Pa, relative to the fluid at rest
//                                                         r = 1000 kg/m^3
//   temperature = T + H g(X') g(Y') g(Z')                 in K; T = 293.15 K, H = 60 K
//
// Velocity and pressure solve the Navier-Stokes equations exactly, for the viscosity d / k^2:
// curl v = k v, so that the vortex decays without a change of shape.
//
// (X', Y', Z') is where the fluid came from. With s = u (1 - e(t)) / (2 d), two times:
//
//   X -= s (A sin kZ + C cos kY),  Y -= s (B sin kX + A cos kZ),  Z -= s (C sin kY + B cos kX)
//
// each with the new values of those before. These are two steps of a split transport along v. A
// step shears and keeps volumes, so that no heat is lost. The cloud is a Gaussian that diffuses
// with D = 1e-4 m^2/s:
//
//   g(q) = (h / b) exp(-q^2 / (2 b^2)),  b^2 = h^2 + 2 D t,  h = 0.1, 0.1, 0.2 m in x, y, z
//
// Sources: Dombre et al. 1986, "Chaotic streamlines in the ABC flows"; Ethier and Steinman 1994,
// "Exact fully 3D Navier-Stokes solutions for benchmarking".

#ifndef ISOSCOPE_CORE_SYNTHETIC_FLOW_GENERATOR_H_
#define ISOSCOPE_CORE_SYNTHETIC_FLOW_GENERATOR_H_

#include <array>
#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"

#include "core/math/vec.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {

enum class FlowField { kPressure, kTemperature, kVelocity };

// Samples are float32; those of several components are interleaved.
struct FlowFieldRow {
  FlowField field;
  const char* name;
  const char* unit;
  int component_count;
};
inline constexpr std::array<FlowFieldRow, 3> kFlowFields{{
    {FlowField::kPressure, "pressure", "Pa", 1},
    {FlowField::kTemperature, "temperature", "K", 1},
    {FlowField::kVelocity, "velocity", "m/s", 3},
}};
inline constexpr double kMaxFlowTime = 1e6;  // s

// The grid of a flow, in m. INVALID_ARGUMENT: dims that no grid has, or more samples than a file
// holds.
absl::StatusOr<volume::GridGeometry> FlowGrid(const math::Index3& dims);

// The flow at one time. The same bits on every machine: core/math/elementary.h, and sequences of
// IEEE operations. Immutable, thread-safe. Memory: 24 bytes for each sample of the three axes' sum.
class FlowInstant {
 public:
  // REQUIRES: `grid` is of FlowGrid; 0 <= time <= kMaxFlowTime, in s.
  FlowInstant(const volume::GridGeometry& grid, double time);

  // Writes rows [begin, end) of a field, row = z * dims.y + y, x fastest, little-endian, to `out`.
  // REQUIRES: 0 <= begin <= end <= dims.y * dims.z. About 40 ns a sample of temperature.
  void FillRows(FlowField field, std::int64_t begin, std::int64_t end, char* out) const;

 private:
  // Values along one axis, by sample.
  struct Axis {
    std::vector<double> position;  // in the moving frame
    std::vector<double> sine;      // of k * position
    std::vector<double> cosine;
  };
  struct RowStart {
    std::size_t y = 0;
    std::size_t z = 0;
  };

  // Each fills one row of dims.x samples.
  void FillPressure(const RowStart& row, float* values) const;
  void FillTemperature(const RowStart& row, float* values) const;
  void FillVelocity(const RowStart& row, float* values) const;

  const math::Index3 dims_;
  std::array<Axis, 3> axes_;
  double speed_ = 0;       // u e(t)
  double shear_ = 0;       // s
  double warmest_ = 0;     // H and the factors h / b
  math::Vec3d sharpness_;  // 1 / (2 b^2)
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SYNTHETIC_FLOW_GENERATOR_H_
