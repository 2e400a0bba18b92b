#include "core/volume/range_table.h"

#include <algorithm>
#include <bit>
#include <limits>
#include <type_traits>
#include <utility>

#include "core/base/check.h"
#include "core/base/coding.h"

namespace isoscope::volume {
namespace {

// What an empty span is kept as: min > max in T.
template <typename T>
constexpr std::pair<T, T> EmptySpan() {
  if constexpr (std::is_floating_point_v<T>) {
    return {std::numeric_limits<T>::infinity(), -std::numeric_limits<T>::infinity()};
  } else {
    return {std::numeric_limits<T>::max(), std::numeric_limits<T>::lowest()};
  }
}

}  // namespace

std::int64_t BlockSet::Count() const {
  std::int64_t count = 0;
  for (const std::uint64_t word : words_) {
    count += std::popcount(word);
  }
  return count;
}

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

ScalarSpan RangeTable::Get(BlockId id) const {
  return VisitScalarType(type_, [&]<typename T>() {
    const char* entry = bytes_.data() + 2 * sizeof(T) * id;
    return ScalarSpan{static_cast<double>(base::LoadLittleEndian<T>(entry)),
                      static_cast<double>(base::LoadLittleEndian<T>(entry + sizeof(T)))};
  });
}

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
  BlockSet active(block_count_);
  VisitScalarType(type_, [&]<typename T>() {
    const Threshold<T> threshold = InsideThreshold<T>(isovalue);
    if (!threshold.any) {
      return;
    }
    for (std::int64_t id = 0; id < block_count_; ++id) {
      const char* entry = bytes_.data() + 2 * sizeof(T) * static_cast<std::size_t>(id);
      if (base::LoadLittleEndian<T>(entry) < threshold.value &&
          base::LoadLittleEndian<T>(entry + sizeof(T)) >= threshold.value) {
        active.Insert(static_cast<BlockId>(id));
      }
    }
  });
  return active;
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
