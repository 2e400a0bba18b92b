#include "core/extract/cell_inside.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "gtest/gtest.h"

#include "core/base/random.h"
#include "core/extract/case_table.h"
#include "core/math/box.h"
#include "core/volume/block_samples.h"

namespace isoscope::extract {
namespace {

using math::Vec3d;
using Corners = std::array<double, 8>;

// Random samples of a case, isovalue 0.
Corners SamplesOf(unsigned cell_case, std::uint64_t seed) {
  Corners samples;
  for (std::size_t c = 0; c < 8; ++c) {
    const double value = 0.05 + base::RandomUnit(seed, c);
    samples[c] = (cell_case >> c & 1) != 0 ? value : -value;
  }
  return samples;
}

Vec3d RandomPoint(std::uint64_t seed) {
  return {base::RandomUnit(seed, 100), base::RandomUnit(seed, 101), base::RandomUnit(seed, 102)};
}

// The number of triangles that a segment passes, by another method: Cramer's rule.
int CrossingCount(const Corners& samples, const Vec3d& from, const Vec3d& to) {
  unsigned cell_case = 0;
  for (std::size_t c = 0; c < 8; ++c) {
    cell_case |= samples[c] >= 0 ? 1U << c : 0U;
  }
  const CaseTable& table = GetCaseTable();
  int count = 0;
  for (std::size_t t = 0; t < table.triangle_counts[cell_case]; ++t) {
    std::array<Vec3d, 3> v;
    for (std::size_t i = 0; i < 3; ++i) {
      const int edge = table.edges[cell_case][3 * t + i];
      const auto [lower, upper] = CornersOfEdge(edge);
      const double a = samples[static_cast<std::size_t>(lower)];
      const double b = samples[static_cast<std::size_t>(upper)];
      v[i] = {static_cast<double>(lower & 1), static_cast<double>(lower >> 1 & 1),
              static_cast<double>(lower >> 2)};
      v[i][edge / 4] = static_cast<double>(static_cast<float>(-a / (b - a)));
    }
    const Vec3d u = v[1] - v[0];
    const Vec3d w = v[2] - v[0];
    const Vec3d d = from - to;
    const double determinant = math::Dot(u, math::Cross(w, d));
    const Vec3d r = from - v[0];
    const double s = math::Dot(r, math::Cross(w, d)) / determinant;
    const double q = math::Dot(u, math::Cross(r, d)) / determinant;
    const double along = math::Dot(u, math::Cross(w, r)) / determinant;
    count += s >= 0 && q >= 0 && s + q <= 1 && along >= 0 && along <= 1 ? 1 : 0;
  }
  return count;
}

TEST(IsInsideCellTest, CornersAreWhatTheirSamplesAreInEveryCase) {
  for (unsigned cell_case = 0; cell_case < 256; ++cell_case) {
    for (std::uint64_t seed = 0; seed < 20; ++seed) {
      const Corners samples = SamplesOf(cell_case, 1000 * cell_case + seed);
      for (int c = 0; c < 8; ++c) {
        const Vec3d corner{static_cast<double>(c & 1), static_cast<double>(c >> 1 & 1),
                           static_cast<double>(c >> 2)};
        EXPECT_EQ(IsInsideCell(samples, {0, 0, 0}, corner, 0), (cell_case >> c & 1) != 0)
            << cell_case << ", corner " << c;
        // The nearest vertex is 0.04 away.
        const Vec3d near = corner + (Vec3d{0.5, 0.5, 0.5} - corner) * 0.01;
        EXPECT_EQ(IsInsideCell(samples, {0, 0, 0}, near, 0), (cell_case >> c & 1) != 0)
            << cell_case << ", corner " << c;
      }
    }
  }
}

TEST(IsInsideCellTest, TheSideChangesWhereATriangleIsPassedInEveryCase) {
  int changes = 0;
  for (unsigned cell_case = 1; cell_case < 255; ++cell_case) {
    for (std::uint64_t k = 0; k < 200; ++k) {
      const std::uint64_t seed = 1000 * cell_case + k;
      const Corners samples = SamplesOf(cell_case, seed);
      const Vec3d from = RandomPoint(seed);
      const Vec3d to = RandomPoint(seed + 500'000);
      const bool differs =
          IsInsideCell(samples, {0, 0, 0}, from, 0) != IsInsideCell(samples, {0, 0, 0}, to, 0);
      EXPECT_EQ(differs, CrossingCount(samples, from, to) % 2 == 1) << cell_case << ", " << k;
      changes += differs ? 1 : 0;
    }
  }
  EXPECT_GT(changes, 10'000);
}

// A cut along grid planes has only such points.
TEST(IsInsideCellTest, BothCellsOfAFaceAgreeOnItsPoints) {
  for (std::uint64_t seed = 0; seed < 20'000; ++seed) {
    const Corners lower = SamplesOf(static_cast<unsigned>(256 * base::RandomUnit(seed, 77)), seed);
    Corners upper = SamplesOf(static_cast<unsigned>(256 * base::RandomUnit(seed, 78)), seed + 1);
    for (std::size_t c = 0; c < 4; ++c) {
      upper[c] = lower[c + 4];
    }
    Vec3d p = RandomPoint(seed);
    p.z = 1;
    EXPECT_EQ(IsInsideCell(lower, {0, 0, 0}, p, 0), IsInsideCell(upper, {0, 0, 1}, p, 0)) << seed;
  }
}

TEST(IsInsideCellTest, APlaneFieldIsItsHalfSpaceFarFromTheOrigin) {
  const math::Index3 cell{900, 20, 511};
  Corners samples;
  for (std::size_t c = 0; c < 8; ++c) {
    samples[c] = static_cast<double>(c & 1) + 0.5 * static_cast<double>(c >> 1 & 1) -
                 0.25 * static_cast<double>(c >> 2);
  }
  for (std::uint64_t seed = 0; seed < 5000; ++seed) {
    const Vec3d p = RandomPoint(seed);
    const double value = p.x + 0.5 * p.y - 0.25 * p.z;
    if (std::abs(value - 0.6) > 2e-4) {  // vertices are rounded to float32
      EXPECT_EQ(IsInsideCell(samples, cell, p + Vec3d{900, 20, 511}, 0.6), value > 0.6) << seed;
    }
  }
}

TEST(IsInsideCellTest, TiesInfinitiesAndNan) {
  constexpr double kInf = std::numeric_limits<double>::infinity();
  const Vec3d middle{0.5, 0.5, 0.5};
  // All samples are the isovalue: inside. One of them outside takes a corner only.
  Corners samples;
  samples.fill(7);
  EXPECT_TRUE(IsInsideCell(samples, {0, 0, 0}, middle, 7));
  samples[0] = 6;
  EXPECT_TRUE(IsInsideCell(samples, {0, 0, 0}, middle, 7));
  EXPECT_FALSE(IsInsideCell(samples, {0, 0, 0}, {0.1, 0.1, 0.1}, 7));
  // The vertices lie where the finite samples are.
  samples.fill(kInf);
  samples[0] = 0;
  EXPECT_TRUE(IsInsideCell(samples, {0, 0, 0}, {0.1, 0.1, 0.1}, 7));
  samples.fill(-kInf);
  samples[7] = 9;
  EXPECT_FALSE(IsInsideCell(samples, {0, 0, 0}, {0.9, 0.9, 0.9}, 7));
  samples[7] = kInf;
  EXPECT_TRUE(IsInsideCell(samples, {0, 0, 0}, {0.9, 0.9, 0.9}, 7));
  EXPECT_FALSE(IsInsideCell(samples, {0, 0, 0}, {0.7, 0.7, 0.7}, 7));
  samples.fill(9);
  samples[3] = std::nan("");
  EXPECT_FALSE(IsInsideCell(samples, {0, 0, 0}, middle, 7));
}

// Samples of two labels: 4 where the case has its bit set, else 9.
Corners LabelsOf(unsigned cell_case) {
  Corners samples;
  for (std::size_t c = 0; c < 8; ++c) {
    samples[c] = (cell_case >> c & 1) != 0 ? 4 : 9;
  }
  return samples;
}

TEST(IsInsideCellTest, CornersHaveTheirLabelsInEveryCase) {
  const volume::InsideRule rule = volume::InsideRule::OfLabels({4});
  for (unsigned cell_case = 0; cell_case < 256; ++cell_case) {
    for (int c = 0; c < 8; ++c) {
      const Vec3d corner{5.0 + (c & 1), 6.0 + (c >> 1 & 1), 7.0 + (c >> 2)};
      const Vec3d near = corner + (Vec3d{5.5, 6.5, 7.5} - corner) * 0.3;
      for (const Vec3d& p : {corner, near}) {
        EXPECT_EQ(IsInsideCell(LabelsOf(cell_case), {5, 6, 7}, p, rule), (cell_case >> c & 1) != 0)
            << cell_case << ", corner " << c;
      }
    }
  }
}

TEST(IsInsideCellTest, ExactlyOneOfTwoLabelsHasEachPointInEveryCase) {
  const volume::InsideRule low = volume::InsideRule::OfLabels({4});
  const volume::InsideRule high = volume::InsideRule::OfLabels({9});
  for (unsigned cell_case = 0; cell_case < 256; ++cell_case) {
    const Corners samples = LabelsOf(cell_case);
    for (std::uint64_t k = 0; k < 200; ++k) {
      const Vec3d p = RandomPoint(1000 * cell_case + k);
      EXPECT_NE(IsInsideCell(samples, {0, 0, 0}, p, low), IsInsideCell(samples, {0, 0, 0}, p, high))
          << cell_case << ", " << k;
    }
  }
}

TEST(IsInsideCellTest, BothCellsOfAFaceAgreeOnItsPointsWithLabels) {
  const volume::InsideRule rule = volume::InsideRule::OfLabels({0, 2});
  for (std::uint64_t seed = 0; seed < 20'000; ++seed) {
    Corners lower;
    Corners upper;
    for (std::size_t c = 0; c < 8; ++c) {
      lower[c] = std::floor(4 * base::RandomUnit(seed, c));
      upper[c] = c < 4 ? std::floor(4 * base::RandomUnit(seed, c + 4))
                       : std::floor(4 * base::RandomUnit(seed, c + 8));
    }
    Vec3d p = RandomPoint(seed);
    p.z = 1;
    EXPECT_EQ(IsInsideCell(lower, {0, 0, 0}, p, rule), IsInsideCell(upper, {0, 0, 1}, p, rule))
        << seed;
  }
}

TEST(IsInsideCellTest, ARuleOfAnIsovalueIsTheIsovalue) {
  for (std::uint64_t seed = 0; seed < 2000; ++seed) {
    const Corners samples =
        SamplesOf(static_cast<unsigned>(256 * base::RandomUnit(seed, 77)), seed);
    const Vec3d p = RandomPoint(seed);
    EXPECT_EQ(IsInsideCell(samples, {0, 0, 0}, p, volume::InsideRule::OfIsovalue(0)),
              IsInsideCell(samples, {0, 0, 0}, p, 0));
  }
}

TEST(IsInsideCellTest, NanIsInsideOfNoLabel) {
  Corners samples = LabelsOf(255);
  EXPECT_TRUE(IsInsideCell(samples, {0, 0, 0}, {0.5, 0.5, 0.5}, volume::InsideRule::OfLabels({4})));
  samples[3] = std::nan("");
  EXPECT_FALSE(
      IsInsideCell(samples, {0, 0, 0}, {0.5, 0.5, 0.5}, volume::InsideRule::OfLabels({4})));
}

// A block of 4 x 4 x 4 samples whose own cell is the one in the middle.
struct SmoothCell {
  std::array<std::uint8_t, 64> labels{};
  math::IndexBox stored{{10, 20, 30}, {14, 24, 34}};

  [[nodiscard]] bool IsInside(const Vec3d& in_cell, const volume::InsideRule& rule) const {
    return IsInsideSmoothCell(
        {0, volume::ScalarType::kUint8, reinterpret_cast<const char*>(labels.data())}, stored,
        {11, 21, 31}, Vec3d{11, 21, 31} + in_cell, rule);
  }
};

TEST(IsInsideSmoothCellTest, AStepIsASlope) {
  // Label 1 up to z = 1; up to z = 2 in the last column of x: t = 5/7 on the edges before it.
  SmoothCell cell;
  for (std::size_t i = 0; i < 64; ++i) {
    cell.labels[i] = i / 16 <= (i % 4 == 3 ? 2U : 1U) ? 1 : 0;
  }
  const volume::InsideRule smooth = volume::InsideRule::OfLabels({1}, /*smooths=*/true);
  EXPECT_TRUE(cell.IsInside({0.999, 0.5, 0.70}, smooth));
  EXPECT_FALSE(cell.IsInside({0.999, 0.5, 0.73}, smooth));
  EXPECT_TRUE(cell.IsInside({0.001, 0.5, 0.49}, smooth));
  EXPECT_FALSE(cell.IsInside({0.001, 0.5, 0.51}, smooth));
  // Beside the cell counts the nearest point of it.
  EXPECT_TRUE(cell.IsInside({1.3, 0.5, 0.70}, smooth));
  EXPECT_FALSE(cell.IsInside({0.5, 0.5, 1.3}, smooth));
}

TEST(IsInsideSmoothCellTest, ExactlyOneOfTwoLabelsHasEachPoint) {
  const volume::InsideRule low = volume::InsideRule::OfLabels({4}, /*smooths=*/true);
  const volume::InsideRule high = volume::InsideRule::OfLabels({9}, /*smooths=*/true);
  for (std::uint64_t seed = 0; seed < 2000; ++seed) {
    SmoothCell cell;
    for (std::size_t i = 0; i < 64; ++i) {
      cell.labels[i] = base::RandomUnit(seed, i) < 0.5 ? 4 : 9;
    }
    for (std::uint64_t k = 0; k < 20; ++k) {
      const Vec3d p = RandomPoint(1000 * seed + k);
      EXPECT_NE(cell.IsInside(p, low), cell.IsInside(p, high)) << seed << ", " << k;
    }
  }
}

}  // namespace
}  // namespace isoscope::extract
