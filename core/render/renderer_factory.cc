#include "core/render/renderer_factory.h"

#include <utility>

#include "core/base/status_macros.h"
#include "core/render/cpu_renderer.h"
#include "core/render/egl_renderer.h"

namespace isoscope::render {
namespace {

// docs/operations.md, "Memory", says how much a pass may keep.
std::unique_ptr<Renderer> MakeCpuRenderer(const RendererOptions& options) {
  CpuRendererOptions cpu;
  cpu.max_kept_bytes = options.max_kept_mesh_bytes;
  cpu.max_unused_bytes = options.max_unused_bytes;
  cpu.arena = options.arena;
  return render::MakeCpuRenderer(cpu);
}

absl::StatusOr<std::unique_ptr<EglRenderer>> MakeEglRenderer(const RendererOptions& options) {
  // A pass holds two batches: it collects one while the other is drawn.
  return EglRenderer::Make({.egl_device = options.egl_device,
                            .batch_bytes = options.max_kept_mesh_bytes / 2,
                            .max_unused_bytes = options.max_unused_bytes});
}

absl::StatusOr<std::unique_ptr<Renderer>> MakeAutoRenderer(const RendererOptions& options) {
  absl::StatusOr<std::unique_ptr<EglRenderer>> egl = MakeEglRenderer(options);
  if (egl.ok() && (*egl)->is_hardware()) {
    return *std::move(egl);
  }
  return MakeCpuRenderer(options);
}

}  // namespace

absl::StatusOr<std::unique_ptr<Renderer>> MakeRenderer(const RendererOptions& options) {
  switch (options.kind) {
    case RendererKind::kEgl:
      return MakeEglRenderer(options);
    case RendererKind::kCpu:
      return MakeCpuRenderer(options);
    case RendererKind::kAuto:
      break;
  }
  return MakeAutoRenderer(options);
}

}  // namespace isoscope::render
