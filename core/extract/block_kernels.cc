#include "core/extract/block_kernels.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>

#include "core/volume/scalar_span.h"

// Ice Lake and Zen 4 onwards have their own target: they can list the set bits of a word at once.
#define HWY_WANT_AVX3_DL
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/extract/block_kernels.cc"
#include "hwy/foreach_target.h"  // IWYU pragma: keep
#include "hwy/highway.h"

// What no instruction set changes; the file is compiled once for each of them.
#ifndef ISOSCOPE_CORE_EXTRACT_BLOCK_KERNELS_ONCE_
#define ISOSCOPE_CORE_EXTRACT_BLOCK_KERNELS_ONCE_

namespace isoscope::extract {
namespace {

using math::Vec3d;

template <typename T>
T LoadSample(const char* bytes, std::size_t index) {
  T value;
  std::memcpy(&value, bytes + index * sizeof(T), sizeof(T));
  return value;
}

// What the differences of two samples are kept as: exact for integers, double for the others.
template <typename T>
using Difference =
    std::conditional_t<std::is_integral_v<T> && sizeof(T) <= 2, std::int32_t, double>;

template <typename T>
Difference<T> Subtract(T a, T b) {
  return static_cast<Difference<T>>(a) - static_cast<Difference<T>>(b);
}

// Vertices on edges of one axis on their way from samples to positions and normals: whole registers
// of them, up to this many.
constexpr std::size_t kBatch = 128;

template <typename D>
struct VertexBatch {
  // t = numerator / denominator.
  alignas(64) std::array<double, kBatch> numerators;
  alignas(64) std::array<double, kBatch> denominators;
  // Twice the gradient in index space at the edge's lower and upper sample.
  alignas(64) std::array<std::array<D, kBatch>, 3> lower_gradients;
  alignas(64) std::array<std::array<D, kBatch>, 3> upper_gradients;
  alignas(64) std::array<std::array<float, kBatch>, 3> positions;
  alignas(64) std::array<std::array<float, kBatch>, 3> normals;
};

// By axis: samples from one to the next, and how many there are.
struct Strides {
  std::array<std::size_t, 3> samples;
  std::array<std::size_t, 3> dims;
};

// Twice the gradient component along `axis` at `sample`: the central difference, or the one-sided
// one where a neighbour is missing or not finite, or 0.
template <typename T>
Difference<T> CarefulGradient(const char* bytes, const Strides& grid, std::size_t sample,
                              std::size_t axis) {
  const std::size_t stride = grid.samples[axis];
  const std::size_t coordinate = sample / stride % grid.dims[axis];
  const T center = LoadSample<T>(bytes, sample);
  T lower = center;
  T upper = center;
  bool has_lower = coordinate > 0;
  bool has_upper = coordinate + 1 < grid.dims[axis];
  if (has_lower) {
    lower = LoadSample<T>(bytes, sample - stride);
  }
  if (has_upper) {
    upper = LoadSample<T>(bytes, sample + stride);
  }
  if constexpr (std::is_floating_point_v<T>) {
    has_lower = has_lower && std::isfinite(lower);
    has_upper = has_upper && std::isfinite(upper);
    if (!(has_lower && has_upper) && !std::isfinite(center)) {
      return 0;
    }
  }
  if (has_lower && has_upper) {
    return Subtract<T>(upper, lower);
  }
  if (has_upper) {
    return 2 * Subtract<T>(upper, center);
  }
  return has_lower ? 2 * Subtract<T>(center, lower) : Difference<T>{0};
}

struct Fraction {
  double numerator = 0;
  double denominator = 1;
};

// t of a crossed edge, for samples that may be infinite or overflow when subtracted: the limits.
inline Fraction CarefulFraction(double lower, double upper, double isovalue) {
  if (std::isinf(lower)) {
    return std::isinf(upper) ? Fraction{1, 2} : Fraction{1, 1};
  }
  if (std::isinf(upper)) {
    return {0, 1};
  }
  const double denominator = upper - lower;
  if (std::isinf(denominator)) {
    return {isovalue / 2 - lower / 2, upper / 2 - lower / 2};
  }
  return {isovalue - lower, denominator};
}

// Puts vertex `i`, on the edge along `axis` from sample `lower`, into the batch, with all checks.
template <typename T>
void GatherCarefully(const char* bytes, const Strides& grid, std::size_t axis, double isovalue,
                     std::size_t lower, std::size_t i, VertexBatch<Difference<T>>* batch) {
  const std::size_t upper = lower + grid.samples[axis];
  const Fraction t = CarefulFraction(static_cast<double>(LoadSample<T>(bytes, lower)),
                                     static_cast<double>(LoadSample<T>(bytes, upper)), isovalue);
  batch->numerators[i] = t.numerator;
  batch->denominators[i] = t.denominator;
  for (std::size_t k = 0; k < 3; ++k) {
    batch->lower_gradients[k][i] = CarefulGradient<T>(bytes, grid, lower, k);
    batch->upper_gradients[k][i] = CarefulGradient<T>(bytes, grid, upper, k);
  }
}

// The same in a block without extreme samples.
template <typename T>
void GatherAtBorder(const char* bytes, const Strides& grid, std::size_t axis, double isovalue,
                    std::uint32_t lower, std::size_t i, VertexBatch<Difference<T>>* batch) {
  const std::size_t upper = lower + grid.samples[axis];
  const auto a = static_cast<double>(LoadSample<T>(bytes, lower));
  const auto b = static_cast<double>(LoadSample<T>(bytes, upper));
  batch->numerators[i] = isovalue - a;
  batch->denominators[i] = b - a;
  const auto row = static_cast<std::uint32_t>(grid.samples[1]);
  const auto slice = static_cast<std::uint32_t>(grid.samples[2]);
  std::array<std::size_t, 3> at{lower % slice % row, lower % slice / row, lower / slice};
  // What CarefulGradient computes, without branches.
  const auto gradient = [&](std::size_t sample, std::size_t k) {
    const bool has_lower = at[k] > 0;
    const bool has_upper = at[k] + 1 < grid.dims[k];
    const std::size_t before = sample - (has_lower ? grid.samples[k] : 0);
    const std::size_t after = sample + (has_upper ? grid.samples[k] : 0);
    const Difference<T> difference =
        Subtract<T>(LoadSample<T>(bytes, after), LoadSample<T>(bytes, before));
    return difference * Difference<T>{has_lower && has_upper ? 1 : 2};
  };
  for (std::size_t k = 0; k < 3; ++k) {
    batch->lower_gradients[k][i] = gradient(lower, k);
  }
  ++at[axis];
  for (std::size_t k = 0; k < 3; ++k) {
    batch->upper_gradients[k][i] = gradient(upper, k);
  }
}

// The same for an interior edge in a block without extreme samples.
template <typename T>
void GatherPlainly(const char* bytes, const Strides& grid, std::size_t axis, double isovalue,
                   std::size_t lower, std::size_t i, VertexBatch<Difference<T>>* batch) {
  const std::size_t upper = lower + grid.samples[axis];
  const auto a = static_cast<double>(LoadSample<T>(bytes, lower));
  const auto b = static_cast<double>(LoadSample<T>(bytes, upper));
  batch->numerators[i] = isovalue - a;
  batch->denominators[i] = b - a;
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t step = grid.samples[k];
    batch->lower_gradients[k][i] =
        Subtract<T>(LoadSample<T>(bytes, lower + step), LoadSample<T>(bytes, lower - step));
    batch->upper_gradients[k][i] =
        Subtract<T>(LoadSample<T>(bytes, upper + step), LoadSample<T>(bytes, upper - step));
  }
}

// Which vertices need the checks of GatherCarefully.
enum class Care {
  kNone,    // no sample is extreme and the block has ghosts all around
  kBorder,  // no sample is extreme; only edges that are not interior lack neighbours
  kFull,
};

template <typename T, Care kCare>
void GatherVertices(const char* bytes, const Strides& grid, const BitRow& interior,
                    std::size_t axis, double isovalue, const std::uint32_t* samples,
                    std::size_t count, VertexBatch<Difference<T>>* batch) {
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint32_t lower = samples[i];
    if constexpr (kCare == Care::kFull) {
      GatherCarefully<T>(bytes, grid, axis, isovalue, lower, i, batch);
    } else if (kCare == Care::kBorder && (interior[lower / 64] >> lower % 64 & 1) == 0) {
      GatherAtBorder<T>(bytes, grid, axis, isovalue, lower, i, batch);
    } else {
      GatherPlainly<T>(bytes, grid, axis, isovalue, lower, i, batch);
    }
  }
}

