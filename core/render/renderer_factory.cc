#include "core/render/renderer_factory.h"

#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "core/render/egl_renderer.h"

namespace isoscope::render {
namespace {

absl::StatusOr<std::unique_ptr<Renderer>> MakeCpuRenderer() {
  return absl::UnimplementedError(
      "the renderer cpu is not part of this build; choose the renderer egl");
}

absl::StatusOr<std::unique_ptr<Renderer>> MakeEglRenderer(const RendererOptions& options) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<Renderer> renderer,
                            EglRenderer::Make({.egl_device = options.egl_device}));
  return renderer;
}

absl::StatusOr<std::unique_ptr<Renderer>> MakeAutoRenderer(const RendererOptions& options) {
  absl::StatusOr<std::unique_ptr<EglRenderer>> egl =
      EglRenderer::Make({.egl_device = options.egl_device});
  if (egl.ok() && (*egl)->is_hardware()) {
    return *std::move(egl);
  }
  absl::StatusOr<std::unique_ptr<Renderer>> cpu = MakeCpuRenderer();
  if (cpu.ok()) {
    return cpu;
  }
  if (egl.ok()) {
    return *std::move(egl);
  }
  return egl.status();
}

}  // namespace

absl::StatusOr<RendererKind> RendererKindFromName(absl::string_view name) {
  if (name == "auto") {
    return RendererKind::kAuto;
  }
  if (name == "egl") {
    return RendererKind::kEgl;
  }
  if (name == "cpu") {
    return RendererKind::kCpu;
  }
  return absl::InvalidArgumentError(
      absl::StrCat("there is no renderer \"", name, "\"; expected auto, egl or cpu"));
}

absl::StatusOr<std::unique_ptr<Renderer>> MakeRenderer(const RendererOptions& options) {
  switch (options.kind) {
    case RendererKind::kEgl:
      return MakeEglRenderer(options);
    case RendererKind::kCpu:
      return MakeCpuRenderer();
    case RendererKind::kAuto:
      break;
  }
  return MakeAutoRenderer(options);
}

}  // namespace isoscope::render
