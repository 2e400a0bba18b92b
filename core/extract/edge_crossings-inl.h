// Passes 1 to 3 of extraction: classify the samples, find the crossed edges and active cells,
// assign vertex ids. All three work on bit rows, one bit a sample. The head of block_kernels.cc
// describes all passes. Included once for each instruction set, by block_kernels.cc, and by
// label_kernels.cc, which packs its marks with PackWord.
//
//   1. ClassifyInside compares a register of samples with the threshold and packs the mask, 64
//      samples to a word.
//   2. FindCrossings loads a word of bits seven more times, shifted to the other corners of the
//      cells:
//
//        corner   000   100   010   110     001     101       011         111
//        shift      0     1   row   row+1   slice   slice+1   slice+row   slice+row+1
//
//      x edges are 000 ^ 100, y edges 000 ^ 010, z edges 000 ^ 001; a cell is active iff the OR of
//      all eight is set and the AND is not. The masks of the shape then drop bits that are no edge
//      or cell of the block. An example is the x edge from the end of a row to the start of the
//      next.
//   3. AssignVertexIds lists the set bits, axis by axis. The position in the three lists, one after
//      the other, is the vertex id; it is kept by sample and axis for pass 5.
//
// Invariant: a shifted load reads up to slice + row + 1 bits past the word, so the bit rows have
// padding at both ends.
//
// With NaN a second bit row marks the samples that are numbers. An edge needs both ends, a cell all
// eight corners; owned vertices are counted by that alone (docs/numerics.md, "Unique vertex
// count"). Then edges that no valid cell touches are dropped, so that every vertex has a cell that
// can draw it.

// Highway's guard: defined and undefined in turn.
#if defined(ISOSCOPE_CORE_EXTRACT_EDGE_CROSSINGS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ISOSCOPE_CORE_EXTRACT_EDGE_CROSSINGS_INL_H_
#undef ISOSCOPE_CORE_EXTRACT_EDGE_CROSSINGS_INL_H_
#else
#define ISOSCOPE_CORE_EXTRACT_EDGE_CROSSINGS_INL_H_
#endif

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/extract/bit_row.h"
#include "core/extract/block_kernels.h"
#include "core/extract/block_shape.h"
#include "core/extract/vertex_batch.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::extract {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// ListBits writes up to this many elements past the end, and passes may read whole registers there.
inline constexpr std::size_t kListPadding = 64;

// Writes the positions of the set bits of `words` words, ascending, and returns their count.
// out: capacity of that count + kListPadding
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
    // Always writes eight at a time, because a branch for each bit is hard to predict.
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

// A register of samples, at most 64 of them, so that its mask fits a word.
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

// Writes the bits of predicate(register of samples) for 64 samples to one word.
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

// Sets bit i of `bits` iff predicate(sample i), for `count` samples. The rest of the last word is
// as for samples of value 0.
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

// Pass 1 sets the bit of each sample that is inside, sample >= threshold; NaN is not.
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

// Returns true if plain differences of these samples may not be finite: some sample is NaN or
// infinite or, for doubles, at least 2^1022 in magnitude.
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

// Loads the bits [64 w + offset, 64 w + offset + 64) for a register of words w. A shift by 64 is
// not defined, so the upper word is doubled and shifted by one less.
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

// Removes from `crossed` the edges that no valid cell of the block touches: an edge belongs to the
// cell at its lower sample and to those one step back on either or both other axes.
inline void DropEdgesWithoutCells(const BlockShape& shape, BlockScratch* scratch) {
  const std::uint64_t* cells = scratch->valid_cells.data() + scratch->padding;
  std::fill_n(scratch->valid_cells.begin(), scratch->padding, 0);
  // Loads the bits [64 word - offset, 64 word - offset + 64).
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

// Pass 2 finds the crossed edges and the active cells, and counts the vertices that the block owns.
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
      const std::uint64_t* not_nan = valid + i;
      const auto v0 = hn::LoadU(d, not_nan);
      const auto vx = hn::And(v0, x(not_nan));
      const auto vy = hn::And(v0, y(not_nan));
      const auto vz = hn::And(v0, z(not_nan));
      cells = hn::And(hn::And(cells, vx), hn::And(vy, vz));
      for (const ShiftedBits* shifted : {&xy, &xz, &yz, &xyz}) {
        cells = hn::And(cells, (*shifted)(not_nan));
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

// Pass 3 gives each crossed edge a vertex id. Fills edge_samples, edge_counts, vertex_ids and
// vertex_count. Copies of its last sample follow each list, so that pass 4 reads valid samples in
// whole registers.
inline void AssignVertexIds(const BlockShape& shape, BlockScratch* scratch) {
  std::size_t vertex_count = 0;
  std::uint32_t* ids = scratch->vertex_ids.data();
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::uint64_t* crossed = scratch->crossed[axis].data();
    std::vector<std::uint32_t>& list = scratch->edge_samples[axis];
    Grow(CountBits(crossed, shape.word_count) + kListPadding, &list);
    const std::size_t count = ListBits(crossed, shape.word_count, list.data());
    for (std::size_t i = 0; i < count; ++i) {
      ids[4 * std::size_t{list[i]} + axis] = static_cast<std::uint32_t>(vertex_count + i);
    }
    if (count > 0) {
      std::fill_n(list.begin() + static_cast<std::ptrdiff_t>(count), kListPadding, list[count - 1]);
    }
    scratch->edge_counts[axis] = count;
    vertex_count += count;
  }
  scratch->vertex_count = vertex_count;
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace isoscope::extract
HWY_AFTER_NAMESPACE();

#endif  // ISOSCOPE_CORE_EXTRACT_EDGE_CROSSINGS_INL_H_