template <typename V>
void Grow(std::size_t size, std::vector<V>* vector) {
  if (vector->size() < size) {
    vector->resize(size);
  }
}

// 57 or more bits of `bits`, the lowest one being bit `position`.
inline std::uint64_t LoadBits(const std::uint64_t* bits, std::size_t position) {
  std::uint64_t word;
  std::memcpy(&word, reinterpret_cast<const char*>(bits) + position / 8, sizeof(word));
  return word >> position % 8;
}

inline std::size_t CountBits(const std::uint64_t* bits, std::size_t words) {
  std::size_t count = 0;
  for (std::size_t i = 0; i < words; ++i) {
    count += static_cast<std::size_t>(std::popcount(bits[i]));
  }
  return count;
}

}  // namespace
}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_BLOCK_KERNELS_ONCE_

HWY_BEFORE_NAMESPACE();
namespace isoscope::extract {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// ListBits writes up to this many elements past the end; whole registers may be read there.
constexpr std::size_t kListPadding = 64;

// Writes the positions of the set bits of `words` words, ascending; returns how many there are.
inline std::size_t ListBits(const std::uint64_t* bits, std::size_t words, std::uint32_t* out) {
  const std::uint32_t* const begin = out;
#if HWY_TARGET <= HWY_AVX3_DL && HWY_ARCH_X86
  const hn::FixedTag<std::uint32_t, 16> d;
  const hn::FixedTag<std::uint8_t, 64> du8;
  const auto ascending = hn::Iota(du8, 0);
  auto first = hn::Zero(d);
  const auto step = hn::Set(d, 64);
  for (std::size_t i = 0; i < words; ++i) {
    const auto count = static_cast<std::size_t>(std::popcount(bits[i]));
    const __m512i listed = _mm512_maskz_compress_epi8(bits[i], ascending.raw);
    const auto put = [&](std::size_t at, __m128i sixteen) {
      hn::StoreU(hn::Add(hn::Vec<decltype(d)>{_mm512_cvtepu8_epi32(sixteen)}, first), d, out + at);
    };
    put(0, _mm512_castsi512_si128(listed));
    if (count > 16) {
      put(16, _mm512_extracti32x4_epi32(listed, 1));
      put(32, _mm512_extracti32x4_epi32(listed, 2));
      put(48, _mm512_extracti32x4_epi32(listed, 3));
    }
    out += count;
    first = hn::Add(first, step);
  }
#else
  for (std::size_t i = 0; i < words; ++i) {
    std::uint64_t rest = bits[i];
    const auto first = static_cast<std::uint32_t>(64 * i);
    const int count = std::popcount(rest);
    // By eights, whatever the count: branches that depend on it are hard to predict.
    std::uint32_t* at = out;
    do {
      for (int k = 0; k < 8; ++k) {
        at[k] = first + static_cast<std::uint32_t>(std::countr_zero(rest));
        rest &= rest - 1;
      }
      at += 8;
    } while (rest != 0);
    out += count;
  }
#endif
  return static_cast<std::size_t>(out - begin);
}

// Samples of a register, at most 64 of them: a register's mask fits a word.
template <typename T>
using SampleTag = hn::CappedTag<T, 64 / sizeof(T)>;

template <typename T>
hn::Vec<SampleTag<T>> LoadSamples(const char* bytes) {
  const SampleTag<T> d;
#if HWY_TARGET == HWY_SCALAR
  return hn::Set(d, LoadSample<T>(bytes, 0));
#else
  const hn::Repartition<std::uint8_t, SampleTag<T>> du8;
  return hn::BitCast(d, hn::LoadU(du8, reinterpret_cast<const std::uint8_t*>(bytes)));
#endif
}

// The bits of predicate(register of samples) for 64 samples.
template <typename T, typename Predicate>
void PackWord(const char* bytes, const Predicate& predicate, std::uint64_t* word) {
  const SampleTag<T> d;
  const std::size_t lanes = hn::Lanes(d);
  std::array<std::uint8_t, 64> packed;
  if (lanes >= 8) {
    for (std::size_t i = 0; i < 64; i += lanes) {
      hn::StoreMaskBits(d, predicate(LoadSamples<T>(bytes + i * sizeof(T))), packed.data() + i / 8);
    }
  } else {
    for (std::size_t i = 0; i < 64; i += 8) {
      std::uint8_t eight = 0;
      for (std::size_t k = 0; k < 8; k += lanes) {
        std::array<std::uint8_t, 8> some;
        hn::StoreMaskBits(d, predicate(LoadSamples<T>(bytes + (i + k) * sizeof(T))), some.data());
        eight = static_cast<std::uint8_t>(eight | some[0] << k);
      }
      packed[i / 8] = eight;
    }
  }
  std::memcpy(word, packed.data(), sizeof(*word));
}

// Sets bit i of `bits` iff predicate(sample i), for `count` samples; the rest of the last word is
// as for samples that are 0.
template <typename T, typename Predicate>
void ClassifySamples(const char* bytes, std::size_t count, const Predicate& predicate,
                     std::uint64_t* bits) {
  std::size_t word = 0;
  for (; (word + 1) * 64 <= count; ++word) {
    PackWord<T>(bytes + word * 64 * sizeof(T), predicate, bits + word);
  }
  if (word * 64 < count) {
    std::array<char, 64 * sizeof(T)> last{};
    std::memcpy(last.data(), bytes + word * 64 * sizeof(T), (count - word * 64) * sizeof(T));
    PackWord<T>(last.data(), predicate, bits + word);
  }
}

// Sets the bits of the samples that are inside.
template <typename T>
void ClassifyInside(const char* bytes, std::size_t count, T threshold, std::uint64_t* bits) {
  const auto limit = hn::Set(SampleTag<T>(), threshold);
  if constexpr (std::is_floating_point_v<T>) {
    ClassifySamples<T>(
        bytes, count, [&](auto samples) { return hn::Ge(samples, limit); }, bits);
  } else {
    ClassifySamples<T>(
        bytes, count, [&](auto samples) { return hn::Not(hn::Lt(samples, limit)); }, bits);
  }
}

// True iff plain differences of these samples can overflow or are not finite: some sample is NaN,
// infinite or, for doubles, at least 2^1022.
template <typename T>
bool HasExtremeSamples(const char* bytes, std::size_t count) {
  if constexpr (std::is_floating_point_v<T>) {
    const SampleTag<T> d;
    const std::size_t lanes = hn::Lanes(d);
    const auto limit = hn::Set(d, std::is_same_v<T, float> ? std::numeric_limits<T>::infinity()
                                                           : static_cast<T>(0x1.0p1022));
    // False for NaN.
    const auto is_plain = [&](auto samples) { return hn::Lt(hn::Abs(samples), limit); };
    auto all_plain = is_plain(hn::Zero(d));
    std::size_t i = 0;
    for (; i + lanes <= count; i += lanes) {
      all_plain = hn::And(all_plain, is_plain(LoadSamples<T>(bytes + i * sizeof(T))));
    }
    std::array<char, 64> last{};
    std::memcpy(last.data(), bytes + i * sizeof(T), (count - i) * sizeof(T));
    all_plain = hn::And(all_plain, is_plain(LoadSamples<T>(last.data())));
    return !hn::AllTrue(d, all_plain);
  } else {
    return false;
  }
}

using WordTag = hn::CappedTag<std::uint64_t, kWordGroup>;

// Bits [64 word + offset, 64 word + offset + 64) for a register of words.
class ShiftedBits {
 public:
  explicit ShiftedBits(std::size_t offset)
      : words_(offset / 64), right_(static_cast<int>(offset % 64)), left_(63 - right_) {}

