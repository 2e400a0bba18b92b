// Counts the samples of all shards by value in one pass, while their range is still unknown.
//
// The bins of all shards are those of the range seen so far (volume::BinsOf). When it grows, they
// are regrouped without loss, because bins of one exponent make whole bins of the next. So at the
// end all shards have the bins of the whole range, whatever the order of samples, portions and
// threads was.

#ifndef ISOSCOPE_CORE_PARTITION_HISTOGRAM_BUILDER_H_
#define ISOSCOPE_CORE_PARTITION_HISTOGRAM_BUILDER_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/types/span.h"

#include "core/base/mutex.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_samples.h"
#include "core/volume/sample_histogram.h"
#include "core/volume/scalar_span.h"
#include "core/volume/scalar_type.h"

namespace isoscope::partition {

// Returns the span of the finite samples among a block's own ones.
volume::ScalarSpan FiniteSpanOfBlock(const volume::BlockLayout& layout,
                                     const volume::BlockSamples& samples);

class HistogramBuilder {
 public:
  // The memory for one shard.
  static constexpr std::int64_t kBytesPerShard = volume::kMaxHistogramBins * 8 + 128;

  // `layout` must outlive it.
  HistogramBuilder(const volume::BlockLayout& layout, volume::ScalarType type, int shard_count);

  // Widens the bins to finite samples of this span. REQUIRES: no call of Count is running.
  void Cover(const volume::ScalarSpan& finite_span);
  // Counts the samples that belong to these blocks of one shard (volume::CountedSamplesOf).
  // Thread-safe. REQUIRES: their finite samples are covered; they have the builder's type.
  void Count(int shard, absl::Span<const volume::BlockSamples> blocks);
  // Returns the range that the bins cover: of all finite samples so far; empty if there are none.
  [[nodiscard]] const volume::ScalarSpan& finite_range() const { return range_; }
  // Returns the histogram of a shard.
  [[nodiscard]] volume::SampleHistogram Get(int shard) const;

 private:
  struct Counts {
    std::vector<std::int64_t> bins;  // kMaxHistogramBins of them
    std::int64_t nan = 0;
    std::int64_t negative_infinity = 0;
    std::int64_t positive_infinity = 0;
  };
  struct LocalCounts;

  template <typename T>
  void CountSample(T sample, LocalCounts* local) const;
  // Counts samples in pairs, from the first on, and returns how many. REQUIRES: products are exact.
  template <typename SampleAt>
  std::size_t CountPairs(std::size_t count, const SampleAt& sample_at, LocalCounts* local) const;
  template <typename T>
  void CountRow(const char* row, std::size_t count, LocalCounts* local) const;

  const volume::BlockLayout& layout_;
  const volume::ScalarType type_;
  volume::ScalarSpan range_;  // covered
  volume::HistogramBins bins_;
  std::vector<Counts> shards_;
  // Shard i uses mutexes_[i % size].
  std::array<base::Mutex, 64> mutexes_;
};

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_HISTOGRAM_BUILDER_H_
