#include "core/extract/block_kernels.h"

#include <cstddef>
#include <cstdint>

#include "core/extract/bit_row.h"
#include "core/volume/scalar_span.h"

// Ice Lake and Zen 4 onwards have their own target: they can list the set bits of a word at once.
#define HWY_WANT_AVX3_DL
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/extract/block_kernels.cc"
#include "hwy/foreach_target.h"  // IWYU pragma: keep
#include "hwy/highway.h"
// After foreach_target.h: once for each instruction set, as this file.
#include "core/extract/edge_crossings-inl.h"
#include "core/extract/vertex_placement-inl.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::extract {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

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