  hn::Vec<WordTag> operator()(const std::uint64_t* bits) const {
    const WordTag d;
    const auto low = hn::LoadU(d, bits + words_);
    const auto high = hn::LoadU(d, bits + words_ + 1);
    return hn::Or(hn::ShiftRightSame(low, right_), hn::ShiftLeftSame(hn::Add(high, high), left_));
  }

 private:
  std::size_t words_;
  int right_;
  int left_;
};

// Removes from `crossed` the edges that no valid cell of the block touches.
void DropEdgesWithoutCells(const BlockShape& shape, BlockScratch* scratch) {
  const std::uint64_t* cells = scratch->valid_cells.data() + scratch->padding;
  std::fill_n(scratch->valid_cells.begin(), scratch->padding, 0);
  // Bits [64 word - offset, 64 word - offset + 64).
  const auto back = [&](std::size_t word, std::size_t offset) {
    const std::uint64_t* at = cells + word - offset / 64;
    const std::size_t shift = offset % 64;
    return at[0] << shift | at[-1] >> 1 >> (63 - shift);
  };
  const std::array<std::size_t, 3> strides{1, shape.row, shape.slice};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::size_t u = strides[(axis + 1) % 3];
    const std::size_t v = strides[(axis + 2) % 3];
    for (std::size_t i = 0; i < shape.word_count; ++i) {
      scratch->crossed[axis][i] &= cells[i] | back(i, u) | back(i, v) | back(i, u + v);
    }
  }
}

