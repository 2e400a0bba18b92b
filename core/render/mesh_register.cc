#include "core/render/mesh_register.h"

#include <utility>

#include "core/base/check.h"
#include "core/render/fragment_plane.h"

namespace isoscope::render {

void MeshRegister::Keep(std::span<ShadedMesh> meshes,
                        std::vector<std::uint32_t>* first_primitive_ids) {
  const base::MutexLock lock(&mutex_);
  for (ShadedMesh& mesh : meshes) {
    const std::size_t units = (mesh.triangles.size() + kPrimitiveUnit - 1) / kPrimitiveUnit;
    const std::uint64_t first = primitive_count();
    // Several threads may find the pass not full and add meshes. There is room for all of them.
    const std::uint64_t end = first + std::uint64_t{units} * kPrimitiveUnit;
    ISOSCOPE_CHECK_LT(end, std::uint64_t{kShaded});
    primitive_count_.store(end, std::memory_order_relaxed);
    kept_bytes_.fetch_add(mesh.mesh->size_bytes(), std::memory_order_relaxed);
    mesh_of_unit_.insert(mesh_of_unit_.end(), units, static_cast<std::uint32_t>(meshes_.size()));
    mesh.first_primitive_id = static_cast<std::uint32_t>(first);
    first_primitive_ids->push_back(mesh.first_primitive_id);
    meshes_.push_back(std::move(mesh));
  }
}

void MeshRegister::FindMeshes(ShadeList* list) const {
  for (std::size_t i = 0; i < list->batch.count; ++i) {
    const std::uint32_t id = list->primitive_ids[i];
    const ShadedMesh& mesh = meshes_[mesh_of_unit_[id / kPrimitiveUnit]];
    list->meshes[i] = &mesh;
    const std::size_t corner = 3 * std::size_t{id - mesh.first_primitive_id};
    if (mesh.triangles.small() != nullptr) {
      __builtin_prefetch(mesh.triangles.small() + corner);
    } else {
      __builtin_prefetch(mesh.triangles.large() + corner);
    }
  }
}

void MeshRegister::Clear() {
  meshes_.clear();
  mesh_of_unit_.clear();
  primitive_count_.store(0, std::memory_order_relaxed);
  kept_bytes_.store(0, std::memory_order_relaxed);
}

}  // namespace isoscope::render
