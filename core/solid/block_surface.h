// The surface of one block as exports have it: cut at the clip region, without triangles that have
// no area, closed if that is wanted, and a manifold. Pictures draw what extract::BlockExtractor
// makes.
//
// docs/numerics.md, "Surfaces of exports", defines it.

#ifndef ISOSCOPE_CORE_SOLID_BLOCK_SURFACE_H_
#define ISOSCOPE_CORE_SOLID_BLOCK_SURFACE_H_

#include <cstdint>
#include <initializer_list>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "absl/container/flat_hash_map.h"

#include "core/extract/block_extractor.h"
#include "core/extract/block_shape.h"
#include "core/mesh/block_mesh.h"
#include "core/mesh/world_placement.h"
#include "core/solid/block_field.h"
#include "core/solid/cell_pieces.h"
#include "core/solid/seams.h"
#include "core/solid/solid_complex.h"
#include "core/solid/surface_fans.h"
#include "core/solid/surface_sums.h"
#include "core/solid/vertex_pool.h"
#include "core/view/clip_region.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_samples.h"
#include "core/volume/block_spans.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/inside_rule.h"

namespace isoscope::solid {

struct SurfaceOptions {
  view::ClipRegion clip = {};
  // Whether the surface is closed where its solid ends: at the border of the volume, of the clip
  // region, and at cells that touch NaN.
  bool closes = false;
};

// Returns true if a block may have a part of the closed surface: if it has something inside, and is
// active, at the border of the volume, cut, or of floats, which may be NaN.
bool MayHaveSurface(const volume::BlockLayout& layout, volume::BlockId id,
                    volume::BlockSpans* spans, const volume::InsideRule& rule,
                    const view::Clipper& clipper);

// Holds scratch space that grows to the largest block and is reused. Thread-compatible: each thread
// has its own.
class BlockSurface {
 public:
  // shapes: those of `layout`
  BlockSurface(const volume::GridGeometry& geometry, const volume::BlockLayout& layout,
               std::shared_ptr<const extract::BlockShapes> shapes, const SurfaceOptions& options);

  // Replaces `mesh` by the part of the surface in the block's cells, without edge keys, and adds
  // that part to `sums`, which may be null.
  // REQUIRES: without half-spaces or box, if the rule is smooth: cuts would need the samples around
  // the ghost layer.
  // Vertices are told apart by position and copy number (mesh::BlockMesh::copies). Each side of a
  // triangle is that of one more triangle, which may be another block's, or open.
  void Extract(const volume::BlockSamples& samples, const volume::InsideRule& rule,
               mesh::BlockMesh* mesh, SurfaceSums* sums);

 private:
  // A vertex of the new mesh.
  struct MeshVertex {
    math::Vec3f position;
    math::Vec3f normal;
    std::pair<int, std::uint32_t> order;
    std::uint8_t copy = 0;
  };

  // A corner of a piece; without a part it is the middle of one.
  struct Corner {
    std::uint32_t vertex = 0;
    std::optional<PartId> part;
  };

  // Returns true if the mesh of the extractor is the surface, as it is.
  [[nodiscard]] bool IsWhole(const mesh::BlockMesh& mesh, view::Clipper::Side side) const;
  // Returns true if a vertex may coincide with another one.
  [[nodiscard]] bool HasTies(const mesh::BlockMesh& mesh) const;
  void MakeMesh(mesh::BlockMesh* mesh);
  // Returns true if a cell of the block has pieces.
  [[nodiscard]] bool HasPieces(const math::Index3& cell) const;
  // Adds the triangles of a piece to indices_.
  void AddPiece(PieceId piece);
  // Does so if corners_ has more than three.
  void AddPolygon(PieceId piece);
  // Return vertices of the mesh, which are made on first use.
  std::uint32_t VertexOf(PartId corner);
  std::uint32_t MiddleVertexOf(PartId part, std::uint8_t copy);
  std::uint32_t CenterVertexOf(PieceId piece);
  [[nodiscard]] MeshVertex MeanOf(std::initializer_list<std::uint32_t> vertices,
                                  std::uint8_t copy) const;
  MeshVertex VertexOfFan(FanId fan);
  [[nodiscard]] math::Vec3f NormalOfTag(Tag tag) const;
  void SortVertices(mesh::BlockMesh* mesh);
  void AddSums(const mesh::BlockMesh& mesh, SurfaceSums* sums);
  // Counts the sides of triangles that lie where the volume ends, or at NaN.
  [[nodiscard]] std::int64_t CountOpenSides() const;
  [[nodiscard]] std::int64_t CountOpenSidesOf(const math::Index3& cell) const;

  const volume::BlockLayout layout_;
  const mesh::WorldPlacement placement_;
  const math::Mat3d to_world_;   // takes gradients from index to world space
  const math::Vec3d reference_;  // of volumes: a corner of the volume, world space
  const bool is_mirrored_;
  const view::Clipper clipper_;
  const bool closes_;
  extract::BlockExtractor extractor_;
  BlockField field_;
  VertexPool pool_;
  SolidComplex complex_;
  Seams seams_;
  SurfaceFans fans_;
  // State of the block in work.
  std::vector<MeshVertex> vertices_;
  std::vector<std::uint32_t> indices_;
  std::vector<Corner> corners_;                 // of the piece in work
  std::vector<std::uint32_t> vertex_of_plain_;  // by vertex of the pool
  std::vector<std::uint32_t> vertex_of_fan_;
  absl::flat_hash_map<PartId, std::uint32_t> vertex_of_middle_;  // by the lower of both parts
  std::vector<math::Vec3d> places_;
  std::int64_t open_side_count_ = 0;
};

}  // namespace isoscope::solid

#endif  // ISOSCOPE_CORE_SOLID_BLOCK_SURFACE_H_
