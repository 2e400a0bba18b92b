#include "clients/cpp/request/effect_flags.h"

#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

#include "clients/cpp/request/render_request.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/frame/drawn_window.h"

namespace isoscope::client {
namespace {

absl::StatusOr<std::int64_t> ParseSamples(absl::string_view text) {
  return ParseChoice<std::int64_t>(text, {{"1", 1}, {"4", 4}, {"9", 9}, {"16", 16}});
}

}  // namespace

absl::StatusOr<AmbientOcclusionValue> ParseAmbientOcclusion(absl::string_view text) {
  AmbientOcclusionValue value;
  if (text.empty()) {
    return value;
  }
  using Limits = frame::AmbientOcclusion;
  const std::vector<absl::string_view> parts = absl::StrSplit(text, absl::MaxSplits(',', 1));
  ISOSCOPE_ASSIGN_OR_RETURN(value.radius_px,
                            ParseInteger(parts[0], Limits::kMinRadiusPx, Limits::kMaxRadiusPx));
  if (parts.size() > 1) {
    ISOSCOPE_ASSIGN_OR_RETURN(value.strength, ParseNumber(parts[1]));
    if (*value.strength < 0 || *value.strength > 1) {
      return absl::InvalidArgumentError(absl::StrCat(base::Quoted(text, '\''), " has the strength ",
                                                     *value.strength, ": must be in [0, 1]"));
    }
  }
  return value;
}

absl::StatusOr<SilhouetteValue> ParseSilhouette(absl::string_view text) {
  SilhouetteValue value;
  if (text.empty()) {
    return value;
  }
  const std::vector<absl::string_view> parts = absl::StrSplit(text, absl::MaxSplits(':', 1));
  ISOSCOPE_ASSIGN_OR_RETURN(value.width_px,
                            ParseInteger(parts[0], 1, frame::Silhouette::kMaxWidthPx));
  if (parts.size() > 1) {
    ISOSCOPE_ASSIGN_OR_RETURN(value.color, ParseColor(parts[1]));
  }
  return value;
}

int EffectFlags::samples_per_side() const {
  int side = 1;
  while (side * side < samples.value_or(1)) {
    ++side;
  }
  return side;
}

view::Viewport EffectFlags::drawn_size(const view::Viewport& size) const {
  return {size.width_px * samples_per_side(), size.height_px * samples_per_side()};
}

int EffectFlags::max_region_side_px() const {
  return view::kMaxViewportPx / samples_per_side() - 2 * frame::kMaxMarginPx;
}

void AddEffectFlags(cli::FlagSet* set, EffectFlags* flags) {
  const std::string group = "Effects";
  cli::AddFlag(set, "--samples", "1|4|9|16", &flags->samples, ParseSamples,
               "smooth edges: each pixel is the mean of this many samples (default: 1)")
      .Group(group);
  cli::AddFlagWithDefault(
      set, "--ambient-occlusion", "[RADIUS[,STRENGTH]]", &flags->ambient_occlusion,
      ParseAmbientOcclusion,
      "darken what lies in hollows: how far to look, 4 to 56 pixels (default: 32), "
      "and how much, 0 to 1 (default: 1)")
      .Group(group);
  cli::AddFlagWithDefault(
      set, "--silhouette", "[WIDTH[:COLOR]]", &flags->silhouette, ParseSilhouette,
      "draw lines where surfaces end: 1 to 16 pixels wide (default: 2), and their "
      "colour, as of --color (default: black)")
      .Group(group);
}

void SetEffects(const EffectFlags& flags, isoscope::v1::RenderIsosurfaceRequest* request) {
  if (flags.samples) {
    request->set_samples(static_cast<std::int32_t>(*flags.samples));
  }
  if (flags.ambient_occlusion) {
    isoscope::v1::AmbientOcclusion* const proto = request->mutable_ambient_occlusion();
    proto->set_radius_px(static_cast<std::int32_t>(flags.ambient_occlusion->radius_px.value_or(0)));
    if (flags.ambient_occlusion->strength) {
      proto->set_strength(static_cast<float>(*flags.ambient_occlusion->strength));
    }
  }
  if (flags.silhouette) {
    isoscope::v1::Silhouette* const proto = request->mutable_silhouette();
    proto->set_width_px(static_cast<std::int32_t>(flags.silhouette->width_px.value_or(0)));
    if (flags.silhouette->color) {
      *proto->mutable_color() = ToProto(*flags.silhouette->color);
    }
  }
}

}  // namespace isoscope::client
