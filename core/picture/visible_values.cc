// Each row of tiles is looked at by itself, and the rows' spans are united, so that the order of
// rows can't show.
//
// A fragment with a step has a value between the edges of that step of its map. So the span of some
// steps goes from the lower edge of the first to the upper edge of the last. It is at most two steps
// longer than that of the values: with kFineSteps of them at most 2 %. A span of fewer steps is
// found again with its own range as that of the map. Positions are computed from the depth.

#include "core/picture/visible_values.h"

#include <cstddef>
#include <cstdint>

#include <oneapi/tbb/parallel_for.h>

#include "core/base/check.h"
#include "core/base/mutex.h"
#include "core/image/normal_and_step.h"
#include "core/picture/color_map.h"
#include "core/picture/covered_pixels.h"
#include "core/view/unprojection.h"

namespace isoscope::picture {
namespace {

constexpr double kFineSteps = 128;

using Extent = VisibleValues::Extent;

class ValueSearch {
 public:
  ValueSearch(const frame::FrameSpec& spec, const SteppedFragments& drawn)
      : spec_(spec),
        drawn_(drawn),
        unprojection_(*drawn.view),
        layer_images_(drawn.layers->LayerImages()) {}

  [[nodiscard]] std::vector<Extent> OfRow(int row) const {
    std::vector<Extent> found(spec_.surfaces.size() + 1);
    const auto look = [&](int x, int y, std::size_t pixel) { LookAt(x, y, pixel, &found); };
    ForEachCoveredInRow(*drawn_.image, row, look);
    if (!layer_images_.empty()) {
      // Pixels with both are looked at twice, which changes nothing.
      ForEachCoveredInRow(*layer_images_.front(), row, look);
    }
    return found;
  }

 private:
  void LookAt(int x, int y, std::size_t pixel, std::vector<Extent>* found) const {
    const std::uint64_t opaque = drawn_.image->keys[pixel];
    int count = 0;
    for (const image::FrameImage* layer_image : layer_images_) {
      const std::uint64_t key = layer_image->keys[pixel];
      if (key == image::kBackgroundKey || !drawn_.layers->IsBefore(key, opaque) ||
          count++ == spec_.max_layers) {
        break;
      }
      Add(x, y, key, layer_image->colors[pixel], found);
    }
    if (opaque != image::kBackgroundKey) {
      Add(x, y, opaque, drawn_.image->colors[pixel], found);
    }
  }

  void Add(int x, int y, std::uint64_t key, image::Rgba8 code, std::vector<Extent>* found) const {
    const std::size_t surface = drawn_.order.SurfaceOf(image::OwnerOf(key));
    if (surface >= spec_.surfaces.size()) {  // a cap that shows samples
      if (code != kNoSample) {
        found->back().Cover(code.r, code.r + 1.0);
      }
      return;
    }
    const std::optional<frame::ColorBy>& color_by = spec_.surfaces[surface].color_by;
    if (!color_by.has_value() || color_by->quantity == frame::ColorBy::Quantity::kNormal) {
      return;
    }
    Extent& extent = (*found)[surface];
    if (!spec_.surfaces[surface].shows_values()) {
      const float distance = unprojection_.DistanceOf(image::DepthOf(key));
      const double value = unprojection_.CoordinateOf(AxisOf(color_by->quantity), x, y, distance);
      extent.Cover(value, value);
    } else if (image::HasStep(code)) {
      extent.Cover(image::StepOf(code), image::StepOf(code) + 1.0);
    }
  }

  const frame::FrameSpec& spec_;
  const SteppedFragments& drawn_;
  const view::Unprojection unprojection_;
  const std::vector<const image::FrameImage*> layer_images_;
};

VisibleSpan SpanOfSteps(const Extent& steps, const frame::ColorRange& map) {
  const auto edge = [&](double step) {
    const double share = step / static_cast<double>(kColorMapSteps);
    // Exact at both ends, in spite of rounding.
    return share == 1 ? map.max : map.min + (map.max - map.min) * share;
  };
  return {.range = frame::ColorRangeOfSamples(edge(steps.min), edge(steps.max)),
          .is_fine = steps.max - steps.min >= kFineSteps};
}

}  // namespace

VisibleValues::VisibleValues(const frame::FrameSpec& spec)
    : spec_(spec), extents_(spec.surfaces.size() + 1) {
  ISOSCOPE_CHECK(spec.sends_normals);
}

void VisibleValues::Add(const SteppedFragments& drawn) {
  const ValueSearch search(spec_, drawn);
  base::Mutex mutex;
  tbb::parallel_for(0, drawn.image->touched.rows(), [&](int row) {
    const std::vector<Extent> found = search.OfRow(row);
    const base::MutexLock lock(&mutex);
    for (std::size_t i = 0; i < found.size(); ++i) {
      extents_[i].Cover(found[i].min, found[i].max);
    }
  });
}

std::optional<VisibleSpan> VisibleValues::OfSurface(std::size_t surface) const {
  const Extent& extent = extents_[surface];
  if (extent.empty()) {
    return std::nullopt;
  }
  return spec_.surfaces[surface].shows_values()
             ? SpanOfSteps(extent, spec_.surfaces[surface].color_by->range.value())
             : VisibleSpan{.range = frame::ColorRangeOfSamples(extent.min, extent.max)};
}

std::optional<VisibleSpan> VisibleValues::OfCaps() const {
  return extents_.back().empty()
             ? std::nullopt
             : std::optional(SpanOfSteps(extents_.back(), spec_.caps->range.value()));
}

}  // namespace isoscope::picture