// Fills crossed, active_cells and owned_vertex_count.
template <bool kHasNan>
void FindCrossings(const BlockShape& shape, BlockScratch* scratch) {
  const WordTag d;
  const std::uint64_t* inside = scratch->inside.data() + scratch->padding;
  const std::uint64_t* valid = scratch->valid.data() + scratch->padding;
  std::uint64_t* valid_cells = scratch->valid_cells.data() + scratch->padding;
  const std::size_t row = shape.row;
  const std::size_t slice = shape.slice;
  const ShiftedBits x(1);
  const ShiftedBits y(row);
  const ShiftedBits xy(row + 1);
  const ShiftedBits z(slice);
  const ShiftedBits xz(slice + 1);
  const ShiftedBits yz(slice + row);
  const ShiftedBits xyz(slice + row + 1);
  for (std::size_t i = 0; i < shape.word_count; i += hn::Lanes(d)) {
    const auto mask = [&](const BitRow& bits) { return hn::LoadU(d, bits.data() + i); };
    const std::uint64_t* in = inside + i;
    const auto c0 = hn::LoadU(d, in);
    const auto cx = x(in);
    const auto cy = y(in);
    const auto cz = z(in);
    auto any = hn::Or(hn::Or(c0, cx), hn::Or(cy, cz));
    auto all = hn::And(hn::And(c0, cx), hn::And(cy, cz));
    for (const ShiftedBits* shifted : {&xy, &xz, &yz, &xyz}) {
      const auto corner = (*shifted)(in);
      any = hn::Or(any, corner);
      all = hn::And(all, corner);
    }
    auto cells = mask(shape.cells);
    auto x_edges = hn::And(hn::Xor(c0, cx), mask(shape.edges[0]));
    auto y_edges = hn::And(hn::Xor(c0, cy), mask(shape.edges[1]));
    auto z_edges = hn::And(hn::Xor(c0, cz), mask(shape.edges[2]));
    if constexpr (kHasNan) {
      const std::uint64_t* numbers = valid + i;
      const auto v0 = hn::LoadU(d, numbers);
      const auto vx = hn::And(v0, x(numbers));
      const auto vy = hn::And(v0, y(numbers));
      const auto vz = hn::And(v0, z(numbers));
      cells = hn::And(hn::And(cells, vx), hn::And(vy, vz));
      for (const ShiftedBits* shifted : {&xy, &xz, &yz, &xyz}) {
        cells = hn::And(cells, (*shifted)(numbers));
      }
      hn::StoreU(cells, d, valid_cells + i);
      x_edges = hn::And(x_edges, vx);
      y_edges = hn::And(y_edges, vy);
      z_edges = hn::And(z_edges, vz);
    }
    hn::StoreU(x_edges, d, scratch->crossed[0].data() + i);
    hn::StoreU(y_edges, d, scratch->crossed[1].data() + i);
    hn::StoreU(z_edges, d, scratch->crossed[2].data() + i);
    hn::StoreU(hn::And(hn::AndNot(all, any), cells), d, scratch->active_cells.data() + i);
  }
  std::int64_t owned = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (std::size_t i = 0; i < shape.word_count; ++i) {
      owned += std::popcount(scratch->crossed[axis][i] & shape.owned_edges[axis][i]);
    }
  }
  scratch->owned_vertex_count = owned;
  if constexpr (kHasNan) {
    DropEdgesWithoutCells(shape, scratch);
  }
}

// Fills edge_samples, vertex_ids and vertex_count. Lists are filled up with a copy of their last
// sample to whole registers.
void NumberVertices(const BlockShape& shape, BlockScratch* scratch) {
  std::size_t number = 0;
  std::uint32_t* ids = scratch->vertex_ids.data();
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::uint64_t* crossed = scratch->crossed[axis].data();
    std::vector<std::uint32_t>& list = scratch->edge_samples[axis];
    Grow(CountBits(crossed, shape.word_count) + kListPadding, &list);
    const std::size_t count = ListBits(crossed, shape.word_count, list.data());
    for (std::size_t i = 0; i < count; ++i) {
      ids[4 * std::size_t{list[i]} + axis] = static_cast<std::uint32_t>(number + i);
    }
    if (count > 0) {
      std::fill_n(list.begin() + static_cast<std::ptrdiff_t>(count), kListPadding, list[count - 1]);
    }
    scratch->edge_counts[axis] = count;
    number += count;
  }
  scratch->vertex_count = number;
}

using DoubleTag = hn::ScalableTag<double>;
using DoubleVec = hn::Vec<DoubleTag>;
using FloatHalfTag = hn::Rebind<float, DoubleTag>;
using IntHalfTag = hn::Rebind<std::int32_t, DoubleTag>;

// As many doubles as a register holds.
inline DoubleVec LoadDoubles(const double* from) { return hn::Load(DoubleTag(), from); }
inline DoubleVec LoadDoubles(const std::int32_t* from) {
  return hn::PromoteTo(DoubleTag(), hn::Load(IntHalfTag(), from));
}

#if HWY_TARGET <= HWY_AVX2 && HWY_ARCH_X86
#define ISOSCOPE_EXTRACT_HAS_GATHER 1
#else
#define ISOSCOPE_EXTRACT_HAS_GATHER 0
#endif

#if ISOSCOPE_EXTRACT_HAS_GATHER
// Sample kIndex of those in a register of 32-bit lanes, lowest first.
template <typename T, int kIndex>
hn::Vec<hn::ScalableTag<std::int32_t>> SampleOfLane(hn::Vec<hn::ScalableTag<std::int32_t>> lanes) {
  constexpr int kBits = 8 * static_cast<int>(sizeof(T));
  const hn::ScalableTag<std::int32_t> d;
  const hn::ScalableTag<std::uint32_t> du;
  const auto left = hn::ShiftLeft<32 - kBits - kIndex * kBits>(lanes);
  if constexpr (std::is_signed_v<T>) {
    return hn::ShiftRight<32 - kBits>(left);
  } else {
    return hn::BitCast(d, hn::ShiftRight<32 - kBits>(hn::BitCast(du, left)));
  }
}

