// A block is extracted in four steps, or five:
//
//   1. Mark: 1 for each sample that is a label, else 0; NaN stays NaN.
//   2. The kernels of isovalues extract the surface of the marks at 1/2, with the case table of
//      labels. So vertices are the middles of crossed edges.
//   3. AddLastTriangles: those kernels write five triangles of a cell; 14 cases have a sixth.
//   4. ReplaceNormals: central differences of marks have few directions. The Sobel filter has more,
//      for it sees all 27 samples around.
//   5. SmoothVertices, of a smooth surface: vertices move along their edges (smooth_fraction.h), and
//      values of another field are those of the new places.
//
// The filter wants neighbours on all sides. Where the volume ends, marks are copied to a larger
// box, whose outermost layer repeats the nearest sample of the volume on each axis. Vertices keep
// their order; PaddedEdgeSamples finds their samples in the larger box.
//
// With NaN, let m be the marks (0 for NaN), n 1 for numbers and 0 for NaN, c the centre's mark. A
// NaN counts as the centre's mark. Weights add up to 0, so the filter of m - c where n is 1 is
// filter(m) - c filter(n): two filters, and the second only for inside samples.

#include "core/extract/label_surface.h"

#include <algorithm>
#include <cstring>
#include <limits>
#include <span>

#include "core/extract/bit_row.h"
#include "core/extract/field_values.h"
#include "core/extract/label_case_table.h"
#include "core/extract/smooth_fraction.h"

namespace isoscope::extract {
namespace {

using math::Index3;

std::size_t CountOf(const Index3& dims) { return static_cast<std::size_t>(math::Volume(dims)); }

// Step 1. Returns true if a sample is NaN: then `values` is filled, too.
bool MarkSamples(const LabelTask& task, LabelScratch* scratch) {
  const std::size_t count = task.shape->sample_count;
  const volume::BlockSamples& samples = *task.samples;
  Grow(count + kMarkPadding, &scratch->marks);
  MarkLabels(*task.labels, samples.bytes, count, scratch->marks.data());
  if (samples.type != volume::ScalarType::kFloat32 &&
      samples.type != volume::ScalarType::kFloat64) {
    return false;
  }
  Grow(count + kMarkPadding, &scratch->numbers);
  if (!MarkNumbers(samples.type, samples.bytes, count, scratch->numbers.data())) {
    return false;
  }
  Grow(count, &scratch->values);
  for (std::size_t i = 0; i < count; ++i) {
    scratch->values[i] = scratch->numbers[i] != 0 ? static_cast<float>(scratch->marks[i])
                                                  : std::numeric_limits<float>::quiet_NaN();
  }
  return true;
}

// Step 3.
void AddLastTriangles(const BlockShape& shape, BlockScratch* block) {
  const LabelCaseTable& table = GetLabelCaseTable();
  const std::uint64_t* inside = block->inside.data() + block->padding;
  const std::size_t cell_count = CountBits(block->active_cells.data(), shape.word_count);
  for (std::size_t i = 0; i < cell_count; ++i) {
    const std::size_t sample = block->cells[i];
    const auto row_of_cell = [&](std::size_t offset) {
      return LoadBits(inside, sample + offset) & 3;
    };
    const std::size_t cell_case = row_of_cell(0) | row_of_cell(shape.row) << 2 |
                                  row_of_cell(shape.slice) << 4 |
                                  row_of_cell(shape.slice + shape.row) << 6;
    if (!table.has_last[cell_case]) {
      continue;
    }
    Grow(block->index_count + 3, &block->indices);
    for (const std::uint8_t lane : table.last_lanes[cell_case]) {
      block->indices[block->index_count] = block->vertex_ids[4 * sample + shape.lane_offsets[lane]];
      ++block->index_count;
    }
  }
}

// Where the padded box lies: its dimensions, and the stored box's first sample in it.
struct Padding {
  Index3 dims;
  Index3 begin;

