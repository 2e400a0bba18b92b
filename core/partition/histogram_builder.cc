// A thread counts some blocks of a shard into tables of its own, then adds these to the shard's
// under a lock. There are two tables, for even and odd samples of a row. So if all samples are
// equal, a sample does not wait for the count of the one before.

#include "core/partition/histogram_builder.h"

#include <algorithm>
#include <cmath>
#include <type_traits>
#include <utility>

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/partition/block_cutter.h"

namespace isoscope::partition {
volume::ScalarSpan FiniteSpanOfBlock(const volume::BlockLayout& layout,
                                     const volume::BlockSamples& samples) {
  volume::ScalarSpan span;
  volume::VisitScalarType(samples.type, [&]<typename T>() {
    ForEachRow(layout, samples, layout.OwnSamplesOf(samples.block_id),
               [&](const char* row, std::size_t count) {
                 for (std::size_t i = 0; i < count; ++i) {
                   const auto value =
                       static_cast<double>(base::LoadLittleEndian<T>(row + i * sizeof(T)));
                   if (std::isfinite(value)) {
                     span.min = std::min(span.min, value);
                     span.max = std::max(span.max, value);
                   }
                 }
               });
  });
  return span;
}

struct HistogramBuilder::LocalCounts {
  std::array<std::array<std::uint32_t, volume::kMaxHistogramBins>, 2> bins{};
  std::uint64_t nan = 0;
  std::uint64_t negative_infinity = 0;
  std::uint64_t positive_infinity = 0;
  double scale = 1;                 // 2^-exponent
  bool has_exact_products = false;  // of samples with it
};

HistogramBuilder::HistogramBuilder(const volume::BlockLayout& layout, volume::ScalarType type,
                                   int shard_count)
    : layout_(layout), type_(type), shards_(static_cast<std::size_t>(shard_count)) {
  for (Counts& counts : shards_) {
    counts.bins.resize(volume::kMaxHistogramBins);
  }
}

void HistogramBuilder::Cover(const volume::ScalarSpan& finite_span) {
  if (!(finite_span.min < range_.min || finite_span.max > range_.max)) {
    return;
  }
  range_.min = std::min(range_.min, finite_span.min);
  range_.max = std::max(range_.max, finite_span.max);
  const volume::HistogramBins wider = volume::BinsOf(type_, range_);
  if (wider == bins_) {
    return;
  }
  const volume::HistogramBins narrower = bins_;
  bins_ = wider;
  if (narrower.count == 0) {
    return;
  }
  // Shifts of more bits than an index has move all of it.
  const int shift = std::min(wider.exponent - narrower.exponent, 63);
  ISOSCOPE_CHECK_GE(shift, 0);
  for (Counts& counts : shards_) {
    std::vector<std::int64_t> regrouped(volume::kMaxHistogramBins);
    for (std::int64_t i = 0; i < narrower.count; ++i) {
      const std::int64_t index = ((narrower.first + i) >> shift) - wider.first;
      regrouped[static_cast<std::size_t>(index)] += counts.bins[static_cast<std::size_t>(i)];
    }
    counts.bins = std::move(regrouped);
  }
}

template <typename T>
void HistogramBuilder::CountSample(T sample, LocalCounts* local) const {
  const auto value = static_cast<double>(sample);
  if (std::isfinite(value)) {
    ++local->bins[0][static_cast<std::size_t>(bins_.IndexOf(value))];
  } else {
    (std::isnan(value) ? local->nan
     : value < 0       ? local->negative_infinity
                       : local->positive_infinity) += 1;
  }
}

template <typename T>
void HistogramBuilder::CountRow(const char* row, std::size_t count, LocalCounts* local) const {
  if constexpr (std::is_integral_v<T>) {
    for (std::size_t i = 0; i < count; ++i) {
      const auto sample = std::int64_t{base::LoadLittleEndian<T>(row + i * sizeof(T))};
      ++local->bins[i % 2][static_cast<std::size_t>((sample >> bins_.exponent) - bins_.first)];
    }
  } else {
    const auto sample_at = [&](std::size_t i) {
      return base::LoadLittleEndian<T>(row + i * sizeof(T));
    };
    std::size_t i = 0;
    if (local->has_exact_products) {
      i = CountPairs(count, sample_at, local);
    }
    for (; i < count; ++i) {
      CountSample(sample_at(i), local);
    }
  }
}

// Has one branch, which is nearly never taken: NaN and infinite samples fall just outside the bins.
template <typename SampleAt>
std::size_t HistogramBuilder::CountPairs(std::size_t count, const SampleAt& sample_at,
                                         LocalCounts* local) const {
  const auto below = static_cast<double>(bins_.first - 1);
  const auto above = static_cast<double>(bins_.first + bins_.count);
  const double scale = local->scale;
  const std::int64_t first = bins_.first;
  const auto bin_count = static_cast<std::uint64_t>(bins_.count);
  std::uint32_t* const even = local->bins[0].data();
  std::uint32_t* const odd = local->bins[1].data();
  const auto index_of = [&](auto sample) {
    const double scaled = static_cast<double>(sample) * scale;
    const double at_least = below < scaled ? scaled : below;
    const double clamped = at_least < above ? at_least : above;
    const auto truncated = static_cast<std::int64_t>(clamped);
    const std::int64_t is_cut_up = clamped < static_cast<double>(truncated) ? 1 : 0;
    return static_cast<std::uint64_t>(truncated - is_cut_up - first);
  };
  std::size_t i = 0;
  for (; i + 2 <= count; i += 2) {
    const std::uint64_t a = index_of(sample_at(i));
    const std::uint64_t b = index_of(sample_at(i + 1));
    if (a < bin_count && b < bin_count) {
      ++even[a];
      ++odd[b];
    } else {
      CountSample(sample_at(i), local);
      CountSample(sample_at(i + 1), local);
    }
  }
  return i;
}

void HistogramBuilder::Count(int shard, absl::Span<const volume::BlockSamples> blocks) {
  thread_local LocalCounts local;
  local.nan = 0;
  local.negative_infinity = 0;
  local.positive_infinity = 0;
  local.scale = std::ldexp(1.0, -bins_.exponent);
  // With an exponent above 0, products of the smallest doubles underflow.
  local.has_exact_products = type_ != volume::ScalarType::kFloat64 || bins_.exponent <= 0;
  const auto bin_count = static_cast<std::size_t>(bins_.count);
  for (auto& bins : local.bins) {
    std::fill_n(bins.begin(), bin_count, std::uint32_t{0});
  }
  volume::VisitScalarType(type_, [&]<typename T>() {
    for (const volume::BlockSamples& block : blocks) {
      ForEachRow(layout_, block, volume::CountedSamplesOf(layout_, block.block_id),
                 [&](const char* row, std::size_t count) { CountRow<T>(row, count, &local); });
    }
  });
  const auto at = static_cast<std::size_t>(shard);
  const base::MutexLock lock(&mutexes_[at % mutexes_.size()]);
  Counts& counts = shards_[at];
  for (std::size_t i = 0; i < bin_count; ++i) {
    counts.bins[i] += std::int64_t{local.bins[0][i]} + std::int64_t{local.bins[1][i]};
  }
  counts.nan += static_cast<std::int64_t>(local.nan);
  counts.negative_infinity += static_cast<std::int64_t>(local.negative_infinity);
  counts.positive_infinity += static_cast<std::int64_t>(local.positive_infinity);
}

volume::SampleHistogram HistogramBuilder::Get(int shard) const {
  const Counts& counts = shards_[static_cast<std::size_t>(shard)];
  return {.bins = bins_,
          .counts = {counts.bins.begin(), counts.bins.begin() + bins_.count},
          .nan_count = counts.nan,
          .negative_infinity_count = counts.negative_infinity,
          .positive_infinity_count = counts.positive_infinity};
}

}  // namespace isoscope::partition
