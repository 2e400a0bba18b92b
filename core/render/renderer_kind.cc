#include "core/render/renderer_kind.h"

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

namespace isoscope::render {

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

}  // namespace isoscope::render
