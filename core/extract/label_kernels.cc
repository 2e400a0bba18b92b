// Marks are bytes, 0 or 1. To compare samples of any type, 64 at a time are packed to a word of
// bits, as for isovalues, and the word is spread to bytes.
//
// The Sobel filter is separable: each of its components is a filter of three samples along x, then
// along y, then along z, each either a difference, -1 0 1, or a mean, 1 2 1. All fit into a byte:
//
//             along x              along y                     along z
//   marks --> difference [-1, 1] --> mean       [-4, 4]   --> mean        x component
//         \-> mean       [0, 4]  --> difference [-4, 4]   --> mean        y component
//                               \-> mean        [0, 16]   --> difference  z component
//
// A whole line is filtered at once: neighbours are at a fixed distance, and what comes of the end
// of one row and the start of the next belongs to samples without neighbours on all sides. Example:
// a wall, inside iff x >= 3, has the x component 16 at x = 2 and at x = 3, and 0 elsewhere.

#include "core/extract/label_kernels.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <limits>
#include <type_traits>

#include "core/extract/bit_row.h"
#include "core/extract/vertex_batch.h"

// As block_kernels.cc, with whose parts it is compiled.
#define HWY_WANT_AVX3_DL
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/extract/label_kernels.cc"
#include "hwy/foreach_target.h"  // IWYU pragma: keep
#include "hwy/highway.h"
// After foreach_target.h: included once for each instruction set, like this file.
#include "core/extract/edge_crossings-inl.h"
#include "core/extract/gradient_normal-inl.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::extract {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// Writes 64 bits as 64 bytes.
inline void SpreadWord(std::uint64_t word, std::uint8_t* out) {
  const hn::CappedTag<std::uint8_t, 64> d;
  const std::size_t lanes = hn::Lanes(d);
  if (lanes < 8) {
    for (std::size_t i = 0; i < 64; ++i) {
      out[i] = word >> i & 1;
    }
    return;
  }
  std::array<std::uint8_t, 16> bits{};  // LoadMaskBits reads 8 bytes
  std::memcpy(bits.data(), &word, sizeof(word));
  const auto one = hn::Set(d, 1);
  for (std::size_t i = 0; i < 64; i += lanes) {
    hn::StoreU(hn::IfThenElseZero(hn::LoadMaskBits(d, bits.data() + i / 8), one), d, out + i);
  }
}

// Writes predicate(register of samples) as bytes, and returns the number of those that are set.
template <typename T, typename Predicate>
std::size_t MarkSamples(const char* bytes, std::size_t count, const Predicate& predicate,
                        std::uint8_t* marks) {
  std::size_t set_count = 0;
  for (std::size_t begin = 0; begin < count; begin += 64) {
    std::uint64_t word = 0;
    if (begin + 64 <= count) {
      PackWord<T>(bytes + begin * sizeof(T), predicate, &word);
    } else {
      std::array<char, 64 * sizeof(T)> last{};
      std::memcpy(last.data(), bytes + begin * sizeof(T), (count - begin) * sizeof(T));
      PackWord<T>(last.data(), predicate, &word);
      word &= ~std::uint64_t{0} >> (64 - (count - begin));
    }
    set_count += static_cast<std::size_t>(std::popcount(word));
    SpreadWord(word, marks + begin);
  }
  return set_count;
}

template <typename T>
void MarkLabelsOfType(const LabelSet& labels, const char* bytes, std::size_t count,
                      std::uint8_t* marks) {
  const SampleTag<T> d;
  const auto is_in = [&](const LabelSet::Interval& interval, auto samples) {
    const auto first = hn::Set(d, static_cast<T>(interval.first));
    const auto last = hn::Set(d, static_cast<T>(interval.last));
    if constexpr (std::is_floating_point_v<T>) {
      return hn::Eq(samples, first);
    } else {
      return hn::Not(hn::Or(hn::Lt(samples, first), hn::Lt(last, samples)));
    }
  };
  if (labels.intervals.empty()) {
    std::fill_n(marks, count, std::uint8_t{0});
    return;
  }
  MarkSamples<T>(
      bytes, count,
      [&](auto samples) {
        auto found = is_in(labels.intervals[0], samples);
        for (std::size_t i = 1; i < labels.intervals.size(); ++i) {
          found = hn::Or(found, is_in(labels.intervals[i], samples));
        }
        return found;
      },
      marks);
}

