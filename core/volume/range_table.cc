// The table is one array, min and max of each block in turn, in the sample type:
//
//        block 0     block 1     block 2
//        min | max | min | max | min | max | ...
//
// ActiveBlocks is one pass over it, each frame, in every agent. It turns the isovalue into the
// smallest sample that is inside (InsideThreshold), so that spans are compared in the sample type:
// a span is active iff min < threshold && max >= threshold. Kernels load a register of spans, split
// it into minima and maxima, and pack the comparison into 64-bit words of the block set.
//
// Example: uint8 and isovalue 59.5 give threshold 60. [12, 60] is active, as 12 < 60 <= 60; [60,
// 80] is not, for all its samples are inside; nor is [12, 59]. The empty span (255, 0) never is.
//
// The words are filled in whole: 64 spans make one, and the rest of the last one is done one by
// one.

#include "core/volume/range_table.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <type_traits>
#include <utility>

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/volume/active_spans.h"

// This file is compiled once for each instruction set; the processor's best one is called.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/volume/range_table.cc"
#include "hwy/foreach_target.h"  // IWYU pragma: keep
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::volume::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// Returns one bit for each span (min, max) of a register, lowest first: set if it is active.
template <typename T, class D>
std::uint64_t ActiveBits(D d, const T* spans, hn::Vec<D> threshold) {
  hn::Vec<D> min;
  hn::Vec<D> max;
  hn::LoadInterleaved2(d, spans, min, max);
  const auto is_below = hn::Lt(min, threshold);
  std::uint64_t bits = 0;
  if constexpr (std::is_floating_point_v<T>) {
    hn::StoreMaskBits(d, hn::And(is_below, hn::Ge(max, threshold)),
                      reinterpret_cast<std::uint8_t*>(&bits));
  } else {
    hn::StoreMaskBits(d, hn::AndNot(hn::Lt(max, threshold), is_below),
                      reinterpret_cast<std::uint8_t*>(&bits));
  }
  return bits;
}

// Sets bit `id` of `words` iff span `id` is active. `bytes` are those of RangeTable::bytes().
template <typename T>
void FindActive(const char* bytes, std::size_t block_count, T threshold, std::uint64_t* words) {
  const hn::CappedTag<T, 64> d;
  const std::size_t lanes = hn::Lanes(d);
  const auto threshold_lanes = hn::Set(d, threshold);
  // Loaded as vectors only, which need no alignment.
  const auto* const spans = reinterpret_cast<const T*>(bytes);
  const std::size_t full_words = block_count / 64;
  for (std::size_t word = 0; word < full_words; ++word) {
    std::uint64_t bits = 0;
    for (std::size_t i = 0; i < 64; i += lanes) {
      bits |= ActiveBits(d, spans + 2 * (word * 64 + i), threshold_lanes) << i;
    }
    words[word] = bits;
  }
  for (std::size_t id = full_words * 64; id < block_count; ++id) {
    const char* const span = bytes + 2 * sizeof(T) * id;
    const bool is_active = base::LoadLittleEndian<T>(span) < threshold &&
                           base::LoadLittleEndian<T>(span + sizeof(T)) >= threshold;
    words[full_words] |= std::uint64_t{is_active ? 1U : 0U} << (id % 64);
  }
}

void FindActiveBlocks(ScalarType type, const char* bytes, std::size_t block_count, double isovalue,
                      std::uint64_t* words) {
  VisitScalarType(type, [&]<typename T>() {
    const Threshold<T> threshold = InsideThreshold<T>(isovalue);
    if (threshold.any) {
      FindActive<T>(bytes, block_count, threshold.value, words);
    }
  });
}

}  // namespace
}  // namespace isoscope::volume::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isoscope::volume {
namespace {

HWY_EXPORT(FindActiveBlocks);

// The representation of an empty span: min > max in T.
template <typename T>
constexpr std::pair<T, T> EmptySpan() {
  if constexpr (std::is_floating_point_v<T>) {
    return {std::numeric_limits<T>::infinity(), -std::numeric_limits<T>::infinity()};
  } else {
    return {std::numeric_limits<T>::max(), std::numeric_limits<T>::lowest()};
  }
}

}  // namespace

