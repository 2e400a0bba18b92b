#include "core/render/gl_mesh_chunk.h"

#include <algorithm>
#include <bit>

namespace isoscope::render {
namespace {

std::uint32_t PackPixel(int x, int y) {
  return static_cast<std::uint32_t>(x) | static_cast<std::uint32_t>(y) << 16;
}
static_assert(view::kMaxViewportPx <= 0xffff, "pixels are packed in 16 + 16 bits");

// Returns the number of 32-bit words that the mask of an item takes.
std::size_t MaskWordsOf(const DrawItem& item) {
  return item.open.has_value() ? 2 * item.open->words.size() : 0;
}

BlockTexel TexelOf(const DrawItem& item, const image::FragmentOrder& order,
                   std::uint32_t first_mask_word) {
  const view::PixelRect& rect = item.footprint.rect;
  BlockTexel texel{.owner = order.OwnerOf(item.surface_index, item.mesh->block_id),
                   .nearest_depth_bits = std::bit_cast<std::uint32_t>(item.footprint.nearest_depth),
                   .first_pixel = PackPixel(rect.begin_x, rect.begin_y),
                   .end_pixel = PackPixel(rect.end_x, rect.end_y)};
  if (item.open.has_value()) {
    const image::PixelMask& open = *item.open;
    texel.mask_first_word = first_mask_word;
    texel.mask_shift = static_cast<std::uint32_t>(open.shift);
    texel.mask_first_cell = PackPixel(open.begin_column, open.begin_row);
    texel.mask_cells = PackPixel(open.columns, open.rows);
  }
  return texel;
}

}  // namespace

ChunkSize NextChunk(std::span<const DrawItem> items, std::size_t max_texels) {
  ChunkSize size;
  for (const DrawItem& item : items) {
    const ChunkSize next{.items = size.items + 1,
                         .vertices = size.vertices + item.mesh->positions.size(),
                         .indices = size.indices + 3 * item.mesh->triangles.size(),
                         .mask_words = size.mask_words + MaskWordsOf(item)};
    const bool fits = item.surface_index == items.front().surface_index &&
                      2 * next.items <= max_texels && next.mask_words <= max_texels &&
                      next.vertices <= kMaxChunkVertices && next.indices <= kMaxChunkIndices;
    if (size.items > 0 && !fits) {
      break;
    }
    size = next;
  }
  return size;
}

void WriteChunk(std::span<const DrawItem> items, const image::FragmentOrder& order,
                ChunkBuffers out) {
  std::uint32_t first_mask_word = 0;
  std::uint32_t slot = 0;
  std::uint32_t first_vertex = 0;
  for (const DrawItem& item : items) {
    const mesh::CompactMesh& mesh = *item.mesh;
    *out.blocks++ = TexelOf(item, order, first_mask_word);
    if (item.open.has_value()) {
      for (const std::uint64_t word : item.open->words) {
        *out.masks++ = static_cast<std::uint32_t>(word);
        *out.masks++ = static_cast<std::uint32_t>(word >> 32);
      }
      first_mask_word += static_cast<std::uint32_t>(MaskWordsOf(item));
    }
    const std::size_t count = mesh.positions.size();
    out.positions = std::copy_n(mesh.positions.data(), count, out.positions);
    for (const mesh::CompactNormal& normal : mesh.normals) {
      *out.normals++ = {static_cast<float>(normal.x) / mesh::kNormalScale,
                        static_cast<float>(normal.y) / mesh::kNormalScale,
                        static_cast<float>(normal.z) / mesh::kNormalScale};
    }
    out.slots = std::fill_n(out.slots, count, slot);
    for (std::size_t triangle = mesh.triangles.size(); triangle > 0; --triangle) {
      for (const std::uint32_t vertex : mesh.triangles[triangle - 1]) {
        *out.indices++ = first_vertex + vertex;
      }
    }
    first_vertex += static_cast<std::uint32_t>(count);
    ++slot;
  }
}

}  // namespace isoscope::render
