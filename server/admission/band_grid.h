// The bands of a picture that is too large to be drawn at once: regions of it that the coordinator
// draws one after another.

#ifndef ISOSCOPE_SERVER_ADMISSION_BAND_GRID_H_
#define ISOSCOPE_SERVER_ADMISSION_BAND_GRID_H_

#include <optional>
#include <string>

#include "absl/functional/function_ref.h"

#include "core/frame/frame_spec.h"
#include "core/view/camera.h"

namespace isoscope::server {

// Equal rectangles in rows from the top, each row from the left; those at the right and at the
// bottom may be smaller. A picture that is drawn at once is one band.
class BandGrid {
 public:
  // REQUIRES: both have pixels.
  BandGrid(const view::Viewport& picture, const view::Viewport& band);

  [[nodiscard]] int columns() const { return columns_; }
  [[nodiscard]] int rows() const { return rows_; }
  [[nodiscard]] int count() const { return columns_ * rows_; }
  // Returns a band, in pixels of the picture. REQUIRES: 0 <= index < count().
  [[nodiscard]] view::Region At(int index) const;
  // Returns the size of the largest band.
  [[nodiscard]] const view::Viewport& band() const { return band_; }

 private:
  view::Viewport picture_;
  view::Viewport band_;
  int columns_ = 1;
  int rows_ = 1;
};

// No band need be smaller than this, in pixels a side.
inline constexpr int kMinBandSidePx = 64;

// Returns the size of the smallest band of a picture.
view::Viewport SmallestBand(const view::Viewport& picture);

// Returns the frame of a band of this size, where its effects need the most pixels around it.
frame::FrameSpec BandInTheMiddle(const frame::FrameSpec& spec, const view::Viewport& band);

// For messages: what makes a band of this frame take more than its pixels. Both are empty if nothing
// does.
struct BandCosts {
  std::string text;    // " with 16 samples and 64 pixels around it for effects"
  std::string advice;  // "ask for fewer samples, or for less of ..."
};
BandCosts BandCostsOf(const frame::FrameSpec& spec);

// Returns the frame of a band, given in pixels of the picture.
frame::FrameSpec SpecOfBand(const frame::FrameSpec& spec, const view::Region& band);

// Returns the bands that fit and cost least: few, whole rows where that is no dearer, and few
// pixels that two of them draw for their effects. None if the smallest band does not fit.
//
// fits: whether a band of this size can be drawn. If it can, so can each that is no larger.
std::optional<BandGrid> BestBands(const frame::FrameSpec& spec,
                                  absl::FunctionRef<bool(const view::Viewport& band)> fits);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_ADMISSION_BAND_GRID_H_
