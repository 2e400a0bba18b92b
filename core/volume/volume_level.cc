// Means of integers are exact: the sum of 8 samples fits 64 bits, and its quotient by 8 is rounded
// half to even. Those of 8-bit samples are multiplied by 256 / 8 = 32 instead, which loses nothing.
//
// Means of floats are a fixed sequence of IEEE operations on doubles: each sample times 1/8, then
// sums of neighbours along y, along z, along x, then one rounding to the sample type. Scaling first
// keeps sums of the largest samples finite. A result that is NaN gets one bit pattern, because
// processors choose different ones.
//
// A row is summed in runs: first the four rows, sample by sample, then pairs of the sums. Both are
// loops over neighbours in memory, which compilers turn into vector instructions.
//
// The majority: among 8 values, the one with the most equal ones; of several, the lowest.

#include "core/volume/volume_level.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>

#include "absl/strings/str_cat.h"

#include "core/base/check.h"
#include "core/math/matrix.h"

namespace isoscope::volume {
namespace {

constexpr double kAutoSamples = 512.0 * 512.0 * 512.0;
// 45^3, rounded: half of 90^3 on each axis, which is as far above 64^3.
constexpr double kCoarsestSamples = 91'125.0;
constexpr double kByteScale = 256;

double SampleCount(const math::Index3& dims) {
  return static_cast<double>(dims.x) * static_cast<double>(dims.y) * static_cast<double>(dims.z);
}

bool IsByte(ScalarType type) { return type == ScalarType::kUint8 || type == ScalarType::kInt8; }

template <typename T>
T Load(const char* samples, std::size_t index) {
  T value;
  std::memcpy(&value, samples + index * sizeof(T), sizeof(T));
  return value;
}

// Rounds half to even: adds 3, or 4 if the quotient is odd, and shifts towards minus infinity.
// Examples: sums of 12, 20, 28 are 1.5, 2.5, 3.5, and give 2, 2, 4.
template <typename T, typename Sum>
T RoundedEighth(Sum sum) {
  return static_cast<T>((sum + 3 + ((sum >> 3) & 1)) >> 3);
}

// What means are summed in, and a sample's part of it.
template <typename T>
using SumOf = std::conditional_t<std::is_floating_point_v<T>, double,
                                 std::conditional_t<(sizeof(T) > 2), std::int64_t, std::int32_t>>;

template <typename T>
SumOf<T> PartOf(T sample) {
  if constexpr (std::is_floating_point_v<T>) {
    return static_cast<double>(sample) * 0.125;
  } else {
    return static_cast<SumOf<T>>(sample);
  }
}

template <typename T, typename Out>
Out MeanOf(SumOf<T> sum) {
  if constexpr (std::is_floating_point_v<T>) {
    return std::isnan(sum) ? std::numeric_limits<Out>::quiet_NaN() : static_cast<Out>(sum);
  } else if constexpr (sizeof(T) == sizeof(Out)) {
    return RoundedEighth<Out>(sum);
  } else {
    return static_cast<Out>(sum * (static_cast<std::int32_t>(kByteScale) / 8));
  }
}

// The samples of one result.
template <typename T>
using Eight = std::array<T, 8>;

template <typename T>
Eight<T> LoadEight(const std::array<const char*, 4>& rows, std::size_t index) {
  Eight<T> samples;
  for (std::size_t row = 0; row < rows.size(); ++row) {
    samples[2 * row] = Load<T>(rows[row], 2 * index);
    samples[2 * row + 1] = Load<T>(rows[row], 2 * index + 1);
  }
  return samples;
}

template <typename T>
T Majority(Eight<T> samples) {
  if (std::all_of(samples.begin() + 1, samples.end(), [&](T s) { return s == samples[0]; })) {
    return samples[0];
  }
  std::sort(samples.begin(), samples.end());
  T best = samples[0];
  int best_count = 0;
  int count = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    count = i > 0 && samples[i] == samples[i - 1] ? count + 1 : 1;
    if (count > best_count) {  // a later value is higher, so it needs more
      best_count = count;
      best = samples[i];
    }
  }
  return best;
}

// Results of one run.
constexpr std::size_t kRunSamples = 256;

template <typename T, typename Out>
void MeanRun(const std::array<const char*, 4>& rows, std::size_t first, std::size_t count,
             char* out) {
  std::array<SumOf<T>, 2 * kRunSamples> sums;
  for (std::size_t i = 0; i < 2 * count; ++i) {
    const std::size_t at = 2 * first + i;
    sums[i] = (PartOf(Load<T>(rows[0], at)) + PartOf(Load<T>(rows[1], at))) +
              (PartOf(Load<T>(rows[2], at)) + PartOf(Load<T>(rows[3], at)));
  }
  for (std::size_t i = 0; i < count; ++i) {
    const Out mean = MeanOf<T, Out>(sums[2 * i] + sums[2 * i + 1]);
    std::memcpy(out + (first + i) * sizeof(Out), &mean, sizeof(Out));
  }
}

template <typename T, typename Out>
void MeanRow(const std::array<const char*, 4>& rows, std::size_t count, char* out) {
  for (std::size_t first = 0; first < count; first += kRunSamples) {
    MeanRun<T, Out>(rows, first, std::min(kRunSamples, count - first), out);
  }
}

template <typename T>
void MajorityRow(const std::array<const char*, 4>& rows, std::size_t count, char* out) {
  for (std::size_t i = 0; i < count; ++i) {
    const T majority = Majority(LoadEight<T>(rows, i));
    std::memcpy(out + i * sizeof(T), &majority, sizeof(T));
  }
}

}  // namespace

