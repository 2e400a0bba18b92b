// The surface of a block as caches keep it and renderers draw it: 18 bytes a vertex and 6 a
// triangle, where a BlockMesh takes 24 and 12. A surface that shows values of vertices has 4 or 8
// bytes more for each vertex.

#ifndef ISOSCOPE_CORE_MESH_COMPACT_MESH_H_
#define ISOSCOPE_CORE_MESH_COMPACT_MESH_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "core/math/vec.h"
#include "core/mesh/block_mesh.h"
#include "core/volume/block_layout.h"

namespace isoscope::mesh {

// A normal times kNormalScale, each component rounded to the nearest integer, halves away from
// zero: the error of a component is at most 1.6e-5.
using CompactNormal = math::Vec3<std::int16_t>;
inline constexpr float kNormalScale = 32767.0F;

// A non-owning view of three vertex indices for each triangle: 16-bit indices for meshes of at most
// 65 536 vertices, else 32-bit ones.
class TriangleVertices {
 public:
  TriangleVertices() = default;
  explicit TriangleVertices(std::span<const std::uint16_t> indices)
      : small_(indices.data()), count_(indices.size() / 3) {}
  explicit TriangleVertices(std::span<const std::uint32_t> indices)
      : large_(indices.data()), count_(indices.size() / 3) {}

  [[nodiscard]] std::size_t size() const { return count_; }
  [[nodiscard]] bool empty() const { return count_ == 0; }
  [[nodiscard]] std::size_t size_bytes() const {
    return 3 * count_ * (small_ != nullptr ? sizeof(*small_) : sizeof(*large_));
  }
  // REQUIRES: triangle < size().
  std::array<std::uint32_t, 3> operator[](std::size_t triangle) const {
    const std::size_t i = 3 * triangle;
    return small_ != nullptr
               ? std::array<std::uint32_t, 3>{small_[i], small_[i + 1], small_[i + 2]}
               : std::array<std::uint32_t, 3>{large_[i], large_[i + 1], large_[i + 2]};
  }
  // The indices of all triangles, one after the other: one of the two is null.
  [[nodiscard]] const std::uint16_t* small() const { return small_; }
  [[nodiscard]] const std::uint32_t* large() const { return large_; }

 private:
  const std::uint16_t* small_ = nullptr;
  const std::uint32_t* large_ = nullptr;
  std::size_t count_ = 0;
};

// A non-owning view of a mesh; order and meaning are those of BlockMesh. Trivially destructible.
struct CompactMesh {
  [[nodiscard]] std::int64_t triangle_count() const {
    return static_cast<std::int64_t>(triangles.size());
  }
  [[nodiscard]] std::size_t size_bytes() const {
    return positions.size_bytes() + normals.size_bytes() + triangles.size_bytes() +
           values.size_bytes();
  }

  volume::BlockId block_id = 0;
  std::int64_t owned_vertex_count = 0;
  std::span<const math::Vec3f> positions;
  std::span<const CompactNormal> normals;
  TriangleVertices triangles;
  VertexValues values;  // or empty
};

// Returns the bytes that CompactInto needs: a multiple of 64.
std::size_t CompactSizeBytes(const BlockMeshView& mesh);

// Makes a CompactMesh at the start of `memory`, with its vertices and triangles behind it. The
// result lives as long as `memory`.
//
// memory: CompactSizeBytes(mesh) bytes, aligned as from operator new
//
// REQUIRES: one normal for each position, with components in [-1, 1]; as many values, or none;
// vertex indices are in range.
const CompactMesh* CompactInto(const BlockMeshView& mesh, char* memory);

// Makes a CompactMesh in memory that the result owns.
std::shared_ptr<const CompactMesh> Compact(const BlockMeshView& mesh);

}  // namespace isoscope::mesh

#endif  // ISOSCOPE_CORE_MESH_COMPACT_MESH_H_
