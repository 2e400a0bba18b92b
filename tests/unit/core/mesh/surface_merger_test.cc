#include "core/mesh/surface_merger.h"

#include <memory>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "tests/support/status_matchers.h"

namespace isoscope::mesh {
namespace {

using testing::IsOk;
using testing::StatusIs;

// Hands out what it was given.
class ListSource final : public SurfaceSource {
 public:
  explicit ListSource(std::vector<BlockMesh> blocks, absl::Status end = absl::OkStatus())
      : blocks_(std::move(blocks)), end_(std::move(end)) {}

  absl::StatusOr<bool> Next(BlockMesh* block) override {
    if (next_ == blocks_.size()) {
      if (!end_.ok()) {
        return end_;
      }
      return false;
    }
    *block = blocks_[next_++];
    return true;
  }

 private:
  const std::vector<BlockMesh> blocks_;
  const absl::Status end_;
  std::size_t next_ = 0;
};

volume::GridGeometry Geometry() {
  volume::GridGeometry geometry;
  geometry.sample_dims = {33, 3, 3};
  geometry.spacing = {2, 1, 1};
  geometry.origin = {10, 0, 0};
  return geometry;
}

volume::BlockLayout Layout() {
  return *volume::BlockLayout::Make(Geometry().sample_dims, {4, 4, 4});
}

// A triangle inside of a block, on no face between blocks: three vertices that no other block has.
BlockMesh Triangle(volume::BlockId id, std::size_t copies = 1) {
  BlockMesh block;
  block.block_id = id;
  const auto x = static_cast<float>(4 * id) + 1.5F;
  for (std::size_t copy = 0; copy < copies; ++copy) {
    const auto first = static_cast<std::uint32_t>(block.positions.size());
    for (int i = 0; i < 3; ++i) {
      block.positions.push_back({x, static_cast<float>(i % 2), static_cast<float>(i / 2)});
      block.normals.push_back({1, 0, 0});
    }
    block.indices.insert(block.indices.end(), {first, first + 1, first + 2});
  }
  return block;
}

absl::StatusOr<std::vector<SurfaceChunk>> Export(const volume::GridGeometry& geometry,
                                                 const std::vector<std::vector<BlockMesh>>& agents,
                                                 std::int64_t first_vertex = 0,
                                                 bool has_origin = false) {
  std::vector<std::unique_ptr<ListSource>> owned;
  std::vector<SurfaceSource*> sources;
  for (const auto& blocks : agents) {
    owned.push_back(std::make_unique<ListSource>(blocks));
    sources.push_back(owned.back().get());
  }
  std::vector<SurfaceChunk> chunks;
  std::int64_t sent_count = 0;
  const absl::StatusOr<std::int64_t> vertex_count =
      MergeSurface({.geometry = geometry, .layout = Layout(), .has_origin = has_origin}, sources,
                   first_vertex, [&](SurfaceChunk chunk) {
                     sent_count += static_cast<std::int64_t>(chunk.positions.size() / 12);
                     chunks.push_back(std::move(chunk));
                     return absl::OkStatus();
                   });
  if (!vertex_count.ok()) {
    return vertex_count.status();
  }
  EXPECT_EQ(*vertex_count, sent_count);
  return chunks;
}

TEST(SurfaceMergerTest, TheMeshDoesNotDependOnHowBlocksAreSpread) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto one, Export(Geometry(), {{Triangle(0), Triangle(1), Triangle(2), Triangle(5)}}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto three,
      Export(Geometry(), {{Triangle(1), Triangle(5)}, {}, {Triangle(0), Triangle(2)}}));
  ASSERT_EQ(one.size(), 1u);
  ASSERT_EQ(three.size(), 1u);
  EXPECT_EQ(one[0].positions, three[0].positions);
  EXPECT_EQ(one[0].normals, three[0].normals);
  EXPECT_EQ(one[0].triangles, three[0].triangles);
}

TEST(SurfaceMergerTest, PositionsAreInWorldUnitsAndTrianglesCountOverTheStream) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto chunks,
                                Export(Geometry(), {{Triangle(0)}, {Triangle(1)}}));
  const char* positions = chunks[0].positions.data();
  EXPECT_FLOAT_EQ(base::LoadLittleEndian<float>(positions), 10 + 2 * 1.5F);
  EXPECT_FLOAT_EQ(base::LoadLittleEndian<float>(positions + 36), 10 + 2 * 5.5F);
  ASSERT_EQ(chunks[0].triangles.size(), 48u);
  for (int i = 0; i < 6; ++i) {
    EXPECT_EQ(base::LoadLittleEndian<std::int64_t>(chunks[0].triangles.data() + 8 * i), i);
  }
}

TEST(SurfaceMergerTest, LaterSurfacesCountBehindEarlierOnes) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto chunks,
                                Export(Geometry(), {{Triangle(0)}}, std::int64_t{1} << 40));
  EXPECT_EQ(base::LoadLittleEndian<std::int64_t>(chunks[0].triangles.data() + 8),
            (std::int64_t{1} << 40) + 1);
}

