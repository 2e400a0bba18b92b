#include "core/render/gl_mesh_chunk.h"

#include <bit>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::render {
namespace {

constexpr std::size_t kManyTexels = std::size_t{1} << 27;

// The arrays that a mesh is a view of.
struct MeshArrays {
  std::vector<math::Vec3f> positions;
  std::vector<mesh::CompactNormal> normals;
  std::vector<std::uint16_t> indices;
};

DrawItem MakeItem(const MeshArrays& arrays, std::uint32_t surface_index, std::uint32_t block_id) {
  auto mesh = std::make_shared<mesh::CompactMesh>();
  mesh->block_id = block_id;
  mesh->positions = arrays.positions;
  mesh->normals = arrays.normals;
  mesh->triangles = mesh::TriangleVertices(arrays.indices);
  return {.mesh = std::move(mesh), .surface_index = surface_index, .footprint = {}, .open = {}};
}

// `vertices` vertices, and so many triangles of the first ones.
MeshArrays MakeArrays(std::size_t vertices, std::size_t triangles) {
  MeshArrays arrays;
  for (std::size_t i = 0; i < vertices; ++i) {
    arrays.positions.push_back({static_cast<float>(i), 0, 0});
    arrays.normals.push_back({0, 32767, static_cast<std::int16_t>(-32767)});
  }
  for (std::size_t i = 0; i < triangles; ++i) {
    arrays.indices.insert(arrays.indices.end(), {0, 1, static_cast<std::uint16_t>(2 + i)});
  }
  return arrays;
}

TEST(GlMeshChunkTest, AChunkEndsAtTheNextSurface) {
  const MeshArrays arrays = MakeArrays(4, 2);
  const std::vector<DrawItem> items = {MakeItem(arrays, 1, 9), MakeItem(arrays, 1, 8),
                                       MakeItem(arrays, 0, 9)};
  EXPECT_EQ(NextChunk(items, kManyTexels),
            (ChunkSize{.items = 2, .vertices = 8, .indices = 12, .mask_words = 0}));
  EXPECT_EQ(NextChunk(std::span(items).subspan(2), kManyTexels).items, 1U);
}

TEST(GlMeshChunkTest, AChunkIsNoLargerThanItsLimitsUnlessItIsOneItem) {
  const MeshArrays half = MakeArrays(kMaxChunkVertices / 2, 1);
  EXPECT_EQ(NextChunk(std::vector<DrawItem>(3, MakeItem(half, 0, 0)), kManyTexels).items, 2U);
  const MeshArrays many = MakeArrays(3, kMaxChunkIndices / 3 / 2 + 1);
  EXPECT_EQ(NextChunk(std::vector<DrawItem>(3, MakeItem(many, 0, 0)), kManyTexels).items, 1U);
  const MeshArrays large = MakeArrays(kMaxChunkVertices + 1, 1);
  const std::vector<DrawItem> alone(2, MakeItem(large, 0, 0));
  EXPECT_EQ(NextChunk(alone, kManyTexels).items, 1U);
  EXPECT_EQ(NextChunk(alone, kManyTexels).vertices, kMaxChunkVertices + 1);
  // Two texels an item.
  const MeshArrays small = MakeArrays(3, 1);
  EXPECT_EQ(NextChunk(std::vector<DrawItem>(9, MakeItem(small, 0, 0)), 8).items, 4U);
  DrawItem masked = MakeItem(small, 0, 0);
  masked.open = image::PixelMask{.columns = 8, .rows = 16, .words = {1, 2}};
  EXPECT_EQ(NextChunk(std::vector<DrawItem>(9, masked), 11),
            (ChunkSize{.items = 2, .vertices = 6, .indices = 6, .mask_words = 8}));
}

TEST(GlMeshChunkTest, BuffersHaveTheItemsOneAfterTheOther) {
  const MeshArrays first = MakeArrays(4, 2);
  const MeshArrays second = MakeArrays(3, 1);
  std::vector<DrawItem> items = {MakeItem(first, 2, 5), MakeItem(second, 2, 3),
                                 MakeItem(second, 2, 1)};
  items[0].footprint = {.rect = {.begin_x = 1, .begin_y = 2, .end_x = 30, .end_y = 40},
                        .nearest_depth = 0.25F};
  for (const std::size_t i : {1U, 2U}) {
    items[i].open = image::PixelMask{.shift = 3,
                                     .begin_column = 4,
                                     .begin_row = 5,
                                     .columns = 6,
                                     .rows = 7,
                                     .words = {0x1111111122222222ULL * i}};
  }
  const ChunkSize size = NextChunk(items, kManyTexels);
  ASSERT_EQ(size, (ChunkSize{.items = 3, .vertices = 10, .indices = 12, .mask_words = 4}));
  std::vector<math::Vec3f> positions(size.vertices);
  std::vector<math::Vec3f> normals(size.vertices);
  std::vector<std::uint32_t> slots(size.vertices);
  std::vector<std::uint32_t> indices(size.indices);
  std::vector<BlockTexel> blocks(size.items);
  std::vector<std::uint32_t> masks(size.mask_words);
  WriteChunk(items, {.block_count = 10},
             {.positions = positions.data(),
              .normals = normals.data(),
              .slots = slots.data(),
              .indices = indices.data(),
              .blocks = blocks.data(),
              .masks = masks.data()});

  EXPECT_EQ(positions[3], (math::Vec3f{3, 0, 0}));
  EXPECT_EQ(positions[4], (math::Vec3f{0, 0, 0}));
  EXPECT_EQ(normals[9], (math::Vec3f{0, 1, -1}));
  EXPECT_EQ(slots, (std::vector<std::uint32_t>{0, 0, 0, 0, 1, 1, 1, 2, 2, 2}));
  EXPECT_EQ(indices, (std::vector<std::uint32_t>{0, 1, 3, 0, 1, 2, 4, 5, 6, 7, 8, 9}))
      << "the triangles of an item come from the last to the first";
  EXPECT_EQ(masks, (std::vector<std::uint32_t>{0x22222222, 0x11111111, 0x44444444, 0x22222222}));

  EXPECT_EQ(blocks[0].owner, 25U);
  EXPECT_EQ(blocks[0].nearest_depth_bits, std::bit_cast<std::uint32_t>(0.25F));
  EXPECT_EQ(blocks[0].first_pixel, 1U | 2U << 16);
  EXPECT_EQ(blocks[0].end_pixel, 30U | 40U << 16);
  EXPECT_EQ(blocks[0].mask_first_word, BlockTexel::kNoMask);
  EXPECT_EQ(blocks[1].owner, 23U);
  EXPECT_EQ(blocks[1].mask_first_word, 0U);
  EXPECT_EQ(blocks[1].mask_shift, 3U);
  EXPECT_EQ(blocks[1].mask_first_cell, 4U | 5U << 16);
  EXPECT_EQ(blocks[1].mask_cells, 6U | 7U << 16);
  EXPECT_EQ(blocks[2].mask_first_word, 2U);
}

}  // namespace
}  // namespace isoscope::render
