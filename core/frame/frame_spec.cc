#include "core/frame/frame_spec.h"

#include <algorithm>

#include "absl/strings/str_format.h"

namespace isoscope::frame {

bool HasLayers(const FrameSpec& spec) {
  return std::any_of(spec.surfaces.begin(), spec.surfaces.end(),
                     [](const Surface& surface) { return surface.is_translucent(); });
}

bool ShowsValues(const FrameSpec& spec) {
  return std::any_of(spec.surfaces.begin(), spec.surfaces.end(),
                     [](const Surface& surface) { return surface.shows_values(); });
}

std::vector<double> IsovaluesOf(const FrameSpec& spec) {
  std::vector<double> isovalues;
  isovalues.reserve(spec.surfaces.size());
  for (const Surface& surface : spec.surfaces) {
    isovalues.push_back(surface.isovalue);
  }
  return isovalues;
}

std::size_t OwnerSurfaceCount(const FrameSpec& spec) {
  const bool has_maps = spec.caps.has_value() && spec.caps->map.has_value();
  return spec.surfaces.size() * (has_maps ? 2 : 1);
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
