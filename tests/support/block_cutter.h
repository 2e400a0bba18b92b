// Cuts a volume in memory into blocks, as the partitioner does on disk.

#ifndef ISOSCOPE_TESTS_SUPPORT_BLOCK_CUTTER_H_
#define ISOSCOPE_TESTS_SUPPORT_BLOCK_CUTTER_H_

#include <cstddef>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"

#include "core/extract/block_extractor.h"
#include "core/mesh/block_mesh.h"
#include "core/volume/block_layout.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/scalar_type.h"

namespace isoscope::testing {

// The stored samples of block `id` of a volume of [z][y][x] `bytes`.
inline std::string CutBlock(const volume::BlockLayout& layout, volume::ScalarType type,
                            absl::string_view bytes, volume::BlockId id) {
  const math::IndexBox stored = layout.StoredSamplesOf(id);
  const math::Index3& dims = layout.sample_dims();
  const std::size_t row_bytes = static_cast<std::size_t>(stored.dims().x) * volume::SizeOf(type);
  std::string block;
  block.reserve(row_bytes * static_cast<std::size_t>(stored.dims().y * stored.dims().z));
  for (std::int64_t z = stored.begin.z; z < stored.end.z; ++z) {
    for (std::int64_t y = stored.begin.y; y < stored.end.y; ++y) {
      const std::int64_t linear = stored.begin.x + dims.x * (y + dims.y * z);
      block.append(bytes.data() + static_cast<std::size_t>(linear) * volume::SizeOf(type),
                   row_bytes);
    }
  }
  return block;
}

// The meshes of all blocks that have triangles or owned vertices, in ascending order, with edge
// keys.
inline std::vector<mesh::BlockMesh> ExtractAllBlocks(const volume::GridGeometry& geometry,
                                                     const volume::BlockLayout& layout,
                                                     volume::ScalarType type,
                                                     absl::string_view bytes, double isovalue) {
  extract::BlockExtractor extractor(geometry, layout);
  std::vector<mesh::BlockMesh> meshes;
  mesh::BlockMesh mesh;
  for (std::int64_t i = 0; i < layout.block_count(); ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    const std::string block = CutBlock(layout, type, bytes, id);
    extractor.ExtractWithEdgeKeys({id, type, block.data()}, isovalue, &mesh);
    if (!mesh.positions.empty() || mesh.owned_vertex_count > 0) {
      meshes.push_back(mesh);
    }
  }
  return meshes;
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_BLOCK_CUTTER_H_
