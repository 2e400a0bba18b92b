#include "core/render/renderer_factory.h"

#include <filesystem>
#include <system_error>
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

// Whether the kernel has a device that hardware of OpenGL is reached by: those of Mesa's drivers,
// NVIDIA's, ARM's, Qualcomm's and Windows' under Linux.
bool HasGraphicsDevice() {
  std::error_code error;
  if (!std::filesystem::is_empty("/dev/dri", error) && !error) {
    return true;
  }
  for (const char* const path : {"/dev/nvidiactl", "/dev/nvidia0", "/dev/nvhost-gpu", "/dev/nvmap",
                                 "/dev/mali0", "/dev/kgsl-3d0", "/dev/dxg"}) {
    if (std::filesystem::exists(path, error)) {
      return true;
    }
  }
  return false;
}

absl::StatusOr<std::unique_ptr<Renderer>> MakeAutoRenderer(const RendererOptions& options) {
  // To look for hardware loads Mesa, which keeps 45 MiB of the memory limit.
  if (options.egl_device < 0 && !HasGraphicsDevice()) {
    return MakeCpuRenderer(options);
  }
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
