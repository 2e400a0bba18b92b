// Sites by the best of several candidates: each new site is the candidate that is farthest from the
// sites before it. Source: Mitchell 1991, "Spectrally optimal sampling for distribution ray
// tracing", section 4. Candidates lie between the core and the rim, so that each cell has samples.

#include "core/synthetic/generated_regions.h"

#include <algorithm>
#include <cstddef>
#include <limits>

#include "absl/strings/str_cat.h"

#include "core/base/check.h"
#include "core/base/random.h"

namespace isoscope::source {
namespace {

constexpr int kCandidates = 32;  // for each site
constexpr double kMinSiteRadius = 0.45;
constexpr double kMaxSiteRadius = 0.85;
constexpr volume::LabelColor kCoreColor{.red = 250, .green = 250, .blue = 242};

double Square(const math::Vec3d& v) { return math::Dot(v, v); }

// A point where sites may be, by rejection of points of the cube.
math::Vec3d Candidate(std::uint64_t seed, std::uint64_t* counter) {
  while (true) {
    math::Vec3d point;
    for (int axis = 0; axis < 3; ++axis) {
      point[axis] = 2 * base::RandomUnit(seed, (*counter)++) - 1;
    }
    const double square = Square(point);
    if (square >= kMinSiteRadius * kMinSiteRadius && square <= kMaxSiteRadius * kMaxSiteRadius) {
      return point;
    }
  }
}

}  // namespace

GeneratedRegions::GeneratedRegions(std::uint64_t seed, int count) {
  ISOSCOPE_CHECK(count >= 2 && count <= kMaxRegions);
  std::uint64_t counter = 0;
  while (this->count() < count) {
    math::Vec3d best;
    double best_distance = -1;
    for (int i = 0; i < kCandidates; ++i) {
      const math::Vec3d candidate = Candidate(seed, &counter);
      double distance = std::numeric_limits<double>::max();
      for (const math::Vec3d& site : sites_) {
        distance = std::min(distance, Square(candidate - site));
      }
      if (distance > best_distance) {
        best = candidate;
        best_distance = distance;
      }
    }
    sites_.push_back(best);
  }
}

int GeneratedRegions::At(const math::Vec3d& point) const {
  const double square = Square(point);
  if (square > kBallRadius * kBallRadius) {
    return 0;
  }
  if (square <= kCoreRadius * kCoreRadius) {
    return 1;
  }
  int nearest = 0;
  double nearest_square = std::numeric_limits<double>::max();
  for (std::size_t i = 0; i < sites_.size(); ++i) {
    const double distance = Square(point - sites_[i]);
    if (distance < nearest_square) {  // the earlier one of two that are as near
      nearest = static_cast<int>(i);
      nearest_square = distance;
    }
  }
  return nearest + 2;
}

std::vector<volume::Label> GeneratedRegions::Labels() const {
  std::vector<volume::Label> labels = {{.value = 1, .name = "core", .color = kCoreColor}};
  for (int value = 2; value <= count(); ++value) {
    labels.push_back({.value = static_cast<double>(value),
                      .name = absl::StrCat("cell ", value),
                      .color = volume::DefaultLabelColor(value)});
  }
  return labels;
}

}  // namespace isoscope::source
