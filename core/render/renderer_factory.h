// Makes the requested back end.

#ifndef ISOSCOPE_CORE_RENDER_RENDERER_FACTORY_H_
#define ISOSCOPE_CORE_RENDER_RENDERER_FACTORY_H_

#include <cstddef>
#include <memory>

#include "absl/status/statusor.h"

#include "core/base/task_arena.h"
#include "core/render/renderer.h"
#include "core/render/renderer_kind.h"

namespace isoscope::render {

struct RendererOptions {
  RendererKind kind = RendererKind::kAuto;
  // The EGL device, by its index in `isoscope-agent --list-egl-devices`. -1: the first one that
  // works.
  int egl_device = -1;
  // The most bytes of meshes that a pass keeps, to draw them (EGL) or to shade their pixels (CPU);
  // and the most bytes of images and buffers that no pass uses.
  std::size_t max_kept_mesh_bytes = std::size_t{256} << 20;
  std::size_t max_unused_bytes = std::size_t{256} << 20;
  // The CPU back end shades in it. Null: in the arena of the caller.
  std::shared_ptr<base::TaskArena> arena = nullptr;
};

// FAILED_PRECONDITION if EGL can't start. The message names the platforms and devices that were
// tried, their answers, and the packages to install.
absl::StatusOr<std::unique_ptr<Renderer>> MakeRenderer(const RendererOptions& options);

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_RENDERER_FACTORY_H_