// Far from the origin positions are from one near the volume; without it they would be equal.
TEST(SurfaceMergerTest, PositionsAreFromTheOriginIfOneIsWanted) {
  volume::GridGeometry far = Geometry();
  far.spacing = {0.01, 0.01, 0.01};
  far.origin = {4600000, 500000, 0};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto chunks,
                                Export(far, {{Triangle(0)}, {Triangle(1)}}, 0, true));
  const char* positions = chunks[0].positions.data();
  EXPECT_FLOAT_EQ(base::LoadLittleEndian<float>(positions), 0.015F);
  EXPECT_FLOAT_EQ(base::LoadLittleEndian<float>(positions + 36), 0.055F);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto without, Export(far, {{Triangle(0)}, {Triangle(1)}}));
  EXPECT_EQ(base::LoadLittleEndian<float>(without[0].positions.data() + 36), 4600000);
}

// Blocks of two agents that share a face send its vertices both.
TEST(SurfaceMergerTest, AVertexOnAFaceBetweenBlocksIsSentOnce) {
  BlockMesh first = Triangle(0);
  first.positions = {{4, 1, 1}, {4, 1, 1}, {3, 1, 0.5F}};
  first.copies = {0, 1, 0};
  BlockMesh second = Triangle(1);
  second.positions = {{4, 1, 1}, {5, 1, 1}, {5, 1, 0.5F}};
  second.copies = {1, 0, 0};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto chunks, Export(Geometry(), {{first}, {second}}));
  EXPECT_EQ(chunks[0].positions.size(), 5U * 12);
  EXPECT_EQ(base::LoadLittleEndian<std::int64_t>(chunks[0].triangles.data() + 24), 1);
}

TEST(SurfaceMergerTest, AMirroredGridTurnsTrianglesOver) {
  volume::GridGeometry mirrored = Geometry();
  mirrored.direction.columns[0] = {-1, 0, 0};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto chunks, Export(mirrored, {{Triangle(0)}}));
  const char* triangles = chunks[0].triangles.data();
  EXPECT_EQ(base::LoadLittleEndian<std::int64_t>(triangles), 0);
  EXPECT_EQ(base::LoadLittleEndian<std::int64_t>(triangles + 8), 2);
  EXPECT_EQ(base::LoadLittleEndian<std::int64_t>(triangles + 16), 1);
}

TEST(SurfaceMergerTest, ChunksStayBelowTheirLimitAndUseOnlyVerticesThatWereSent) {
  std::vector<BlockMesh> blocks;
  for (volume::BlockId id = 0; id < 8; ++id) {
    blocks.push_back(Triangle(id, 5000));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto chunks, Export(Geometry(), {blocks}));
  ASSERT_GT(chunks.size(), 1u);
  std::int64_t vertex_count = 0;
  std::size_t triangle_bytes = 0;
  for (const SurfaceChunk& chunk : chunks) {
    EXPECT_LE(chunk.size_bytes(), kSurfaceChunkBytes);
    vertex_count += static_cast<std::int64_t>(chunk.positions.size() / 12);
    triangle_bytes += chunk.triangles.size();
    for (std::size_t i = 0; i < chunk.triangles.size(); i += 8) {
      ASSERT_LT(base::LoadLittleEndian<std::int64_t>(chunk.triangles.data() + i), vertex_count);
    }
  }
  EXPECT_EQ(triangle_bytes, 8u * 5000u * 24u);
}

TEST(SurfaceMergerTest, NoSurfaceIsNoChunk) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto chunks, Export(Geometry(), {{}, {}}));
  EXPECT_TRUE(chunks.empty());
}

TEST(SurfaceMergerTest, BlocksSentTwiceOrOutOfOrderAreRefused) {
  EXPECT_THAT(Export(Geometry(), {{Triangle(3)}, {Triangle(3)}}),
              StatusIs(absl::StatusCode::kInternal));
  EXPECT_THAT(Export(Geometry(), {{Triangle(4), Triangle(2)}}),
              StatusIs(absl::StatusCode::kInternal));
}

TEST(SurfaceMergerTest, ErrorsOfSourcesAndOfTheReceiverEndIt) {
  ListSource bad({Triangle(0)}, absl::DataLossError("block 1"));
  const auto ignore = [](SurfaceChunk) { return absl::OkStatus(); };
  const SurfaceGrid grid{.geometry = Geometry(), .layout = Layout()};
  EXPECT_THAT(MergeSurface(grid, {&bad}, 0, ignore), StatusIs(absl::StatusCode::kDataLoss));
  ListSource good({Triangle(0)});
  const auto refuse = [](SurfaceChunk) { return absl::CancelledError("gone"); };
  EXPECT_THAT(MergeSurface(grid, {&good}, 0, refuse), StatusIs(absl::StatusCode::kCancelled));
}

}  // namespace
}  // namespace isoscope::mesh
