#include "core/ingest/block_cutter.h"

#include <array>
#include <cstddef>
#include <cstring>
#include <limits>
#include <type_traits>

#include "core/base/coding.h"
#include "core/math/box.h"

namespace isoscope::ingest {
namespace {

// The lowest and highest of many samples, in lanes that the compiler keeps in vector registers.
// A NaN compares false and leaves a lane as it was.
template <typename T>
class MinMax {
 public:
  MinMax() {
    if constexpr (std::is_floating_point_v<T>) {
      min_.fill(std::numeric_limits<T>::infinity());
      max_.fill(-std::numeric_limits<T>::infinity());
    } else {
      min_.fill(std::numeric_limits<T>::max());
      max_.fill(std::numeric_limits<T>::lowest());
    }
  }

  void AddRow(const char* row, std::size_t count) {
    std::size_t i = 0;
    for (; i + kLanes <= count; i += kLanes) {
      std::array<T, kLanes> samples;
      std::memcpy(samples.data(), row + i * sizeof(T), sizeof(samples));
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        min_[lane] = samples[lane] < min_[lane] ? samples[lane] : min_[lane];
        max_[lane] = samples[lane] > max_[lane] ? samples[lane] : max_[lane];
      }
    }
    for (std::size_t lane = 0; i < count; ++i, ++lane) {
      const T sample = base::LoadLittleEndian<T>(row + i * sizeof(T));
      min_[lane] = sample < min_[lane] ? sample : min_[lane];
      max_[lane] = sample > max_[lane] ? sample : max_[lane];
    }
  }

  [[nodiscard]] volume::ScalarSpan Get() const {
    T min = min_[0];
    T max = max_[0];
    for (std::size_t lane = 1; lane < kLanes; ++lane) {
      min = min_[lane] < min ? min_[lane] : min;
      max = max_[lane] > max ? max_[lane] : max;
    }
    // min > max only if no sample counted. Adding 0 turns -0 into +0: equal samples, one pattern.
    return min > max
               ? volume::ScalarSpan{}
               : volume::ScalarSpan{static_cast<double>(min) + 0.0, static_cast<double>(max) + 0.0};
  }

 private:
  static constexpr std::size_t kLanes = 16 / sizeof(T) < 4 ? 4 : 16 / sizeof(T);

  std::array<T, kLanes> min_;
  std::array<T, kLanes> max_;
};

// Calls visit(row, sample count) for each row of `box`.
template <typename Visit>
void ForEachRow(const volume::BlockLayout& layout, std::size_t sample_size, const Slab& slab,
                const math::IndexBox& box, const Visit& visit) {
  const math::Index3& dims = layout.sample_dims();
  const std::int64_t rows = slab.rows == 0 ? dims.y : slab.rows;
  const auto count = static_cast<std::size_t>(box.end.x - box.begin.x);
  for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
    for (std::int64_t y = box.begin.y; y < box.end.y; ++y) {
      const std::int64_t first =
          ((z - slab.begin_z) * rows + y - slab.begin_y) * dims.x + box.begin.x;
      visit(slab.samples + static_cast<std::size_t>(first) * sample_size, count);
    }
  }
}

}  // namespace

volume::ScalarSpan SpanOfBlock(const volume::BlockLayout& layout, volume::ScalarType type,
                               const Slab& slab, volume::BlockId id) {
  return volume::VisitScalarType(type, [&]<typename T>() {
    MinMax<T> min_max;
    ForEachRow(layout, sizeof(T), slab, layout.OwnSamplesOf(id),
               [&](const char* row, std::size_t count) { min_max.AddRow(row, count); });
    return min_max.Get();
  });
}

void CutBlock(const volume::BlockLayout& layout, volume::ScalarType type, const Slab& slab,
              volume::BlockId id, char* out) {
  const std::size_t sample_size = volume::SizeOf(type);
  ForEachRow(layout, sample_size, slab, layout.StoredSamplesOf(id),
             [&](const char* row, std::size_t count) {
               std::memcpy(out, row, count * sample_size);
               out += count * sample_size;
             });
}

}  // namespace isoscope::ingest
