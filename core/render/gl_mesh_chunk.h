// The meshes that GlMeshDrawer uploads and draws at once: how many, and their bytes. No calls of
// OpenGL.
//
// A chunk has six buffers:
//
//   positions  vertex   3 floats, index space
//   normals    vertex   3 floats, world space
//   slots      vertex   the index of its item in the chunk, which finds the item in `blocks`
//   indices    corner   the triangles of each item from the last to the first
//   blocks     item     BlockTexel, which the shader reads as two texels of 4 x 32 bits
//   masks      item     its open pixels, a bit a cell, in words of 32 bits

#ifndef ISOSCOPE_CORE_RENDER_GL_MESH_CHUNK_H_
#define ISOSCOPE_CORE_RENDER_GL_MESH_CHUNK_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "core/image/fragment.h"
#include "core/image/pixel_mask.h"
#include "core/math/vec.h"
#include "core/mesh/compact_mesh.h"
#include "core/view/view.h"

namespace isoscope::render {

// A mesh, the pixels that its block can cover, and the pixels that it may still win.
struct DrawItem {
  std::shared_ptr<const mesh::CompactMesh> mesh;
  std::uint32_t surface_index = 0;
  view::Footprint footprint;
  std::optional<image::PixelMask> open;
};

// The sizes of the buffers, in elements.
struct ChunkSize {
  std::size_t items = 0;
  std::size_t vertices = 0;
  std::size_t indices = 0;
  std::size_t mask_words = 0;  // of 32 bits

  friend bool operator==(const ChunkSize&, const ChunkSize&) = default;
};

// Chunks are large enough that calls cost nothing. They are small enough that their buffers stay in
// the processor's cache, and that a cancellation is noticed within milliseconds.
inline constexpr std::size_t kMaxChunkVertices = 1 << 17;
inline constexpr std::size_t kMaxChunkIndices = 1 << 19;

// Returns the size of the chunk that `items` begin with: those of one surface that fit the limits
// above and have at most `max_texels` texels and mask words. One item may be larger, and is a
// chunk. REQUIRES: `items` is not empty.
ChunkSize NextChunk(std::span<const DrawItem> items, std::size_t max_texels);

// The facts about an item that the fragment shader reads: two texels.
struct BlockTexel {
  static constexpr std::uint32_t kNoMask = 0xffffffff;

  std::uint32_t owner = 0;
  std::uint32_t nearest_depth_bits = 0;
  std::uint32_t first_pixel = 0;
  std::uint32_t end_pixel = 0;
  std::uint32_t mask_first_word = kNoMask;  // index of a 32-bit word of `masks`
  std::uint32_t mask_shift = 0;
  std::uint32_t mask_first_cell = 0;
  std::uint32_t mask_cells = 0;
};
static_assert(sizeof(BlockTexel) == 32);

// The mapped buffers of a chunk, each with room for all of its items.
struct ChunkBuffers {
  math::Vec3f* positions = nullptr;
  math::Vec3f* normals = nullptr;
  std::uint32_t* slots = nullptr;
  std::uint32_t* indices = nullptr;
  BlockTexel* blocks = nullptr;
  std::uint32_t* masks = nullptr;
};

// Writes the items of a chunk to its buffers.
void WriteChunk(std::span<const DrawItem> items, const image::FragmentOrder& order,
                ChunkBuffers out);

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_GL_MESH_CHUNK_H_
