// Counts of samples by value, in bins on a grid of powers of two.
//
// Bin i holds the samples in [first + i, first + i + 1) * 2^exponent. Two bins make one of the next
// exponent, so coarsening a histogram is exact. The bins of a volume follow from the range of its
// samples alone. So they depend neither on the order of counting nor on the shards.
//
// Example: uint8 samples of 3 to 250 have exponent 0, first 3 and 248 bins: exact counts. Samples
// of float32 in [0, 1] have exponent -11, first 0 and 2049 bins; the last one holds only the ones.

#ifndef ISOSCOPE_CORE_VOLUME_SAMPLE_HISTOGRAM_H_
#define ISOSCOPE_CORE_VOLUME_SAMPLE_HISTOGRAM_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/math/box.h"
#include "core/volume/block_layout.h"
#include "core/volume/label_values.h"
#include "core/volume/scalar_span.h"
#include "core/volume/scalar_type.h"

namespace isoscope::volume {

inline constexpr std::int64_t kMaxHistogramBins = 4096;
// Bounds for doubles: no bin is finer than 2^kMin, and 2^kMax suffices for the range of all
// doubles.
inline constexpr int kMinHistogramExponent = -1000;
inline constexpr int kMaxHistogramExponent = 1014;

struct HistogramBins {
  int exponent = 0;        // in [kMinHistogramExponent, kMaxHistogramExponent]; integers: >= 0
  std::int64_t first = 0;  // |first| <= 2^53
  std::int64_t count = 0;  // 0 to kMaxHistogramBins; 0: there is no finite sample

  friend bool operator==(const HistogramBins&, const HistogramBins&) = default;

  // The lower edge of bin i, which is the upper edge of bin i - 1.
  [[nodiscard]] double EdgeOf(std::int64_t i) const;
  // The bin of a value, in [0, count) if the bins cover it. REQUIRES: `value` is finite, and its
  // distance from the bins is below 2^62 of them.
  [[nodiscard]] std::int64_t IndexOf(double value) const;
};

// Returns the finest bins that cover a range, at most kMaxHistogramBins: for integers up to as many
// values exact ones, else 2049 to 4096 bins, unless the samples have no more digits than fewer bins
// tell apart. No bins for an empty range (min > max). REQUIRES: both ends are finite, or the range
// is empty.
HistogramBins BinsOf(ScalarType type, const ScalarSpan& finite_range);

// The samples of a block that a histogram counts: its own ones without the +1 layer, which other
// blocks have too, but with the last layer of the volume. So each sample of the volume belongs to
// exactly one block. REQUIRES: id < layout.block_count().
math::IndexBox CountedSamplesOf(const BlockLayout& layout, BlockId id);

struct SampleHistogram {
  HistogramBins bins;
  std::vector<std::int64_t> counts;  // by bin; bins.count of them, each >= 0
  std::int64_t nan_count = 0;
  std::int64_t negative_infinity_count = 0;
  std::int64_t positive_infinity_count = 0;

  friend bool operator==(const SampleHistogram&, const SampleHistogram&) = default;

  // All samples, those apart from the bins included.
  [[nodiscard]] std::int64_t TotalCount() const;
  // REQUIRES: equal bins.
  void Add(const SampleHistogram& other);
};

// Groups of neighbouring bins: group g has bins [begin + g * size, begin + (g + 1) * size) of
// `bins`, of which the last group may overhang.
struct BinGroups {
  HistogramBins bins;
  std::int64_t begin = 0;
  std::int64_t size = 1;   // bins of a group, >= 1
  std::int64_t count = 0;  // groups

  friend bool operator==(const BinGroups&, const BinGroups&) = default;

  [[nodiscard]] double LowerEdgeOf(std::int64_t group) const {
    return bins.EdgeOf(begin + group * size);
  }
  [[nodiscard]] double CenterOf(std::int64_t group) const {
    return 0.5 * LowerEdgeOf(group) + 0.5 * LowerEdgeOf(group + 1);
  }
  // The bins of the last group end with `bins`.
  [[nodiscard]] std::int64_t EndOf(std::int64_t group) const;
  // The sum over the bins of a group. REQUIRES: counts.size() == bins.count.
  [[nodiscard]] std::int64_t SumOf(const std::vector<std::int64_t>& counts,
                                   std::int64_t group) const;
};

// Groups the bins that meet `range` (unset: all bins) into at most `max_count` groups of equal
// size, the smallest that does. INVALID_ARGUMENT if no bin meets the range.
// REQUIRES: 1 <= max_count; range is finite with min <= max.
absl::StatusOr<BinGroups> GroupBins(const HistogramBins& bins, std::int64_t max_count,
                                    const std::optional<ScalarSpan>& range);

// Numbers about isovalues, for some blocks. The parts of all shards add up to those of the volume.
struct HistogramPart {
  BinGroups groups;
  // By group, for the isovalue at its centre.
  std::vector<std::int64_t> active_block_counts;
  std::vector<std::int64_t> active_block_bytes;  // as stored in the shards
  std::vector<std::int64_t> estimated_triangle_counts;
  // Not set if the samples of some blocks were not counted (datasets of earlier versions).
  std::optional<SampleHistogram> samples;
  // The range of all samples of the volume that are not NaN; also empty in a part of an earlier
  // version.
  ScalarSpan value_range;
  // Not set unless asked for.
  std::optional<LabelValues> label_values = std::nullopt;
};

// Adds `other`. INVALID_ARGUMENT if its groups differ from those of `sum`, or its range, where both
// have one.
absl::Status AddPart(const HistogramPart& other, HistogramPart* sum);

// Returns the estimated triangles of an active block: kTrianglesPerFaceCell times the area of a
// face of the cube with as many cells. Counted on 35 surfaces of 8 real volumes, the true number
// lies within a factor of 2 for 29 of them and of 3 for 33; noise has up to 2.9 times as many, and
// the last crumbs at the ends of the range down to a fifth (docs/format/histogram.md).
inline constexpr double kTrianglesPerFaceCell = 2.8;
std::int64_t EstimateTriangles(const math::Index3& block_cells);

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_SAMPLE_HISTOGRAM_H_
