// The description that ImageJ writes into the first page of a TIFF stack.

#ifndef ISOSCOPE_CORE_SOURCE_IMAGEJ_STACK_H_
#define ISOSCOPE_CORE_SOURCE_IMAGEJ_STACK_H_

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/source/stack_layout.h"

namespace isoscope::source {

bool IsImageJDescription(absl::string_view description);

// The pixels in a unit along x and y, from TIFF's tags; 0 if the file does not say.
struct PixelDensity {
  double x = 0;
  double y = 0;
};

// Lays out the images: channels are fastest, then slices, then frames. The planes are those that
// the description counts, whether the file has them or not. INVALID_ARGUMENT: counts that
// contradict each other, or more than kMaxStackPlanes. The message is to follow a name and a colon.
absl::StatusOr<StackLayout> ParseImageJ(absl::string_view description, const PixelDensity& density);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_IMAGEJ_STACK_H_