// As GatherVertices<T, Care::kNone>, for 8- and 16-bit samples: 4 bytes are fetched at once, so
// that neighbours in x come together. They are in the block: an interior sample has whole rows of
// others behind it. `count` is rounded up to whole registers; `samples` must have as many.
template <typename T, std::size_t kAxis>
void GatherSmall(const char* bytes, const BlockShape& shape, double isovalue,
                 const std::uint32_t* samples, std::size_t count,
                 VertexBatch<std::int32_t>* batch) {
  const hn::ScalableTag<std::int32_t> d;
  const DoubleTag dd;
  using Vec = hn::Vec<decltype(d)>;
  const auto* base = reinterpret_cast<const std::int32_t*>(bytes);
  const auto row = static_cast<std::int32_t>(shape.row);
  const auto slice = static_cast<std::int32_t>(shape.slice);
  const auto iso = hn::Set(dd, isovalue);
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    const Vec sample = hn::BitCast(d, hn::LoadU(hn::ScalableTag<std::uint32_t>(), samples + i));
    const Vec offset = sizeof(T) == 1 ? sample : hn::Add(sample, sample);
    const auto at = [&](std::int32_t delta) {
      constexpr auto kSize = static_cast<std::int32_t>(sizeof(T));
      return hn::GatherOffset(d, base, hn::Add(offset, hn::Set(d, delta * kSize)));
    };
    const auto one = [&](std::int32_t delta) { return SampleOfLane<T, 0>(at(delta)); };
    // By axis, the samples before and after the lower and the upper end.
    std::array<Vec, 3> lower_before;
    std::array<Vec, 3> lower_after;
    std::array<Vec, 3> upper_before;
    std::array<Vec, 3> upper_after;
    // Samples delta - 1, delta and delta + 1.
    const auto three = [&](std::int32_t delta, Vec* before, Vec* center, Vec* after) {
      const Vec first = at(delta - 1);
      *before = SampleOfLane<T, 0>(first);
      *center = SampleOfLane<T, 1>(first);
      if constexpr (sizeof(T) == 1) {
        *after = SampleOfLane<T, 2>(first);
      } else {
        *after = SampleOfLane<T, 0>(at(delta + 1));
      }
    };
    Vec lower;
    Vec upper;
    if constexpr (kAxis == 0) {
      const Vec first = at(-1);
      lower_before[0] = SampleOfLane<T, 0>(first);
      lower = SampleOfLane<T, 1>(first);
      if constexpr (sizeof(T) == 1) {
        upper = SampleOfLane<T, 2>(first);
        upper_after[0] = SampleOfLane<T, 3>(first);
      } else {
        const Vec second = at(1);
        upper = SampleOfLane<T, 0>(second);
        upper_after[0] = SampleOfLane<T, 1>(second);
      }
      lower_after[0] = upper;
      upper_before[0] = lower;
      const auto two = [&](std::int32_t delta, Vec* at_lower, Vec* at_upper) {
        const Vec pair = at(delta);
        *at_lower = SampleOfLane<T, 0>(pair);
        *at_upper = SampleOfLane<T, 1>(pair);
      };
      two(-row, &lower_before[1], &upper_before[1]);
      two(row, &lower_after[1], &upper_after[1]);
      two(-slice, &lower_before[2], &upper_before[2]);
      two(slice, &lower_after[2], &upper_after[2]);
    } else {
      constexpr std::size_t kOther = 3 - kAxis;
      const std::int32_t along = kAxis == 1 ? row : slice;
      const std::int32_t across = kAxis == 1 ? slice : row;
      three(0, &lower_before[0], &lower, &lower_after[0]);
      three(along, &upper_before[0], &upper, &upper_after[0]);
      lower_before[kAxis] = one(-along);
      lower_after[kAxis] = upper;
      upper_before[kAxis] = lower;
      upper_after[kAxis] = one(2 * along);
      lower_before[kOther] = one(-across);
      lower_after[kOther] = one(across);
      upper_before[kOther] = one(along - across);
      upper_after[kOther] = one(along + across);
    }
    for (std::size_t k = 0; k < 3; ++k) {
      hn::Store(hn::Sub(lower_after[k], lower_before[k]), d, batch->lower_gradients[k].data() + i);
      hn::Store(hn::Sub(upper_after[k], upper_before[k]), d, batch->upper_gradients[k].data() + i);
    }
    // Differences of these are exact, whether taken as integers or as doubles.
    const Vec difference = hn::Sub(upper, lower);
    const std::size_t half = hn::Lanes(dd);
    const hn::Half<decltype(d)> dh;
    hn::Store(hn::Sub(iso, hn::PromoteTo(dd, hn::LowerHalf(dh, lower))), dd,
              batch->numerators.data() + i);
    hn::Store(hn::Sub(iso, hn::PromoteTo(dd, hn::UpperHalf(dh, lower))), dd,
              batch->numerators.data() + i + half);
    hn::Store(hn::PromoteTo(dd, hn::LowerHalf(dh, difference)), dd, batch->denominators.data() + i);
    hn::Store(hn::PromoteTo(dd, hn::UpperHalf(dh, difference)), dd,
              batch->denominators.data() + i + half);
  }
}

