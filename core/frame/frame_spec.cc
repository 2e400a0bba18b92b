#include "core/frame/frame_spec.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace isoscope::frame {
namespace {

constexpr std::size_t kTextRules = 16;

}  // namespace

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
