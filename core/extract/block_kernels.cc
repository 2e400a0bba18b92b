// Extracts a block in five passes, over all its stored samples as one line: sample (x, y, z) is bit
// x + y * row + z * slice of a bit row, so one operation on a word handles 64 samples.
//
//   1. ClassifyInside: one bit a sample, set iff it is inside.
//   2. FindCrossings: an edge is crossed iff the bits of its ends differ: inside ^ (inside >>
//      stride), stride 1, row or slice. A cell is active iff its eight bits are neither all set nor
//      all clear. Masks of the shape drop the edges and cells that are not the block's.
//   3. AssignVertexIds: list the crossed edges, axis by axis; a vertex id is the position in the
//      list.
//   4. PlaceVertices: positions and normals, a batch of 128 vertices at a time.
//   5. MakeTriangles: for each active cell, the ids that the case table names.
//
// Passes 1 to 3 are in edge_crossings-inl.h, pass 4 in vertex_placement-inl.h, pass 5 is here.
//
// Example: a row of samples 3 7 9 4 with isovalue 5 has the inside bits 0 1 1 0, lowest first;
// shifted by one sample they are 1 1 0 -, so the edges at x = 0 and x = 2 are crossed. Their
// vertices lie at 0 + (5 - 3) / (7 - 3) = 0.5 and at 2 + (5 - 9) / (4 - 9) = 2.8.
//
// Invariants: the time of passes 1 and 2 does not depend on the values of samples; that of the
// others grows with the vertices and active cells. Blocks with NaN, infinities or doubles near
// overflow go through a slower variant of passes 2 and 4, which gives the same bits for ordinary
// samples.
//
// Based on: Lorensen and Cline 1987 (references.bib: lorensen-cline); the order of passes is that
// of Schroeder, Maynard and Geveci 2015 (flying-edges), with bits instead of edge cases of rows.

#include "core/extract/block_kernels.h"

#include <cstddef>
#include <cstdint>

#include "core/extract/bit_row.h"
#include "core/extract/field_values.h"
#include "core/volume/scalar_span.h"

// Processors from Ice Lake and Zen 4 on can list the set bits of a word at once: their own target.
#define HWY_WANT_AVX3_DL
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/extract/block_kernels.cc"
#include "hwy/foreach_target.h"  // IWYU pragma: keep
#include "hwy/highway.h"
// After foreach_target.h: included once for each instruction set, like this file.
#include "core/extract/edge_crossings-inl.h"
#include "core/extract/vertex_placement-inl.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::extract {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// Pass 5 lists the active cells, reads the case of each from the bits of its eight corners, and
// looks up the vertex ids of its triangles. Fills indices and index_count.
//
// Up to 15 ids of a cell are fetched by lane, 4 * (corner of the edge's lower sample) + axis, which
// the case table lists: the 32 ids that a cell can use lie in four pairs of neighbouring samples,
// one pair for each row of the cell. kNarrow: two rows of a slice fit into one load of bits.
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
    // The four corners of the lower slice, then of the upper: two bits of a row each.
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
    // Load all 32 ids of the cell into two registers, and pick 16 with one permutation.
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

// Grows the scratch space that depends on the shape alone.
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

// Runs the passes on samples of type T.
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
  AssignVertexIds(shape, scratch);
  if (scratch->vertex_count == 0) {
    return;
  }
  Grow(scratch->vertex_count + 64, &scratch->positions);
  Grow(scratch->vertex_count + 64, &scratch->normals);
  if (task.field != nullptr && HasWideValues(task.field->type)) {
    Grow(scratch->vertex_count, &scratch->wide_values);
  } else if (task.keeps_values()) {
    Grow(scratch->vertex_count, &scratch->values);
  }
  if (extreme) {
    PlaceVertices<T, Care::kFull>(task, scratch);
  } else if (shape.touches_border) {
    PlaceVertices<T, Care::kBorder>(task, scratch);
  } else {
    PlaceVertices<T, Care::kNone>(task, scratch);
  }
  // LoadBits returns 57 valid bits: enough for two rows of samples, and one corner more in x.
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