// Fetches samples as doubles.
template <typename T>
DoubleVec GatherDoubles(const char* bytes, hn::Vec<IntHalfTag> samples) {
  const DoubleTag dd;
  if constexpr (sizeof(T) == 8) {
    return hn::GatherIndex(dd, reinterpret_cast<const double*>(bytes),
                           hn::PromoteTo(hn::RebindToSigned<DoubleTag>(), samples));
  } else if constexpr (std::is_same_v<T, float>) {
    return hn::PromoteTo(
        dd, hn::GatherIndex(FloatHalfTag(), reinterpret_cast<const float*>(bytes), samples));
  } else {
    const IntHalfTag di;
    const auto values = hn::GatherIndex(di, reinterpret_cast<const std::int32_t*>(bytes), samples);
    if constexpr (std::is_signed_v<T>) {
      return hn::PromoteTo(dd, values);
    } else {
      const auto sign = hn::Set(di, std::numeric_limits<std::int32_t>::min());
      return hn::Add(hn::PromoteTo(dd, hn::Xor(values, sign)), hn::Set(dd, 0x1.0p31));
    }
  }
}

// As GatherSmall, for 32- and 64-bit samples.
template <typename T>
void GatherLarge(const char* bytes, const BlockShape& shape, std::size_t axis, double isovalue,
                 const std::uint32_t* samples, std::size_t count, VertexBatch<double>* batch) {
  const DoubleTag dd;
  const IntHalfTag di;
  const std::array<std::int32_t, 3> strides{1, static_cast<std::int32_t>(shape.row),
                                            static_cast<std::int32_t>(shape.slice)};
  const std::int32_t along = strides[axis];
  const auto iso = hn::Set(dd, isovalue);
  for (std::size_t i = 0; i < count; i += hn::Lanes(dd)) {
    const auto sample =
        hn::BitCast(di, hn::LoadU(hn::Rebind<std::uint32_t, DoubleTag>(), samples + i));
    const auto at = [&](std::int32_t delta) {
      return GatherDoubles<T>(bytes, hn::Add(sample, hn::Set(di, delta)));
    };
    const DoubleVec lower = at(0);
    const DoubleVec upper = at(along);
    hn::Store(hn::Sub(iso, lower), dd, batch->numerators.data() + i);
    hn::Store(hn::Sub(upper, lower), dd, batch->denominators.data() + i);
    for (std::size_t k = 0; k < 3; ++k) {
      const std::int32_t step = strides[k];
      const DoubleVec lower_after = k == axis ? upper : at(step);
      const DoubleVec upper_before = k == axis ? lower : at(along - step);
      hn::Store(hn::Sub(lower_after, at(-step)), dd, batch->lower_gradients[k].data() + i);
      hn::Store(hn::Sub(at(along + step), upper_before), dd, batch->upper_gradients[k].data() + i);
    }
  }
}

template <typename T, std::size_t kAxis>
void GatherInterior(const BlockTask& task, const std::uint32_t* samples, std::size_t count,
                    VertexBatch<Difference<T>>* batch) {
  if constexpr (sizeof(T) <= 2) {
    GatherSmall<T, kAxis>(task.bytes, *task.shape, task.isovalue, samples, count, batch);
  } else {
    GatherLarge<T>(task.bytes, *task.shape, kAxis, task.isovalue, samples, count, batch);
  }
}

// As GatherVertices<T, Care::kBorder>: all at once, with another sample in place of those that are
// not interior; those then one by one.
template <typename T, std::size_t kAxis>
void GatherNearBorder(const BlockTask& task, const Strides& strides, const std::uint32_t* samples,
                      std::size_t count, VertexBatch<Difference<T>>* batch) {
  alignas(64) std::array<std::uint32_t, kBatch> safe_samples;
  std::array<std::uint32_t, kBatch> near_border;
  std::size_t near_border_count = 0;
  const std::uint64_t* interior = task.shape->interior.data();
  const std::uint32_t safe = task.shape->first_interior;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint32_t sample = samples[i];
    const bool is_interior = (interior[sample / 64] >> sample % 64 & 1) != 0;
    safe_samples[i] = is_interior ? sample : safe;
    near_border[near_border_count] = static_cast<std::uint32_t>(i);
    near_border_count += is_interior ? 0 : 1;
  }
  if (near_border_count < count) {
    std::fill(safe_samples.begin() + static_cast<std::ptrdiff_t>(count), safe_samples.end(), safe);
    GatherInterior<T, kAxis>(task, safe_samples.data(), count, batch);
  }
  for (std::size_t i = 0; i < near_border_count; ++i) {
    GatherAtBorder<T>(task.bytes, strides, kAxis, task.isovalue, samples[near_border[i]],
                      near_border[i], batch);
  }
}
#endif  // ISOSCOPE_EXTRACT_HAS_GATHER