RangeTable::RangeTable(ScalarType type, std::int64_t block_count)
    : type_(type), block_count_(block_count) {
  bytes_.resize(2 * SizeOf(type) * static_cast<std::size_t>(block_count));
  for (std::int64_t id = 0; id < block_count; ++id) {
    Set(static_cast<BlockId>(id), ScalarSpan{});
  }
}

void RangeTable::Set(BlockId id, const ScalarSpan& span) {
  VisitScalarType(type_, [&]<typename T>() {
    char* entry = bytes_.data() + 2 * sizeof(T) * id;
    const auto [min, max] =
        span.min > span.max ? EmptySpan<T>()
                            : std::pair<T, T>{static_cast<T>(span.min), static_cast<T>(span.max)};
    base::StoreLittleEndian(min, entry);
    base::StoreLittleEndian(max, entry + sizeof(T));
  });
}

ScalarSpan RangeTable::Get(BlockId id) const { return SpanAt(type_, bytes_, id); }

ScalarSpan RangeTable::Total() const {
  ScalarSpan total;
  for (std::int64_t id = 0; id < block_count_; ++id) {
    const ScalarSpan span = Get(static_cast<BlockId>(id));
    if (span.min <= span.max) {
      total.min = std::min(total.min, span.min);
      total.max = std::max(total.max, span.max);
    }
  }
  return total;
}

BlockSet RangeTable::ActiveBlocks(double isovalue) const {
  return ActiveBlocks(InsideRule::OfIsovalue(isovalue));
}

BlockSet RangeTable::ActiveBlocks(const InsideRule& rule) const {
  BlockSet active(block_count_);
  FindActiveSpans(type_, bytes_, rule, active.words());
  return active;
}

ScalarSpan SpanAt(ScalarType type, absl::string_view bytes, std::int64_t index) {
  return VisitScalarType(type, [&]<typename T>() {
    const char* const entry = bytes.data() + 2 * sizeof(T) * static_cast<std::size_t>(index);
    return ScalarSpan{static_cast<double>(base::LoadLittleEndian<T>(entry)),
                      static_cast<double>(base::LoadLittleEndian<T>(entry + sizeof(T)))};
  });
}

void FindActiveSpans(ScalarType type, absl::string_view bytes, const InsideRule& rule,
                     absl::Span<std::uint64_t> words) {
  const std::size_t count = bytes.size() / (2 * SizeOf(type));
  ISOSCOPE_CHECK_EQ(words.size(), (count + 63) / 64);
  if (!rule.has_labels()) {
    HWY_DYNAMIC_DISPATCH(FindActiveBlocks)(type, bytes.data(), count, rule.isovalue, words.data());
    return;
  }
  VisitScalarType(type, [&]<typename T>() {
    for (std::size_t i = 0; i < count; ++i) {
      const char* const entry = bytes.data() + 2 * sizeof(T) * i;
      const auto min = base::LoadLittleEndian<T>(entry);
      const auto max = base::LoadLittleEndian<T>(entry + sizeof(T));
      // Most blocks of a segmentation have one value: they need no search.
      if (min < max && rule.IsActive(static_cast<double>(min), static_cast<double>(max))) {
        words[i / 64] |= std::uint64_t{1} << (i % 64);
      }
    }
  });
}

RangeTable RangeTable::FromBytes(ScalarType type, std::int64_t block_count, std::string bytes) {
  ISOSCOPE_CHECK_EQ(bytes.size(), 2 * SizeOf(type) * static_cast<std::size_t>(block_count));
  RangeTable table;
  table.type_ = type;
  table.block_count_ = block_count;
  table.bytes_ = std::move(bytes);
  return table;
}

}  // namespace isoscope::volume
#endif  // HWY_ONCE
