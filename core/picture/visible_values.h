// Finds the values that a picture shows through its colour maps: for ranges of what is visible.

#ifndef ISOSCOPE_CORE_PICTURE_VISIBLE_VALUES_H_
#define ISOSCOPE_CORE_PICTURE_VISIBLE_VALUES_H_

#include <algorithm>
#include <cstddef>
#include <limits>
#include <optional>
#include <vector>

#include "core/frame/frame_spec.h"
#include "core/image/fragment.h"
#include "core/image/frame_image.h"
#include "core/image/layer_stack.h"
#include "core/view/view.h"

namespace isoscope::picture {

// The composited fragments of a frame, or of a window of it, that carry normals and steps. All
// objects that it points to outlive the call.
struct SteppedFragments {
  image::FragmentOrder order;
  const image::FrameImage* image = nullptr;
  const image::LayerStack* layers = nullptr;
  const view::View* view = nullptr;
};

// The values that show, as far as the steps of a map tell: those of its steps.
struct VisibleSpan {
  frame::ColorRange range;
  // Whether a narrower range can't tell much more: it is that of positions, or has many steps.
  bool is_fine = true;

  friend bool operator==(const VisibleSpan&, const VisibleSpan&) = default;
};

// The values of the fragments that show, as PictureContents says it, but for opacities of maps: these
// do not count, and such fragments hide nothing. Missing values do not count. Not thread-safe.
class VisibleValues {
 public:
  // spec: outlives the object. It sends normals, and map steps if a surface shows values. Caps with
  //       samples have the map kGrey, whose colours are the steps. Maps have ranges, but for
  //       positions.
  explicit VisibleValues(const frame::FrameSpec& spec);

  // Adds what fragments show. The order of calls can't show. Works in parallel, in the
  // tbb::task_arena of the caller. O(drawn pixels).
  void Add(const SteppedFragments& drawn);

  // None: no fragment with a value showed, or the surface has no map.
  [[nodiscard]] std::optional<VisibleSpan> OfSurface(std::size_t surface) const;
  [[nodiscard]] std::optional<VisibleSpan> OfCaps() const;

  // Coordinates, or edges of steps: step i has the edges i and i + 1.
  struct Extent {
    double min = std::numeric_limits<double>::infinity();
    double max = -std::numeric_limits<double>::infinity();

    [[nodiscard]] bool empty() const { return !(min <= max); }
    void Cover(double from, double to) {
      min = std::min(min, from);
      max = std::max(max, to);
    }
  };

 private:
  const frame::FrameSpec& spec_;
  std::vector<Extent> extents_;  // by surface; that of caps is the last
};

}  // namespace isoscope::picture

#endif  // ISOSCOPE_CORE_PICTURE_VISIBLE_VALUES_H_
