// The CPU back end, for nodes without a GPU: faster than a software OpenGL on isosurfaces, whose
// triangles are about a pixel in size (docs/performance.md).

#ifndef ISOSCOPE_CORE_RENDER_CPU_RENDERER_H_
#define ISOSCOPE_CORE_RENDER_CPU_RENDERER_H_

#include <memory>

#include "core/render/renderer.h"

namespace isoscope::render {

// Meshes are rasterised by the thread that adds them, and kept until their pixels are shaded: at
// Finish, or when more than `max_kept_bytes` of them wait in a pass.
std::unique_ptr<Renderer> MakeCpuRenderer(std::size_t max_kept_bytes);

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_CPU_RENDERER_H_