void MarkLabelsByComparison(const LabelSet& labels, const char* bytes, std::size_t count,
                            std::uint8_t* marks) {
  volume::VisitScalarType(labels.type,
                          [&]<typename T>() { MarkLabelsOfType<T>(labels, bytes, count, marks); });
}

bool MarkNumbersOfType(volume::ScalarType type, const char* bytes, std::size_t count,
                       std::uint8_t* marks) {
  return volume::VisitScalarType(type, [&]<typename T>() {
    if constexpr (std::is_floating_point_v<T>) {
      return MarkSamples<T>(
                 bytes, count, [](auto samples) { return hn::Eq(samples, samples); }, marks) <
             count;
    } else {
      return false;
    }
  });
}

// The steps of the filter. Lines have `slice` and a register of elements before and after them.
void FillSobelLines(const std::uint8_t* marks, std::size_t row, std::size_t slice,
                    std::size_t count, const std::array<std::int8_t*, 5>& lines,
                    std::uint32_t* sobel) {
  const hn::CappedTag<std::int8_t, kMarkPadding> d;
  const hn::CappedTag<std::uint8_t, kMarkPadding> du;
  const auto load = [&](const std::int8_t* at) { return hn::LoadU(d, at); };
  const auto difference = [&](const std::int8_t* at, std::size_t step) {
    return hn::Sub(load(at + step), load(at - step));
  };
  const auto mean = [&](const std::int8_t* at, std::size_t step) {
    const auto center = load(at);
    return hn::Add(hn::Add(load(at - step), load(at + step)), hn::Add(center, center));
  };
  const auto& [x_difference, x_mean, xy_difference, xy_mean_of_difference, xy_mean] = lines;
  const auto* in = reinterpret_cast<const std::int8_t*>(marks);
  // The first and the last mark lack a neighbour: their results are never used.
  for (std::size_t i = 1; i + 1 < count; i += hn::Lanes(d)) {
    hn::StoreU(difference(in + i, 1), d, x_difference + i);
    hn::StoreU(mean(in + i, 1), d, x_mean + i);
  }
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    hn::StoreU(mean(x_difference + i, row), d, xy_mean_of_difference + i);
    hn::StoreU(difference(x_mean + i, row), d, xy_difference + i);
    hn::StoreU(mean(x_mean + i, row), d, xy_mean + i);
  }
  const auto zero = hn::Set(d, static_cast<std::int8_t>(kSobelZero));
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    hn::StoreInterleaved4(hn::BitCast(du, hn::Add(mean(xy_mean_of_difference + i, slice), zero)),
                          hn::BitCast(du, hn::Add(mean(xy_difference + i, slice), zero)),
                          hn::BitCast(du, hn::Add(difference(xy_mean + i, slice), zero)),
                          hn::Zero(du), du, reinterpret_cast<std::uint8_t*>(sobel + i));
  }
}

