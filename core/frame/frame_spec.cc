#include "core/frame/frame_spec.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace isoscope::frame {
namespace {

constexpr std::size_t kTextRules = 16;

// Finite: field units beyond all stored values stay beyond them.
double Scaled(double value, double scale) {
  constexpr double kLargest = std::numeric_limits<double>::max();
  return std::clamp(value * scale, -kLargest, kLargest);
}

void Scale(double scale, std::optional<ColorRange>* range) {
  if (!range->has_value()) {
    return;
  }
  double& min = (*range)->min;
  double& max = (*range)->max;
  min = Scaled(min, scale);
  max = Scaled(max, scale);
  if (!(min < max)) {  // both were beyond all doubles, and all samples are on one side of them
    (min > 0 ? min : max) /= 2;
  }
}

}  // namespace

volume::InsideRule InStoredValues(volume::InsideRule rule, double value_scale) {
  rule.isovalue = Scaled(rule.isovalue, value_scale);
  return rule;
}

FrameSpec InStoredValues(FrameSpec spec, double value_scale,
                         const std::vector<double>& color_scales) {
  for (std::size_t i = 0; i < spec.surfaces.size(); ++i) {
    Surface& surface = spec.surfaces[i];
    surface.rule = InStoredValues(std::move(surface.rule), value_scale);
    if (surface.shows_gradient()) {
      Scale(value_scale, &surface.color_by->range);
    } else if (surface.shows_field() && i < color_scales.size()) {
      Scale(color_scales[i], &surface.color_by->range);
    }
  }
  if (spec.caps.has_value()) {
    Scale(value_scale, &spec.caps->range);
  }
  return spec;
}

FrameSpec WithoutLook(FrameSpec spec, bool sends_normals) {
  spec.effects = {};
  if (spec.caps.has_value()) {
    spec.caps = ClipCaps();
  }
  spec.sends_normals = sends_normals;
  return spec;
}

bool HasLayers(const FrameSpec& spec) {
  return std::any_of(spec.surfaces.begin(), spec.surfaces.end(),
                     [](const Surface& surface) { return surface.is_translucent(); });
}

bool ShowsValues(const FrameSpec& spec) {
  return std::any_of(spec.surfaces.begin(), spec.surfaces.end(),
                     [](const Surface& surface) { return surface.shows_values(); });
}

std::vector<volume::InsideRule> RulesOf(const FrameSpec& spec) {
  std::vector<volume::InsideRule> rules;
  rules.reserve(spec.surfaces.size());
  for (const Surface& surface : spec.surfaces) {
    rules.push_back(surface.rule);
  }
  return rules;
}

std::string TextOf(const std::vector<volume::InsideRule>& rules) {
  std::string text;
  for (std::size_t i = 0; i < rules.size() && i < kTextRules; ++i) {
    absl::StrAppend(&text, i == 0 ? "" : "; ", rules[i].Text());
  }
  if (rules.size() > kTextRules) {
    absl::StrAppend(&text, "; and ", rules.size() - kTextRules, " more");
  }
  return text;
}

std::size_t OwnerSurfaceCount(const FrameSpec& spec) {
  return spec.surfaces.size() * (HasSampleCaps(spec) ? 2 : 1);
}

absl::Status CheckOwners(std::size_t surface_count, std::int64_t block_count) {
  const auto surfaces = static_cast<std::int64_t>(surface_count);
  const std::int64_t max_owners = image::kNoOwner;
  if (block_count > 0 && surfaces > max_owners / block_count) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%d surfaces of a volume of %d blocks: surfaces times blocks must be at most %d; ask for "
        "at most %d surfaces, or partition the volume into larger blocks",
        surfaces, block_count, max_owners, max_owners / block_count));
  }
  return absl::OkStatus();
}

}  // namespace isoscope::frame
