// The CPU back end, for nodes without a GPU: faster than a software OpenGL on isosurfaces, whose
// triangles are about a pixel in size (docs/lab/experiments.md).

#ifndef ISOSCOPE_CORE_RENDER_CPU_RENDERER_H_
#define ISOSCOPE_CORE_RENDER_CPU_RENDERER_H_

#include <cstddef>
#include <cstdint>
#include <memory>

#include "core/base/task_arena.h"
#include "core/render/renderer.h"

namespace isoscope::render {

// The thread that adds a mesh rasterises it. The pass keeps the mesh until its pixels are shaded:
// in Finish, or in Shade once the kept meshes exceed one of these limits.
struct CpuRendererOptions {
  std::size_t max_kept_bytes = std::size_t{512} << 20;
  // A mesh takes one primitive id for each triangle, rounded up to a multiple of 64. This limit is
  // at most 2^31.
  std::uint64_t max_kept_primitives = std::uint64_t{1} << 31;
  // Bounds images and buffers that no pass uses.
  std::size_t max_unused_bytes = std::size_t{256} << 20;
  // Shading computes in it. Null: in the arena of the caller.
  std::shared_ptr<base::TaskArena> arena = nullptr;
};

std::unique_ptr<Renderer> MakeCpuRenderer(const CpuRendererOptions& options);
inline std::unique_ptr<Renderer> MakeCpuRenderer(std::size_t max_kept_bytes) {
  return MakeCpuRenderer(CpuRendererOptions{.max_kept_bytes = max_kept_bytes});
}

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_CPU_RENDERER_H_