absl::string_view NameOf(LevelFilter filter) {
  return filter == LevelFilter::kMean ? "mean" : "majority";
}

absl::StatusOr<LevelFilter> LevelFilterFromName(absl::string_view name) {
  for (const LevelFilter filter : {LevelFilter::kMean, LevelFilter::kMajority}) {
    if (name == NameOf(filter)) {
      return filter;
    }
  }
  return absl::InvalidArgumentError(
      absl::StrCat("level filter \"", name, "\": expected mean or majority"));
}

bool CanFilter(LevelFilter filter, ScalarType type) {
  return filter == LevelFilter::kMean ||
         (type != ScalarType::kFloat32 && type != ScalarType::kFloat64);
}

math::Index3 LevelDims(const math::Index3& sample_dims, int level) {
  return {sample_dims.x >> level, sample_dims.y >> level, sample_dims.z >> level};
}

int HighestLevel(const math::Index3& sample_dims) {
  const std::int64_t shortest = std::min({sample_dims.x, sample_dims.y, sample_dims.z});
  int level = 0;
  while (level < kMaxLevel && shortest >> (level + 1) >= 2) {
    ++level;
  }
  return level;
}

int AutoHighestLevel(const math::Index3& sample_dims) {
  if (SampleCount(sample_dims) < kAutoSamples) {
    return 0;
  }
  int level = 0;
  const int highest = HighestLevel(sample_dims);
  while (level < highest) {
    const math::Index3 next = LevelDims(sample_dims, level + 1);
    if (SampleCount(next) <= kCoarsestSamples ||
        std::min({next.x, next.y, next.z}) < kMinAutoEdge) {
      break;
    }
    ++level;
  }
  return level;
}

ScalarType LevelType(ScalarType type, LevelFilter filter) {
  if (filter == LevelFilter::kMean && IsByte(type)) {
    return type == ScalarType::kUint8 ? ScalarType::kUint16 : ScalarType::kInt16;
  }
  return type;
}

double LevelValueScale(ScalarType type, LevelFilter filter) {
  return filter == LevelFilter::kMean && IsByte(type) ? kByteScale : 1;
}

VolumeLevel LevelOf(const GridGeometry& grid, ScalarType type, LevelFilter filter, int level) {
  ISOSCOPE_DCHECK(level >= 0 && level <= HighestLevel(grid.sample_dims));
  VolumeLevel result{.index = level, .grid = grid, .type = type};
  if (level == 0) {
    return result;
  }
  const double step = std::ldexp(1.0, level);
  const double offset = (step - 1) / 2;  // of the first sample, in samples of level 0
  result.grid.sample_dims = LevelDims(grid.sample_dims, level);
  result.grid.spacing = grid.spacing * step;
  result.grid.origin = math::TransformPoint(grid.world_from_index(), {offset, offset, offset});
  result.type = LevelType(type, filter);
  result.value_scale = LevelValueScale(type, filter);
  return result;
}

void ReduceRows(ScalarType type, ScalarType out_type, LevelFilter filter,
                const std::array<const char*, 4>& rows, std::size_t count, char* out) {
  VisitScalarType(type, [&]<typename T>() {
    if constexpr (std::is_integral_v<T>) {
      if (filter == LevelFilter::kMajority) {
        ISOSCOPE_DCHECK(out_type == type);
        return MajorityRow<T>(rows, count, out);
      }
    }
    ISOSCOPE_DCHECK(filter == LevelFilter::kMean);
    if constexpr (sizeof(T) == 1) {
      using Wide = std::conditional_t<std::is_signed_v<T>, std::int16_t, std::uint16_t>;
      ISOSCOPE_DCHECK(out_type == LevelType(type, filter));
      MeanRow<T, Wide>(rows, count, out);
    } else {
      ISOSCOPE_DCHECK(out_type == type);
      MeanRow<T, T>(rows, count, out);
    }
  });
}

}  // namespace isoscope::volume