// The sums of a batch, taken apart and normalised.
void FillNormalsOfVertices(const LabelVertices& vertices, const math::Mat3d& to_world,
                           math::Vec3f* normals) {
  const DoubleTag d;
  const FloatHalfTag df;
  const IntHalfTag di;
  const hn::CappedTag<float, 64> whole;
  const auto center = hn::Set(di, 2 * static_cast<std::int32_t>(kSobelZero));
  const auto byte = hn::Set(di, 255);
  constexpr std::uint32_t kNoGradient = 2 * kSobelZero * 0x010101;
  const std::uint32_t along_axis = 1U << 8 * vertices.axis;
  alignas(64) std::array<std::int32_t, kBatch> sums;
  alignas(64) std::array<std::array<float, kBatch>, 3> batch;
  sums.fill(static_cast<std::int32_t>(kNoGradient));
  for (std::size_t begin = 0; begin < vertices.count; begin += kBatch) {
    const std::size_t count = std::min(kBatch, vertices.count - begin);
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t lower = vertices.lower_samples[begin + i];
      std::uint32_t sum = vertices.sobel[lower] + vertices.sobel[lower + vertices.upper_distance];
      if (sum == kNoGradient) {
        sum = vertices.marks[lower] != 0 ? sum - along_axis : sum + along_axis;
      }
      sums[i] = static_cast<std::int32_t>(sum);
    }
    for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
      const auto sum = hn::Load(di, sums.data() + i);
      const auto component = [&](auto shifted) {
        return hn::PromoteTo(d, hn::Sub(hn::And(shifted, byte), center));
      };
      const GradientNormal normal = NormalOf(
          {component(sum), component(hn::ShiftRight<8>(sum)), component(hn::ShiftRight<16>(sum))},
          to_world);
      for (std::size_t k = 0; k < 3; ++k) {
        hn::Store(hn::DemoteTo(df, normal.components[k]), df, batch[k].data() + i);
      }
    }
    for (std::size_t i = 0; i < count; i += hn::Lanes(whole)) {
      hn::StoreInterleaved3(hn::Load(whole, batch[0].data() + i),
                            hn::Load(whole, batch[1].data() + i),
                            hn::Load(whole, batch[2].data() + i), whole, &normals[begin + i].x);
    }
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace isoscope::extract
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isoscope::extract {
namespace {

HWY_EXPORT(MarkLabelsByComparison);
HWY_EXPORT(MarkNumbersOfType);
HWY_EXPORT(FillSobelLines);
HWY_EXPORT(FillNormalsOfVertices);

// From here on a look-up is faster than comparisons, for 16-bit samples with registers of 256 bits.
constexpr std::size_t kMostComparisons = 16;

template <typename T>
bool IsSample(double label) {
  if constexpr (std::is_same_v<T, double>) {
    return true;
  } else {
    return label >= static_cast<double>(std::numeric_limits<T>::lowest()) &&
           label <= static_cast<double>(std::numeric_limits<T>::max()) &&
           static_cast<double>(static_cast<T>(label)) == label;
  }
}

}  // namespace

LabelSet MakeLabelSet(volume::ScalarType type, std::span<const double> labels) {
  LabelSet set{.type = type, .intervals = {}, .table = {}};
  volume::VisitScalarType(type, [&]<typename T>() {
    for (const double label : labels) {
      if (!IsSample<T>(label)) {
        continue;
      }
      if (std::is_integral_v<T> && !set.intervals.empty() &&
          set.intervals.back().last + 1 == label) {
        set.intervals.back().last = label;
      } else {
        set.intervals.push_back({label, label});
      }
    }
    if constexpr (std::is_integral_v<T> && sizeof(T) <= 2) {
      if (set.intervals.size() > kMostComparisons) {
        set.table.resize(std::size_t{1} << 8 * sizeof(T));
        for (const LabelSet::Interval& interval : set.intervals) {
          for (double label = interval.first; label <= interval.last; ++label) {
            set.table[static_cast<std::make_unsigned_t<T>>(static_cast<T>(label))] = 1;
          }
        }
      }
    }
  });
  return set;
}

void MarkLabels(const LabelSet& labels, const char* bytes, std::size_t count, std::uint8_t* marks) {
  if (labels.table.empty()) {
    HWY_DYNAMIC_DISPATCH(MarkLabelsByComparison)(labels, bytes, count, marks);
  } else if (volume::SizeOf(labels.type) == 1) {
    for (std::size_t i = 0; i < count; ++i) {
      marks[i] = labels.table[LoadSample<std::uint8_t>(bytes, i)];
    }
  } else {
    for (std::size_t i = 0; i < count; ++i) {
      marks[i] = labels.table[LoadSample<std::uint16_t>(bytes, i)];
    }
  }
}

bool MarkNumbers(volume::ScalarType type, const char* bytes, std::size_t count,
                 std::uint8_t* marks) {
  return HWY_DYNAMIC_DISPATCH(MarkNumbersOfType)(type, bytes, count, marks);
}

void FillSobel(const std::uint8_t* marks, std::size_t row, std::size_t slice, std::size_t count,
               SobelScratch* scratch, std::uint32_t* sobel) {
  const std::size_t padding = slice + kMarkPadding;
  std::array<std::int8_t*, 5> lines{};
  for (std::size_t i = 0; i < lines.size(); ++i) {
    Grow(count + 2 * padding, &scratch->lines[i]);
    lines[i] = scratch->lines[i].data() + padding;
  }
  HWY_DYNAMIC_DISPATCH(FillSobelLines)(marks, row, slice, count, lines, sobel);
}

void FillLabelNormals(const LabelVertices& vertices, const math::Mat3d& to_world,
                      math::Vec3f* normals) {
  HWY_DYNAMIC_DISPATCH(FillNormalsOfVertices)(vertices, to_world, normals);
}

}  // namespace isoscope::extract
#endif  // HWY_ONCE
