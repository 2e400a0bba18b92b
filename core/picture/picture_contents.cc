// Each row of tiles is looked at by itself, and the rows' contents are united, so that the order of
// rows can't show. A missing value has a code that nothing else in its surface has
// (core/image/normal_and_step.h). So without `with_shown` only pixels with such bits are worth a
// closer look. Bits of other surfaces may look alike; the closer look tells them apart. Where no
// values are shown, the search ends once all surfaces are found.

#include "core/picture/picture_contents.h"

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <vector>

#include <oneapi/tbb/parallel_for.h>

#include "core/base/check.h"
#include "core/base/mutex.h"
#include "core/image/normal_and_step.h"
#include "core/picture/color_map.h"
#include "core/picture/covered_pixels.h"

namespace isoscope::picture {
namespace {

bool MayLackValue(image::Rgba8 code) { return !image::HasStep(code) || code == kNoSample; }

class Search {
 public:
  Search(const DrawnFragments& drawn, const view::PixelRect& window, bool with_shown)
      : drawn_(drawn),
        spec_(*drawn.spec),
        window_(window),
        with_shown_(with_shown),
        shows_values_(frame::ShowsValues(spec_) || frame::HasSampleCaps(spec_)),
        layer_images_(drawn.layers->LayerImages()) {
    ISOSCOPE_CHECK_LE(spec_.surfaces.size(), frame::kMaxSurfaces);
  }

  [[nodiscard]] PictureContents OfRow(int row) const {
    PictureContents found;
    if (is_done_.load(std::memory_order_relaxed)) {
      return found;
    }
    bool is_done = false;
    const auto look = [&](int x, int y, std::size_t pixel) {
      if (is_done) {
        return;
      }
      if (x >= window_.begin_x && x < window_.end_x && y >= window_.begin_y && y < window_.end_y &&
          (with_shown_ || MayLackValueAt(pixel))) {
        LookAt(x, y, pixel, &found);
        is_done = !shows_values_ && found.shown.count() == spec_.surfaces.size();
      }
    };
    ForEachCoveredInRow(*drawn_.image, row, look);
    if (!layer_images_.empty()) {
      // Pixels with both are looked at twice, which changes nothing.
      ForEachCoveredInRow(*layer_images_.front(), row, look);
    }
    if (is_done) {
      is_done_.store(true, std::memory_order_relaxed);
    }
    return found;
  }

 private:
  [[nodiscard]] bool MayLackValueAt(std::size_t pixel) const {
    if (MayLackValue(drawn_.image->colors[pixel])) {
      return true;
    }
    for (const image::FrameImage* layer_image : layer_images_) {
      if (layer_image->keys[pixel] == image::kBackgroundKey) {
        return false;
      }
      if (MayLackValue(layer_image->colors[pixel])) {
        return true;
      }
    }
    return false;
  }

  void LookAt(int x, int y, std::size_t pixel, PictureContents* found) const {
    const std::uint64_t opaque = drawn_.image->keys[pixel];
    int count = 0;
    for (const image::FrameImage* layer_image : layer_images_) {
      const std::uint64_t key = layer_image->keys[pixel];
      if (key == image::kBackgroundKey || !drawn_.layers->IsBefore(key, opaque) ||
          count++ == spec_.max_layers) {
        break;
      }
      const float opacity = OpacityOf({x, y, key, layer_image->colors[pixel]});
      if (opacity > 0) {
        Add(key, layer_image->colors[pixel], found);
      }
      if (opacity >= 1) {
        return;
      }
    }
    if (opaque != image::kBackgroundKey) {
      Add(opaque, drawn_.image->colors[pixel], found);
    }
  }

  [[nodiscard]] float OpacityOf(const NormalFragment& fragment) const {
    const frame::Surface& surface =
        spec_.surfaces[drawn_.order.SurfaceOf(image::OwnerOf(fragment.key))];
    const bool has_map_opacity = drawn_.shader != nullptr && surface.color_by.has_value() &&
                                 surface.color_by->is_translucent();
    return has_map_opacity
               ? surface.opacity *
                     picture::OpacityOf(*surface.color_by, drawn_.shader->OpacityStepOf(fragment))
               : surface.opacity;
  }

  void Add(std::uint64_t key, image::Rgba8 code, PictureContents* found) const {
    std::size_t surface = drawn_.order.SurfaceOf(image::OwnerOf(key));
    // A cap that shows samples has an owner of its own where the others carry normals.
    const bool is_sample_cap = surface >= spec_.surfaces.size();
    surface -= is_sample_cap ? spec_.surfaces.size() : 0;
    if (with_shown_) {
      found->shown.set(surface);
    }
    if (is_sample_cap || drawn_.shader == nullptr) {
      found->has_caps_without_samples |= code == kNoSample;
    } else if (spec_.surfaces[surface].shows_values() && !image::HasStep(code)) {
      found->without_values.set(surface);
    }
  }

  const DrawnFragments& drawn_;
  const frame::FrameSpec& spec_;
  const view::PixelRect window_;
  const bool with_shown_;
  const bool shows_values_;
  mutable std::atomic<bool> is_done_{false};  // a row has all that there is to find
  const std::vector<const image::FrameImage*> layer_images_;
};

}  // namespace

PictureContents FindContents(const DrawnFragments& drawn, const view::PixelRect& window,
                             bool with_shown) {
  PictureContents contents;
  if (!with_shown && !frame::ShowsValues(*drawn.spec) && !frame::HasSampleCaps(*drawn.spec)) {
    return contents;
  }
  const Search search(drawn, window, with_shown);
  base::Mutex mutex;
  tbb::parallel_for(0, drawn.image->touched.rows(), [&](int row) {
    const PictureContents found = search.OfRow(row);
    const base::MutexLock lock(&mutex);
    contents.shown |= found.shown;
    contents.without_values |= found.without_values;
    contents.has_caps_without_samples |= found.has_caps_without_samples;
  });
  return contents;
}

void ColorCapsWithoutSamples(const frame::FrameSpec& spec, image::FrameImage* image) {
  if (!frame::HasSampleCaps(spec) || NeedsDeferredShading(spec)) {
    return;
  }
  const image::Rgba8 color = frame::NanColorOf(spec, *spec.caps->map);
  tbb::parallel_for(0, image->touched.rows(), [&](int row) {
    ForEachCoveredInRow(*image, row, [&](int, int, std::size_t pixel) {
      // Covered pixels may be background.
      if (image->keys[pixel] != image::kBackgroundKey && image->colors[pixel] == kNoSample) {
        image->colors[pixel] = color;
      }
    });
  });
}

}  // namespace isoscope::picture