  [[nodiscard]] std::size_t row() const { return static_cast<std::size_t>(dims.x); }
  [[nodiscard]] std::size_t slice() const { return static_cast<std::size_t>(dims.x * dims.y); }
};

// Copies stored samples to the padded box. Its outermost layers repeat the nearest stored sample.
void Pad(const std::vector<std::uint8_t>& stored, const Index3& stored_dims, const Padding& padding,
         std::vector<std::uint8_t>* padded) {
  Grow(CountOf(padding.dims) + kMarkPadding, padded);
  std::uint8_t* out = padded->data();
  for (std::int64_t z = 0; z < padding.dims.z; ++z) {
    const std::int64_t from_z = std::clamp<std::int64_t>(z - padding.begin.z, 0, stored_dims.z - 1);
    for (std::int64_t y = 0; y < padding.dims.y; ++y) {
      const std::int64_t from_y =
          std::clamp<std::int64_t>(y - padding.begin.y, 0, stored_dims.y - 1);
      const std::uint8_t* from = stored.data() + stored_dims.x * (from_y + stored_dims.y * from_z);
      const std::int64_t after = padding.begin.x + stored_dims.x;
      std::fill_n(out, padding.begin.x, from[0]);
      std::memcpy(out + padding.begin.x, from, static_cast<std::size_t>(stored_dims.x));
      std::fill_n(out + after, padding.dims.x - after, from[stored_dims.x - 1]);
      out += padding.dims.x;
    }
  }
}

// Returns the lower samples of the edges along `axis` in the padded box.
const std::uint32_t* PaddedEdgeSamples(const BlockShape& shape, const Padding& padding,
                                       std::size_t axis, const BlockScratch& block,
                                       std::vector<std::uint32_t>* padded) {
  const std::size_t count = block.edge_counts[axis];
  Grow(count, padded);
  const auto row = static_cast<std::uint32_t>(shape.row);
  const auto slice = static_cast<std::uint32_t>(shape.slice);
  const auto first = static_cast<std::uint32_t>(
      padding.begin.x + padding.dims.x * (padding.begin.y + padding.dims.y * padding.begin.z));
  const auto row_growth = static_cast<std::uint32_t>(padding.row() - shape.row);
  const auto slice_growth =
      static_cast<std::uint32_t>(padding.slice() - padding.row() * (shape.slice / shape.row));
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint32_t sample = block.edge_samples[axis][i];
    // Rows, counted through all slices, are longer by row_growth.
    (*padded)[i] = first + sample + sample / row * row_growth + sample / slice * slice_growth;
  }
  return padded->data();
}

// Step 4.
void ReplaceNormals(const LabelTask& task, bool has_nan, BlockScratch* block,
                    LabelScratch* scratch) {
  const Padding padding{task.own.dims() + Index3{2, 2, 2},
                        task.stored.begin - task.own.begin + Index3{1, 1, 1}};
  const Index3 stored_dims = task.stored.dims();
  const bool is_padded = padding.dims != stored_dims;
  if (is_padded) {
    Pad(scratch->marks, stored_dims, padding, &scratch->padded_marks);
  }
  const std::uint8_t* marks = (is_padded ? scratch->padded_marks : scratch->marks).data();
  const std::size_t count = CountOf(padding.dims);
  Grow(count + kMarkPadding, &scratch->sobel);
  FillSobel(marks, padding.row(), padding.slice(), count, &scratch->lines, scratch->sobel.data());
  if (has_nan) {
    if (is_padded) {
      Pad(scratch->numbers, stored_dims, padding, &scratch->padded_numbers);
    }
    const std::uint8_t* numbers = (is_padded ? scratch->padded_numbers : scratch->numbers).data();
    Grow(count + kMarkPadding, &scratch->sobel_of_numbers);
    FillSobel(numbers, padding.row(), padding.slice(), count, &scratch->lines,
              scratch->sobel_of_numbers.data());
    for (std::size_t i = 0; i < count; ++i) {
      // In each byte: 16 + a + 16 - (16 + b), which is 0 to 32 where it is used.
      scratch->sobel[i] += marks[i] != 0 ? kSobelZero * 0x010101 - scratch->sobel_of_numbers[i] : 0;
    }
  }
  const std::array<std::size_t, 3> strides{1, padding.row(), padding.slice()};
  math::Vec3f* normals = block->normals.data();
  for (std::size_t axis = 0; axis < 3; ++axis) {
    FillLabelNormals(
        {.axis = axis,
         .count = block->edge_counts[axis],
         .lower_samples = is_padded ? PaddedEdgeSamples(*task.shape, padding, axis, *block,
                                                        &scratch->padded_edge_samples)
                                    : block->edge_samples[axis].data(),
         .upper_distance = strides[axis],
         .marks = marks,
         .sobel = scratch->sobel.data()},
        *task.to_world, normals);
    normals += block->edge_counts[axis];
  }
}

// Step 5.
void SmoothVertices(const LabelTask& task, BlockScratch* block, LabelScratch* scratch) {
  const std::array<std::size_t, 3> strides{1, task.shape->row, task.shape->slice};
  std::size_t first = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::size_t count = block->edge_counts[axis];
    const std::span<const std::uint32_t> lower = std::span(block->edge_samples[axis]).first(count);
    Grow(count, &scratch->fractions);
    FillSmoothFractions(*task.samples, task.stored.dims(), static_cast<int>(axis), lower,
                        scratch->fractions.data());
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t steps = axis == 0   ? lower[i] % strides[1]
                                : axis == 1 ? lower[i] % strides[2] / strides[1]
                                            : lower[i] / strides[2];
      const auto begin = static_cast<double>(task.stored.begin[static_cast<int>(axis)]);
      block->positions[first + i][static_cast<int>(axis)] =
          static_cast<float>(begin + static_cast<double>(steps) + scratch->fractions[i]);
    }
    if (task.field != nullptr) {
      scratch->ones.resize(std::max(scratch->ones.size(), count), 1.0);
      const VerticesOnEdges vertices{.count = count,
                                     .lower_samples = lower.data(),
                                     .upper_distance = strides[axis],
                                     .numerators = scratch->fractions.data(),
                                     .denominators = scratch->ones.data()};
      if (HasWideValues(task.field->type)) {
        FillFieldValues(*task.field, vertices, block->wide_values.data() + first);
      } else {
        FillFieldValues(*task.field, vertices, block->values.data() + first);
      }
    }
    first += count;
  }
}

}  // namespace

void ExtractLabelBlock(const LabelTask& task, BlockScratch* block, LabelScratch* scratch) {
  const bool has_nan = MarkSamples(task, scratch);
  ExtractBlock(
      {.type = has_nan ? volume::ScalarType::kFloat32 : volume::ScalarType::kUint8,
       .bytes = has_nan ? reinterpret_cast<const char*>(scratch->values.data())
                        : reinterpret_cast<const char*>(scratch->marks.data()),
       .isovalue = 0.5,
       .shape = task.shape,
       .begin = {static_cast<double>(task.stored.begin.x), static_cast<double>(task.stored.begin.y),
                 static_cast<double>(task.stored.begin.z)},
       .to_world = task.to_world,
       .case_table = &GetLabelCaseTable().first_triangles,
       .keeps_gradient_magnitudes = false,
       .field = task.field},
      block);
  if (block->vertex_count == 0) {
    return;
  }
  AddLastTriangles(*task.shape, block);
  ReplaceNormals(task, has_nan, block, scratch);
  if (task.smooths) {
    SmoothVertices(task, block, scratch);
  }
}

}  // namespace isoscope::extract
