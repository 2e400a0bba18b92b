// A compact mesh is one piece of memory; each section begins at a multiple of 64 bytes:
//
//        CompactMesh | positions, 3 x float | normals, 3 x int16 | vertex indices, uint16 or uint32
//        | values of vertices, float or double, if there are any
//
// Example: 100 vertices and 180 triangles take 1200 + 600 + 1080 bytes of data: sections of 1216,
// 640 and 1088 bytes behind the CompactMesh.
//
// Vertex indices have 16 bits if there are at most 65 536 vertices. Normals are rounded to
// multiples of 1/32767, by adding 1/2 with the sign of the value and truncating: the same bits on
// any processor.

#include "core/mesh/compact_mesh.h"

#include <algorithm>
#include <cmath>
#include <new>
#include <span>

#include "core/base/check.h"

namespace isoscope::mesh {
namespace {

// Sections begin at cache lines, if the memory does.
constexpr std::size_t kAlignment = 64;

std::size_t Aligned(std::size_t size) { return (size + kAlignment - 1) / kAlignment * kAlignment; }

bool HasSmallIndices(const BlockMeshView& mesh) {
  return mesh.positions.size() <= std::size_t{1} << 16;
}

std::size_t IndexBytes(const BlockMeshView& mesh) {
  return mesh.indices.size() *
         (HasSmallIndices(mesh) ? sizeof(std::uint16_t) : sizeof(std::uint32_t));
}

// A plain loop, which compilers turn into SIMD.
void PackNormals(std::span<const math::Vec3f> normals, CompactNormal* out) {
  if (normals.empty()) {
    return;
  }
  const float* const from = &normals.front().x;
  std::int16_t* const to = &out->x;
  for (std::size_t i = 0; i < 3 * normals.size(); ++i) {
    const float scaled = from[i] * kNormalScale;
    to[i] =
        static_cast<std::int16_t>(static_cast<std::int32_t>(scaled + std::copysign(0.5F, scaled)));
  }
}

template <typename T>
VertexValues CopyValues(std::span<const T> values, char* memory) {
  auto* const to = reinterpret_cast<T*>(memory);
  std::copy(values.begin(), values.end(), to);
  return VertexValues(std::span<const T>(to, values.size()));
}

}  // namespace

std::size_t CompactSizeBytes(const BlockMeshView& mesh) {
  return Aligned(sizeof(CompactMesh)) + Aligned(mesh.positions.size() * sizeof(math::Vec3f)) +
         Aligned(mesh.positions.size() * sizeof(CompactNormal)) + Aligned(IndexBytes(mesh)) +
         Aligned(mesh.values.size_bytes());
}

const CompactMesh* CompactInto(const BlockMeshView& mesh, char* memory) {
  static_assert(sizeof(math::Vec3f) == 3 * sizeof(float));
  static_assert(sizeof(CompactNormal) == 3 * sizeof(std::int16_t));
  ISOSCOPE_CHECK_EQ(mesh.positions.size(), mesh.normals.size());
  auto* const compact = new (memory) CompactMesh();
  compact->block_id = mesh.block_id;
  compact->owned_vertex_count = mesh.owned_vertex_count;
  memory += Aligned(sizeof(CompactMesh));

  const std::size_t vertex_count = mesh.positions.size();
  auto* const positions = reinterpret_cast<math::Vec3f*>(memory);
  std::copy(mesh.positions.begin(), mesh.positions.end(), positions);
  compact->positions = {positions, vertex_count};
  memory += Aligned(compact->positions.size_bytes());

  auto* const normals = reinterpret_cast<CompactNormal*>(memory);
  PackNormals(mesh.normals, normals);
  compact->normals = {normals, vertex_count};
  memory += Aligned(compact->normals.size_bytes());

  if (HasSmallIndices(mesh)) {
    auto* const indices = reinterpret_cast<std::uint16_t*>(memory);
    std::transform(mesh.indices.begin(), mesh.indices.end(), indices,
                   [](std::uint32_t index) { return static_cast<std::uint16_t>(index); });
    compact->triangles =
        TriangleVertices(std::span<const std::uint16_t>(indices, mesh.indices.size()));
  } else {
    auto* const indices = reinterpret_cast<std::uint32_t*>(memory);
    std::copy(mesh.indices.begin(), mesh.indices.end(), indices);
    compact->triangles =
        TriangleVertices(std::span<const std::uint32_t>(indices, mesh.indices.size()));
  }
  if (!mesh.values.empty()) {
    ISOSCOPE_CHECK_EQ(mesh.values.size(), vertex_count);
    memory += Aligned(IndexBytes(mesh));
    compact->values = mesh.values.wide().empty() ? CopyValues(mesh.values.narrow(), memory)
                                                 : CopyValues(mesh.values.wide(), memory);
  }
  return compact;
}

std::shared_ptr<const CompactMesh> Compact(const BlockMeshView& mesh) {
  const auto memory = std::make_shared_for_overwrite<char[]>(CompactSizeBytes(mesh));
  return {memory, CompactInto(mesh, memory.get())};
}

}  // namespace isoscope::mesh
