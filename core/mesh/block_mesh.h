// The isosurface inside one block, as extraction makes it.

#ifndef ISOSCOPE_CORE_MESH_BLOCK_MESH_H_
#define ISOSCOPE_CORE_MESH_BLOCK_MESH_H_

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/math/vec.h"
#include "core/volume/block_layout.h"

namespace isoscope::mesh {

// Indexed triangles. Thread-compatible.
struct BlockMesh {
  volume::BlockId block_id = 0;
  // In index space (samples). A vertex that two blocks share has the same bits in both.
  std::vector<math::Vec3f> positions;
  // One for each position: world space, unit length, the direction in which the field falls; or
  // (0, 0, 0) where the gradient vanishes or is not finite.
  std::vector<math::Vec3f> normals;
  // Three vertex indices for each triangle, counter-clockwise in index space seen from the side
  // where the field is below the isovalue.
  std::vector<std::uint32_t> indices;
  // Empty, or one for each position: the key of the grid edge that the vertex lies on,
  // 3 * (linear index of the edge's lower sample in the volume) + axis. Equal keys mean one vertex.
  std::vector<std::int64_t> edge_keys;
  // Copy numbers of a mesh for exports (core/solid): vertices of equal position and copy number are
  // one, in all blocks. One number for each position, or empty: all are 0.
  std::vector<std::uint8_t> copies;
  // Crossed grid edges that count for this block. Their sum over all blocks is the number of unique
  // vertices (docs/numerics.md, "Unique vertex count").
  std::int64_t owned_vertex_count = 0;

  [[nodiscard]] std::int64_t triangle_count() const {
    return static_cast<std::int64_t>(indices.size() / 3);
  }
  [[nodiscard]] std::size_t size_bytes() const {
    return positions.size() * sizeof(math::Vec3f) + normals.size() * sizeof(math::Vec3f) +
           indices.size() * sizeof(std::uint32_t) + edge_keys.size() * sizeof(std::int64_t) +
           copies.size();
  }
};

// A non-owning view of a value for each vertex, for the colour of a surface: floats or doubles.
class VertexValues {
 public:
  VertexValues() = default;
  explicit VertexValues(std::span<const float> values) : narrow_(values) {}
  explicit VertexValues(std::span<const double> values) : wide_(values) {}

  [[nodiscard]] std::size_t size() const { return narrow_.size() + wide_.size(); }
  [[nodiscard]] bool empty() const { return size() == 0; }
  [[nodiscard]] std::size_t size_bytes() const { return narrow_.size_bytes() + wide_.size_bytes(); }
  // REQUIRES: vertex < size().
  double operator[](std::size_t vertex) const {
    return wide_.empty() ? static_cast<double>(narrow_[vertex]) : wide_[vertex];
  }
  // All values: one of the two is empty.
  [[nodiscard]] std::span<const float> narrow() const { return narrow_; }
  [[nodiscard]] std::span<const double> wide() const { return wide_; }

 private:
  std::span<const float> narrow_;
  std::span<const double> wide_;
};

// A non-owning view of a BlockMesh.
struct BlockMeshView {
  BlockMeshView() = default;
  BlockMeshView(const BlockMesh& mesh)  // NOLINT(google-explicit-constructor): as std::span
      : block_id(mesh.block_id),
        owned_vertex_count(mesh.owned_vertex_count),
        positions(mesh.positions),
        normals(mesh.normals),
        indices(mesh.indices) {}

  [[nodiscard]] std::int64_t triangle_count() const {
    return static_cast<std::int64_t>(indices.size() / 3);
  }

  volume::BlockId block_id = 0;
  std::int64_t owned_vertex_count = 0;
  std::span<const math::Vec3f> positions;
  std::span<const math::Vec3f> normals;
  std::span<const std::uint32_t> indices;
  // Empty, or one for each position: the length of the gradient, in field units per world unit,
  // finite, 0 where there is no normal; or the value of another field, which may be infinite or
  // NaN.
  VertexValues values;
};

}  // namespace isoscope::mesh

#endif  // ISOSCOPE_CORE_MESH_BLOCK_MESH_H_
