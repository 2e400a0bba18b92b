// The description that ImageJ writes into the first page of a TIFF stack.

#ifndef ISOSCOPE_CORE_FORMATS_STACKS_IMAGEJ_STACK_H_
#define ISOSCOPE_CORE_FORMATS_STACKS_IMAGEJ_STACK_H_

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/grid/stack_layout.h"

namespace isoscope::source {

bool IsImageJDescription(absl::string_view description);

// TIFF's tags of resolution: pixels in a unit along x and y, 0 or NaN if the file does not say, and
// the unit, "in" or "cm"; "": none.
struct PixelDensity {
  double x = 0;
  double y = 0;
  std::string unit{};
};

// Lays out the images: channels are fastest, then slices, then frames. The planes are those that
// the description counts, whether the file has them or not. Pixels have the sizes that ImageJ
// reads: 1 where the head says nothing of them, and StackLayout::distances where it says it of some
// axes only, or as no number. A resolution in inches or centimetres alone is that of a print, and
// no size. INVALID_ARGUMENT: counts that contradict each other, or more than kMaxStackPlanes; units
// that can't be compared. The message is to follow a name and a colon.
absl::StatusOr<StackLayout> ParseImageJ(absl::string_view description, const PixelDensity& density);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_STACKS_IMAGEJ_STACK_H_
