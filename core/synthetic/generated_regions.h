// A ball that is divided into labelled regions: a test segmentation for `isoscope generate labels`.

#ifndef ISOSCOPE_CORE_SYNTHETIC_GENERATED_REGIONS_H_
#define ISOSCOPE_CORE_SYNTHETIC_GENERATED_REGIONS_H_

#include <cstdint>
#include <vector>

#include "core/math/vec.h"
#include "core/volume/label.h"

namespace isoscope::source {

// Labels of points in [-1, 1]^3:
//
//   0           outside the ball of radius kBallRadius around 0
//   1           the core, within kCoreRadius
//   2 .. count  the cells around the core: each point has the label of the nearest site
//
// So cells touch each other, the core and the outside; three meet at edges, four at corners. Sites
// are spread by chance, well apart. The same labels for the same seed and count on every machine:
// there are only sums, products and square roots. Immutable, thread-safe.
class GeneratedRegions {
 public:
  static constexpr double kBallRadius = 0.9;
  static constexpr double kCoreRadius = 0.35;
  static constexpr int kMaxRegions = 100;  // of an int8 sample, with a rounder number

  // `count` regions, the core among them. REQUIRES: 2 <= count <= kMaxRegions.
  GeneratedRegions(std::uint64_t seed, int count);

  [[nodiscard]] int count() const { return static_cast<int>(sites_.size()) + 1; }
  [[nodiscard]] int At(const math::Vec3d& point) const;

  // The names "core", "cell 2", "cell 3", ..., each with a colour.
  [[nodiscard]] std::vector<volume::Label> Labels() const;

 private:
  std::vector<math::Vec3d> sites_;  // of label 2 and up
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SYNTHETIC_GENERATED_REGIONS_H_
