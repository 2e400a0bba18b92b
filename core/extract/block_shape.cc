#include "core/extract/block_shape.h"

#include <algorithm>

#include "core/math/box.h"

namespace isoscope::extract {
namespace {

void SetBits(std::size_t begin, std::size_t end, BitRow* mask) {
  while (begin < end) {
    const std::size_t count = std::min(end - begin, 64 - begin % 64);
    (*mask)[begin / 64] |= ~std::uint64_t{0} >> (64 - count) << begin % 64;
    begin += count;
  }
}

// Returns the mask of the samples in `box`. Its coordinates count from the first stored sample.
BitRow MaskOf(const BlockShape& shape, const math::IndexBox& box) {
  BitRow mask(shape.padded_word_count);
  for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
    for (std::int64_t y = box.begin.y; y < box.end.y; ++y) {
      const std::size_t begin = static_cast<std::size_t>(box.begin.x) +
                                static_cast<std::size_t>(y) * shape.row +
                                static_cast<std::size_t>(z) * shape.slice;
      SetBits(begin, begin + static_cast<std::size_t>(std::max<std::int64_t>(box.dims().x, 0)),
              &mask);
    }
  }
  return mask;
}

}  // namespace

BlockShape MakeBlockShape(const volume::BlockLayout& layout, volume::BlockId id) {
  const math::IndexBox stored = layout.StoredSamplesOf(id);
  const math::IndexBox cells = layout.CellsOf(id);
  const math::IndexBox own = layout.OwnSamplesOf(id);
  BlockShape shape;
  shape.stored_dims = stored.dims();
  shape.row = static_cast<std::size_t>(shape.stored_dims.x);
  shape.slice = shape.row * static_cast<std::size_t>(shape.stored_dims.y);
  shape.sample_count = shape.slice * static_cast<std::size_t>(shape.stored_dims.z);
  shape.word_count = (shape.sample_count + 63) / 64;
  shape.padded_word_count = (shape.word_count + kWordGroup - 1) / kWordGroup * kWordGroup;
  shape.row_inverse = 1.0 / static_cast<double>(shape.row);
  shape.slice_inverse = 1.0 / static_cast<double>(shape.slice);
  for (std::size_t lane = 0; lane < shape.lane_offsets.size(); ++lane) {
    const std::size_t corner = lane / 4;
    shape.lane_offsets[lane] = static_cast<std::uint32_t>(
        4 * ((corner & 1) + (corner >> 1 & 1) * shape.row + (corner >> 2) * shape.slice) +
        lane % 4);
  }
  const math::IndexBox local_cells{cells.begin - stored.begin, cells.end - stored.begin};
  shape.cells = MaskOf(shape, local_cells);
  shape.interior = MaskOf(shape, {{1, 1, 1}, shape.stored_dims - math::Index3{2, 2, 2}});
  shape.first_interior = static_cast<std::uint32_t>(1 + shape.row + shape.slice);
  for (int axis = 0; axis < 3; ++axis) {
    shape.touches_border |= own.begin[axis] == 0 || own.end[axis] == layout.sample_dims()[axis];
    math::IndexBox edges = local_cells;
    math::IndexBox owned = local_cells;
    for (int other = 0; other < 3; ++other) {
      if (other == axis) {
        continue;
      }
      ++edges.end[other];
      if (own.end[other] == layout.sample_dims()[other]) {
        ++owned.end[other];
      }
    }
    shape.edges[static_cast<std::size_t>(axis)] = MaskOf(shape, edges);
    shape.owned_edges[static_cast<std::size_t>(axis)] = MaskOf(shape, owned);
  }
  return shape;
}

const BlockShape& BlockShapes::Of(volume::BlockId id) const {
  LazyShape& lazy = shapes_[ClassOf(id)];
  std::call_once(lazy.once, [&] { lazy.shape = MakeBlockShape(layout_, id); });
  return lazy.shape;
}

std::size_t BlockShapes::ClassOf(volume::BlockId id) const {
  const math::Index3 index = layout_.IndexOf(id);
  std::size_t shape_class = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const std::size_t first = index[axis] == 0 ? 1 : 0;
    const std::size_t last = index[axis] == layout_.block_dims()[axis] - 1 ? 2 : 0;
    shape_class = shape_class * 4 + first + last;
  }
  return shape_class;
}

}  // namespace isoscope::extract
