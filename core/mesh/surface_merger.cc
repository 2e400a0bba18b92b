// The merge:
//
// 1. A heap has the next block of each source, the smallest block id in front. A source sends its
//    blocks in ascending order, so the front is the next block of the volume.
// 2. The welder gives vertices their ids over the whole mesh. It recognises a vertex on a face
//    between blocks by its position, so such a vertex is sent once (core/mesh/mesh_welder.h).
// 3. The chunker takes vertices to world space, turns the triangles of a mirrored grid, and cuts
//    chunks of at most 1 MiB. A vertex takes 24 bytes, and so does a triangle. In a block's part
//    all vertices come before the triangles, so a triangle uses only vertices that were sent.
// 4. The source of the block gives its next one.
//
// Blocks are merged in the order of the volume, so mesh and chunks do not depend on how blocks are
// spread over sources. Memory holds one block of each source, one chunk, and the welder's vertices
// on faces between blocks.

#include "core/mesh/surface_merger.h"

#include <algorithm>
#include <cstdint>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/math/matrix.h"
#include "core/math/vec.h"
#include "core/math/vec_conversion.h"
#include "core/mesh/mesh_welder.h"
#include "core/mesh/world_placement.h"

namespace isoscope::mesh {
namespace {

constexpr std::size_t kVertexBytes = std::size_t{6} * sizeof(float);
constexpr std::size_t kTriangleBytes = 3 * sizeof(std::int64_t);

void AppendVector(const math::Vec3f& vector, std::string* out) {
  base::AppendLittleEndian(vector.x, out);
  base::AppendLittleEndian(vector.y, out);
  base::AppendLittleEndian(vector.z, out);
}

// Cuts welded parts into chunks. The vertices of a part come first, so that a triangle uses only
// vertices that were sent.
class Chunker {
 public:
  Chunker(const SurfaceGrid& grid, std::int64_t first_vertex,
          absl::FunctionRef<absl::Status(SurfaceChunk)> emit)
      : placement_(grid.geometry),
        world_from_index_(grid.geometry.world_from_index()),
        has_origin_(grid.has_origin),
        // In a mirrored grid, counter-clockwise in index space is clockwise in the world.
        is_mirrored_(math::Determinant(grid.geometry.direction) < 0),
        first_vertex_(first_vertex),
        emit_(emit) {}

  absl::Status Add(const WeldedPart& part) {
    for (std::size_t i = 0; i < part.positions.size(); ++i) {
      ISOSCOPE_RETURN_IF_ERROR(MakeRoom(kVertexBytes));
      const math::Vec3f& p = part.positions[i];
      AppendVector(has_origin_
                       ? placement_.OffsetOf(p)
                       : math::FloatOf(math::TransformPoint(world_from_index_, math::DoubleOf(p))),
                   &chunk_.positions);
      AppendVector(part.normals[i], &chunk_.normals);
    }
    for (std::size_t i = 0; i + 2 < part.triangles.size(); i += 3) {
      ISOSCOPE_RETURN_IF_ERROR(MakeRoom(kTriangleBytes));
      for (const std::size_t corner :
           {i, is_mirrored_ ? i + 2 : i + 1, is_mirrored_ ? i + 1 : i + 2}) {
        base::AppendLittleEndian(first_vertex_ + part.triangles[corner], &chunk_.triangles);
      }
    }
    return absl::OkStatus();
  }

  absl::Status Flush() {
    if (chunk_.size_bytes() == 0) {
      return absl::OkStatus();
    }
    return emit_(std::exchange(chunk_, {}));
  }

 private:
  absl::Status MakeRoom(std::size_t bytes) {
    return chunk_.size_bytes() + bytes > kSurfaceChunkBytes ? Flush() : absl::OkStatus();
  }

  const WorldPlacement placement_;
  const math::Mat4d world_from_index_;
  const bool has_origin_;
  const bool is_mirrored_;
  const std::int64_t first_vertex_;
  const absl::FunctionRef<absl::Status(SurfaceChunk)> emit_;
  SurfaceChunk chunk_;
};

// The next block of a source, as an element of the heap.
struct Head {
  BlockMesh block;
  std::size_t source_index = 0;
};

}  // namespace

absl::StatusOr<std::int64_t> MergeSurface(const SurfaceGrid& grid,
                                          const std::vector<SurfaceSource*>& sources,
                                          std::int64_t first_vertex,
                                          absl::FunctionRef<absl::Status(SurfaceChunk)> emit) {
  const auto is_later = [](const Head& a, const Head& b) {
    return a.block.block_id > b.block.block_id;
  };
  std::vector<Head> heads;  // a heap: the smallest block id in front
  const auto pull = [&](std::size_t source_index) -> absl::Status {
    Head head;
    head.source_index = source_index;
    ISOSCOPE_ASSIGN_OR_RETURN(const bool has_block, sources[source_index]->Next(&head.block));
    if (has_block) {
      heads.push_back(std::move(head));
      std::push_heap(heads.begin(), heads.end(), is_later);
    }
    return absl::OkStatus();
  };
  for (std::size_t i = 0; i < sources.size(); ++i) {
    ISOSCOPE_RETURN_IF_ERROR(pull(i));
  }

  MeshWelder welder(grid.layout);
  WeldedPart part;
  Chunker chunker(grid, first_vertex, emit);
  std::int64_t previous_block = -1;
  while (!heads.empty()) {
    std::pop_heap(heads.begin(), heads.end(), is_later);
    Head head = std::move(heads.back());
    heads.pop_back();
    if (std::int64_t{head.block.block_id} <= previous_block) {
      return absl::InternalError(absl::StrCat("a source sent block ", head.block.block_id,
                                              " after block ", previous_block,
                                              ": ids must ascend and be sent once"));
    }
    previous_block = head.block.block_id;
    welder.Add(head.block, &part);
    ISOSCOPE_RETURN_IF_ERROR(chunker.Add(part));
    ISOSCOPE_RETURN_IF_ERROR(pull(head.source_index));
  }
  ISOSCOPE_RETURN_IF_ERROR(chunker.Flush());
  return welder.vertex_count();
}

}  // namespace isoscope::mesh