// Positions and normals of a batch.
template <std::size_t kAxis, typename D>
void ComputeVertices(const BlockTask& task, const std::uint32_t* samples, std::size_t count,
                     VertexBatch<D>* batch) {
  const DoubleTag d;
  const FloatHalfTag df;
  const auto& columns = task.to_world->columns;
  const auto one = hn::Set(d, 1.0);
  const auto half = hn::Set(d, 0.5);
  const auto row = hn::Set(d, static_cast<double>(task.shape->row));
  const auto slice = hn::Set(d, static_cast<double>(task.shape->slice));
  const auto row_inverse = hn::Set(d, task.shape->row_inverse);
  const auto slice_inverse = hn::Set(d, task.shape->slice_inverse);
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    const auto t = hn::Div(LoadDoubles(batch->numerators.data() + i),
                           LoadDoubles(batch->denominators.data() + i));
    const auto linear = hn::PromoteTo(
        d,
        hn::BitCast(IntHalfTag(), hn::LoadU(hn::Rebind<std::uint32_t, DoubleTag>(), samples + i)));
    const auto z = hn::Trunc(hn::Mul(hn::Add(linear, half), slice_inverse));
    const auto in_slice = hn::Sub(linear, hn::Mul(z, slice));
    const auto y = hn::Trunc(hn::Mul(hn::Add(in_slice, half), row_inverse));
    const auto x = hn::Sub(in_slice, hn::Mul(y, row));
    std::array<DoubleVec, 3> position{hn::Add(hn::Set(d, task.begin.x), x),
                                      hn::Add(hn::Set(d, task.begin.y), y),
                                      hn::Add(hn::Set(d, task.begin.z), z)};
    position[kAxis] = hn::Add(position[kAxis], t);

    std::array<DoubleVec, 3> gradient;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto lower = LoadDoubles(batch->lower_gradients[k].data() + i);
      const auto upper = LoadDoubles(batch->upper_gradients[k].data() + i);
      gradient[k] = hn::Add(lower, hn::Mul(t, hn::Sub(upper, lower)));
    }
    const auto world = [&](double a, double b, double c) {
      return hn::Neg(
          hn::Add(hn::Add(hn::Mul(hn::Set(d, a), gradient[0]), hn::Mul(hn::Set(d, b), gradient[1])),
                  hn::Mul(hn::Set(d, c), gradient[2])));
    };
    const auto gx = world(columns[0].x, columns[1].x, columns[2].x);
    const auto gy = world(columns[0].y, columns[1].y, columns[2].y);
    const auto gz = world(columns[0].z, columns[1].z, columns[2].z);
    // Scaled first, so that squares neither overflow nor vanish.
    const auto ax = hn::Abs(gx);
    const auto ay = hn::Abs(gy);
    const auto az = hn::Abs(gz);
    // Not Max: instruction sets differ in what it makes of NaN.
    const auto axy = hn::IfThenElse(hn::Gt(ax, ay), ax, ay);
    const auto scale = hn::Div(one, hn::IfThenElse(hn::Gt(axy, az), axy, az));
    const auto nx = hn::Mul(gx, scale);
    const auto ny = hn::Mul(gy, scale);
    const auto nz = hn::Mul(gz, scale);
    const auto square = hn::Add(hn::Add(hn::Mul(nx, nx), hn::Mul(ny, ny)), hn::Mul(nz, nz));
    // False for NaN: the gradient is zero or not finite.
    const auto usable = hn::And(hn::Ge(square, half), hn::Le(square, hn::Set(d, 4.0)));
    const auto inverse = hn::Div(one, hn::Sqrt(square));
    const std::array<DoubleVec, 3> normal{hn::Mul(nx, inverse), hn::Mul(ny, inverse),
                                          hn::Mul(nz, inverse)};
    for (std::size_t k = 0; k < 3; ++k) {
      hn::Store(hn::DemoteTo(df, position[k]), df, batch->positions[k].data() + i);
      hn::Store(hn::DemoteTo(df, hn::IfThenElseZero(usable, normal[k])), df,
                batch->normals[k].data() + i);
    }
  }
}

// Writes whole registers: up to 63 vectors past `count`.
void Interleave(const std::array<std::array<float, kBatch>, 3>& from, std::size_t count,
                math::Vec3f* to) {
  const hn::CappedTag<float, 64> d;
  for (std::size_t i = 0; i < count; i += hn::Lanes(d)) {
    hn::StoreInterleaved3(hn::Load(d, from[0].data() + i), hn::Load(d, from[1].data() + i),
                          hn::Load(d, from[2].data() + i), d, &to[i].x);
  }
}

template <typename T, Care kCare, std::size_t kAxis>
void PlaceVerticesOfAxis(const BlockTask& task, const Strides& strides, std::size_t first_vertex,
                         BlockScratch* scratch, VertexBatch<Difference<T>>* batch) {
  const std::size_t all = scratch->edge_counts[kAxis];
  for (std::size_t begin = 0; begin < all; begin += kBatch) {
    const std::size_t count = std::min(kBatch, all - begin);
    const std::uint32_t* samples = scratch->edge_samples[kAxis].data() + begin;
#if ISOSCOPE_EXTRACT_HAS_GATHER
    if constexpr (kCare == Care::kFull) {
      GatherVertices<T, kCare>(task.bytes, strides, task.shape->interior, kAxis, task.isovalue,
                               samples, count, batch);
    } else if constexpr (kCare == Care::kBorder) {
      GatherNearBorder<T, kAxis>(task, strides, samples, count, batch);
    } else {
      GatherInterior<T, kAxis>(task, samples, count, batch);
    }
#else
    GatherVertices<T, kCare>(task.bytes, strides, task.shape->interior, kAxis, task.isovalue,
                             samples, count, batch);
#endif
    ComputeVertices<kAxis>(task, samples, count, batch);
    Interleave(batch->positions, count, scratch->positions.data() + first_vertex + begin);
    Interleave(batch->normals, count, scratch->normals.data() + first_vertex + begin);
  }
}

template <typename T, Care kCare>
void PlaceVertices(const BlockTask& task, BlockScratch* scratch) {
  const BlockShape& shape = *task.shape;
  const Strides strides{
      {1, shape.row, shape.slice},
      {static_cast<std::size_t>(shape.stored_dims.x), static_cast<std::size_t>(shape.stored_dims.y),
       static_cast<std::size_t>(shape.stored_dims.z)}};
  VertexBatch<Difference<T>> batch;
  const std::array<std::size_t, 3>& counts = scratch->edge_counts;
  PlaceVerticesOfAxis<T, kCare, 0>(task, strides, 0, scratch, &batch);
  PlaceVerticesOfAxis<T, kCare, 1>(task, strides, counts[0], scratch, &batch);
  PlaceVerticesOfAxis<T, kCare, 2>(task, strides, counts[0] + counts[1], scratch, &batch);
}

