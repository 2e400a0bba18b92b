// Sets of intervals of many shapes, for the tests of this folder.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_INDEX_INTERVAL_SETS_H_
#define ISOSCOPE_TESTS_UNIT_CORE_INDEX_INTERVAL_SETS_H_

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "core/base/random.h"
#include "core/index/interval_tree.h"
#include "core/volume/scalar_span.h"

namespace isoscope::index {

// Numbers the spans: block ids and ordinals in different orders.
inline std::vector<BlockInterval> Number(const std::vector<volume::ScalarSpan>& spans) {
  std::vector<BlockInterval> intervals;
  for (std::size_t i = 0; i < spans.size(); ++i) {
    intervals.push_back({spans[i], static_cast<volume::BlockId>(3 * i + 1),
                         static_cast<std::uint32_t>(spans.size() - 1 - i)});
  }
  return intervals;
}

// Returns the intervals that a query must report.
inline std::vector<BlockInterval> Scan(const std::vector<BlockInterval>& intervals,
                                       double isovalue) {
  std::vector<BlockInterval> active;
  for (const BlockInterval& interval : intervals) {
    if (volume::IsActive(interval.span, isovalue)) {
      active.push_back(interval);
    }
  }
  std::sort(active.begin(), active.end(),
            [](const BlockInterval& a, const BlockInterval& b) { return a.ordinal < b.ordinal; });
  return active;
}

enum class Shape {
  kUniform,
  kShort,
  kLong,
  kClustered,
  kBytes,
  kFewValues,
  kNested,
  kAllEqual,
  kDisjoint,
  kTouching,
  kSameMin,
  kSameMax,
  kStaircase,
  kHugeRange,
  kInfinite,
  kAllInfinite,
  kMostlyEmpty,
};
inline constexpr const char* kShapeNames[] = {
    "Uniform",   "Short",     "Long",     "Clustered",   "Bytes",      "FewValues",
    "Nested",    "AllEqual",  "Disjoint", "Touching",    "SameMin",    "SameMax",
    "Staircase", "HugeRange", "Infinite", "AllInfinite", "MostlyEmpty"};
inline constexpr Shape kShapes[] = {
    Shape::kUniform,     Shape::kShort,     Shape::kLong,     Shape::kClustered,
    Shape::kBytes,       Shape::kFewValues, Shape::kNested,   Shape::kAllEqual,
    Shape::kDisjoint,    Shape::kTouching,  Shape::kSameMin,  Shape::kSameMax,
    Shape::kStaircase,   Shape::kHugeRange, Shape::kInfinite, Shape::kAllInfinite,
    Shape::kMostlyEmpty,
};

inline volume::ScalarSpan Ordered(double a, double b) { return {std::min(a, b), std::max(a, b)}; }

inline std::vector<BlockInterval> MakeIntervals(Shape shape, std::size_t count,
                                                std::uint64_t seed) {
  std::vector<volume::ScalarSpan> spans;
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const auto n = static_cast<double>(count);
  for (std::size_t i = 0; i < count; ++i) {
    const double u = base::RandomUnit(seed, 3 * i);
    const double w = base::RandomUnit(seed, 3 * i + 1);
    const double z = base::RandomUnit(seed, 3 * i + 2);
    const auto at = static_cast<double>(i);
    switch (shape) {
      case Shape::kUniform:
        spans.push_back(Ordered(u, w));
        break;
      case Shape::kShort:
        spans.push_back({u, u + w / n});
        break;
      case Shape::kLong:
        spans.push_back({u * 0.1, 0.9 + w * 0.1});
        break;
      case Shape::kClustered:
        spans.push_back({std::floor(u * 5) + z * z * z * 1e-3,
                         std::floor(u * 5) + z * z * z * 1e-3 + w * 1e-4});
        break;
      case Shape::kBytes:
        spans.push_back(Ordered(std::floor(u * 256), std::floor(w * 256)));
        break;
      case Shape::kFewValues:
        spans.push_back(Ordered(std::floor(u * 4), std::floor(w * 4)));
        break;
      case Shape::kNested:
        spans.push_back({-at, at + 1});
        break;
      case Shape::kAllEqual:
        spans.push_back({5, 9});
        break;
      case Shape::kDisjoint:
        spans.push_back({at, at + 0.5});
        break;
      case Shape::kTouching:
        spans.push_back({at, at + 1});
        break;
      case Shape::kSameMin:
        spans.push_back({7, 7 + u});
        break;
      case Shape::kSameMax:
        spans.push_back({7 - u, 7});
        break;
      case Shape::kStaircase:
        spans.push_back({at, at + n / 2});
        break;
      case Shape::kHugeRange:
        spans.push_back(Ordered(std::ldexp(u - 0.5, static_cast<int>(w * 2000) - 1000),
                                std::ldexp(z - 0.5, static_cast<int>(w * 1900) - 1000)));
        break;
      case Shape::kInfinite:
        spans.push_back(u < 0.3   ? Ordered(-kInfinity, w)
                        : u < 0.6 ? Ordered(w, kInfinity)
                                  : Ordered(w, z));
        break;
      case Shape::kAllInfinite:
        spans.push_back({-kInfinity, kInfinity});
        break;
      case Shape::kMostlyEmpty:
        spans.push_back(u < 0.5   ? volume::ScalarSpan{w, w}
                        : u < 0.9 ? volume::ScalarSpan{}
                                  : volume::ScalarSpan{w, w + z});
        break;
    }
  }
  return Number(spans);
}

}  // namespace isoscope::index

#endif  // ISOSCOPE_TESTS_UNIT_CORE_INDEX_INTERVAL_SETS_H_
