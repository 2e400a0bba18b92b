// The meshes whose pixels are not shaded yet, by the ids of their triangles.

#ifndef ISOSCOPE_CORE_RENDER_MESH_REGISTER_H_
#define ISOSCOPE_CORE_RENDER_MESH_REGISTER_H_

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/base/mutex.h"
#include "core/render/fragment_shader.h"

namespace isoscope::render {

// Primitive ids count the triangles of all kept meshes, in the order in which the meshes came. The
// ids of a mesh begin at a multiple of kPrimitiveUnit, so that a table finds the mesh of an id.
// Keep is thread-safe; the other functions are, while no thread keeps.
class MeshRegister {
 public:
  static constexpr std::uint32_t kPrimitiveUnit = 64;

  // Keeps the meshes until Clear, and moves them out of `meshes`. Appends the id of the first
  // triangle of each to `first_primitive_ids`.
  void Keep(std::span<ShadedMesh> meshes, std::vector<std::uint32_t>* first_primitive_ids);

  // Finds the meshes of the fragments of a list, and prefetches their triangles.
  void FindMeshes(ShadeList* list) const;

  // Since Clear; these two are thread-safe.
  [[nodiscard]] std::size_t kept_bytes() const {
    return kept_bytes_.load(std::memory_order_relaxed);
  }
  [[nodiscard]] std::uint64_t primitive_count() const {
    return primitive_count_.load(std::memory_order_relaxed);
  }
  void Clear();
  [[nodiscard]] std::size_t size_bytes() const {
    return meshes_.capacity() * sizeof(meshes_[0]) +
           mesh_of_unit_.capacity() * sizeof(mesh_of_unit_[0]);
  }

 private:
  base::Mutex mutex_;  // guards the vectors while meshes are kept, and orders the writers below
  std::vector<ShadedMesh> meshes_;
  std::vector<std::uint32_t> mesh_of_unit_;  // by primitive id / kPrimitiveUnit
  std::atomic<std::uint64_t> primitive_count_{0};
  std::atomic<std::size_t> kept_bytes_{0};
};

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_MESH_REGISTER_H_