// Fills indices and index_count from vertex_ids.
template <bool kNarrow>
void MakeTriangles(const BlockTask& task, BlockScratch* scratch) {
  const BlockShape& shape = *task.shape;
  Grow(CountBits(scratch->active_cells.data(), shape.word_count) + kListPadding, &scratch->cells);
  const std::size_t cell_count =
      ListBits(scratch->active_cells.data(), shape.word_count, scratch->cells.data());
  Grow(3 * std::size_t{kMaxTrianglesPerCell} * cell_count + 16, &scratch->indices);
  const std::uint64_t* inside = scratch->inside.data() + scratch->padding;
  const std::size_t row = shape.row;
  const std::size_t slice = shape.slice;
  std::uint32_t* out = scratch->indices.data();
  for (std::size_t i = 0; i < cell_count; ++i) {
    const std::size_t sample = scratch->cells[i];
    // Four corners each: two in this row, two in the next.
    const std::uint64_t low = LoadBits(inside, sample);
    const std::uint64_t high = LoadBits(inside, sample + slice);
    const std::uint64_t low_next = kNarrow ? low >> row : LoadBits(inside, sample + row);
    const std::uint64_t high_next = kNarrow ? high >> row : LoadBits(inside, sample + row + slice);
    const std::size_t cell_case =
        (low & 3) | (low_next & 3) << 2 | (high & 3) << 4 | (high_next & 3) << 6;
    const std::uint8_t* lanes = task.case_table->lanes[cell_case].data();
    const std::size_t count = 3 * std::size_t{task.case_table->triangle_counts[cell_case]};
    const std::uint32_t* ids = scratch->vertex_ids.data() + 4 * sample;
#if HWY_TARGET <= HWY_AVX3 && HWY_ARCH_X86
    // All vertices of the cell in two registers, by corner and axis.
    const hn::FixedTag<std::uint32_t, 8> d8;
    const hn::FixedTag<std::uint32_t, 16> d16;
    const auto lower = hn::Combine(d16, hn::LoadU(d8, ids + 4 * row), hn::LoadU(d8, ids));
    const auto upper =
        hn::Combine(d16, hn::LoadU(d8, ids + 4 * (slice + row)), hn::LoadU(d8, ids + 4 * slice));
    const auto order = hn::PromoteTo(d16, hn::LoadU(hn::FixedTag<std::uint8_t, 16>(), lanes));
    hn::StoreU(hn::Vec<decltype(d16)>{_mm512_permutex2var_epi32(lower.raw, order.raw, upper.raw)},
               d16, out);
#else
    const auto put = [&](std::size_t begin, std::size_t end) {
      for (std::size_t k = begin; k < end; ++k) {
        out[k] = ids[shape.lane_offsets[lanes[k]]];
      }
    };
    put(0, 6);
    if (count > 6) {
      put(6, 15);
    }
#endif
    out += count;
  }
  scratch->index_count = static_cast<std::size_t>(out - scratch->indices.data());
}

// Sizes the scratch space that depends on the shape only.
void UseShape(const BlockShape& shape, BlockScratch* scratch) {
  scratch->padding = (shape.slice + shape.row + 1) / 64 + 2;
  const std::size_t padded = shape.padded_word_count + 2 * scratch->padding;
  for (BitRow* bits : {&scratch->inside, &scratch->valid, &scratch->valid_cells}) {
    Grow(padded, bits);
  }
  for (BitRow& bits : scratch->crossed) {
    Grow(shape.padded_word_count, &bits);
  }
  Grow(shape.padded_word_count, &scratch->active_cells);
  Grow(4 * (shape.sample_count + 1), &scratch->vertex_ids);
}

// (1) one bit a sample: inside or not; (2) crossed edges and active cells from shifts of those
// bits; (3) a number for every crossed edge; (4) positions and normals, in batches; (5) triangles.
template <typename T>
void Extract(const BlockTask& task, BlockScratch* scratch) {
  const BlockShape& shape = *task.shape;
  scratch->vertex_count = 0;
  scratch->index_count = 0;
  scratch->owned_vertex_count = 0;
  scratch->edge_counts = {};
  const volume::Threshold<T> threshold = volume::InsideThreshold<T>(task.isovalue);
  if (!threshold.any) {
    return;
  }
  UseShape(shape, scratch);
  ClassifyInside<T>(task.bytes, shape.sample_count, threshold.value,
                    scratch->inside.data() + scratch->padding);
  const bool extreme = HasExtremeSamples<T>(task.bytes, shape.sample_count);
  if (extreme) {
    ClassifySamples<T>(
        task.bytes, shape.sample_count, [](auto samples) { return hn::Eq(samples, samples); },
        scratch->valid.data() + scratch->padding);
    FindCrossings<true>(shape, scratch);
  } else {
    FindCrossings<false>(shape, scratch);
  }
  NumberVertices(shape, scratch);
  if (scratch->vertex_count == 0) {
    return;
  }
  Grow(scratch->vertex_count + 64, &scratch->positions);
  Grow(scratch->vertex_count + 64, &scratch->normals);
  if (extreme) {
    PlaceVertices<T, Care::kFull>(task, scratch);
  } else if (shape.touches_border) {
    PlaceVertices<T, Care::kBorder>(task, scratch);
  } else {
    PlaceVertices<T, Care::kNone>(task, scratch);
  }
  // LoadBits has 57 bits.
  if (shape.row + 2 <= 57) {
    MakeTriangles<true>(task, scratch);
  } else {
    MakeTriangles<false>(task, scratch);
  }
}

void ExtractBlockOfType(const BlockTask& task, BlockScratch* scratch) {
  volume::VisitScalarType(task.type, [&]<typename T>() { Extract<T>(task, scratch); });
}

#undef ISOSCOPE_EXTRACT_HAS_GATHER

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace isoscope::extract
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isoscope::extract {
namespace {
HWY_EXPORT(ExtractBlockOfType);
}  // namespace

void ExtractBlock(const BlockTask& task, BlockScratch* scratch) {
  HWY_DYNAMIC_DISPATCH(ExtractBlockOfType)(task, scratch);
}

}  // namespace isoscope::extract
#endif  // HWY_ONCE
