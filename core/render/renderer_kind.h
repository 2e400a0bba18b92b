// The names of back ends.

#ifndef ISOSCOPE_CORE_RENDER_RENDERER_KIND_H_
#define ISOSCOPE_CORE_RENDER_RENDERER_KIND_H_

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::render {

enum class RendererKind {
  kAuto,  // EGL if it is real hardware, else CPU
  kEgl,
  kCpu,
};

// "auto", "egl", "cpu"; INVALID_ARGUMENT otherwise.
absl::StatusOr<RendererKind> RendererKindFromName(absl::string_view name);

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_RENDERER_KIND_H_
