// The vertices of one block's solid, each once: those on crossed grid edges, inside samples, and
// those that cuts make.

#ifndef ISOSCOPE_CORE_SOLID_VERTEX_POOL_H_
#define ISOSCOPE_CORE_SOLID_VERTEX_POOL_H_

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "absl/container/flat_hash_map.h"

#include "core/math/vec.h"
#include "core/mesh/block_mesh.h"
#include "core/mesh/world_placement.h"
#include "core/solid/block_field.h"
#include "core/view/clip_region.h"

namespace isoscope::solid {

using VertexId = std::uint32_t;

struct SolidVertex {
  math::Vec3f position;  // index space; of smooth labels before they are smoothed
  // Two vertices coincide iff these are equal: the position as a file has it.
  math::Vec3d place;
  // The normal of the surface, world space. Known on grid edges of the block's own cells, and on
  // cuts between such; else (0, 0, 0).
  math::Vec3f normal;
  // Order of vertices in a mesh: those of the grid as the extractor has them, then those of the
  // first half-space, of the second, ...
  std::pair<int, std::uint32_t> order;
};

// Reused for many blocks of a volume. Thread-compatible.
class VertexPool {
 public:
  explicit VertexPool(const mesh::WorldPlacement& placement) : placement_(placement) {}

  // Drops all vertices. `mesh`: the block's, with edge keys, for normals and order. Both must
  // outlive the next calls.
  void Begin(const BlockField& field, const mesh::BlockMesh& mesh);

  // Return the vertex, which is made on first use.
  //
  // REQUIRES: the edge from `lower` along `axis` is crossed.
  VertexId OnEdge(SampleIndex lower, int axis);
  VertexId AtSample(SampleIndex sample);
  // The vertex where an edge meets the border of a half-space.
  // inside, outside: its ends; cut_rank: as Cut::rank
  VertexId OnCut(VertexId inside, VertexId outside, const view::HalfSpace& half_space,
                 int cut_rank);

  [[nodiscard]] const SolidVertex& operator[](VertexId id) const { return vertices_[id]; }
  // Returns the position that the mesh gets. It differs only for a smooth rule: all pieces are made of
  // the middles of edges, and moved when they are done.
  [[nodiscard]] math::Vec3f MeshPositionOf(VertexId id) const;
  [[nodiscard]] bool Coincide(VertexId a, VertexId b) const {
    return vertices_[a].place == vertices_[b].place;
  }
  // The grid edge of a vertex, 3 * its lower sample + axis; kNoEdge of other vertices.
  static constexpr std::uint32_t kNoEdge = 0xffffffff;
  [[nodiscard]] std::uint32_t EdgeOf(VertexId id) const { return edge_of_vertex_[id]; }

 private:
  static constexpr VertexId kNone = 0xffffffff;

  VertexId Add(const math::Vec3f& position, const math::Vec3f& normal,
               std::pair<int, std::uint32_t> order, std::uint32_t edge);
  [[nodiscard]] math::Vec3f PositionOnEdge(SampleIndex lower, int axis) const;

  const mesh::WorldPlacement placement_;
  const BlockField* field_ = nullptr;
  const mesh::BlockMesh* mesh_ = nullptr;
  std::vector<SolidVertex> vertices_;
  std::vector<std::uint32_t> edge_of_vertex_;
  std::vector<std::uint32_t> mesh_vertices_;  // of `mesh_`, by 3 * sample + axis, or kNone
  std::vector<VertexId> on_edges_;            // by 3 * sample + axis, or kNone
  std::vector<VertexId> at_samples_;          // by sample, or kNone
  absl::flat_hash_map<std::pair<VertexId, VertexId>, VertexId> on_cuts_;
};

}  // namespace isoscope::solid

#endif  // ISOSCOPE_CORE_SOLID_VERTEX_POOL_H_
