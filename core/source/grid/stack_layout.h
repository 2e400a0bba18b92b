// The volumes of a stack of planes: which plane holds which slice, channel and step.

#ifndef ISOSCOPE_CORE_SOURCE_GRID_STACK_LAYOUT_H_
#define ISOSCOPE_CORE_SOURCE_GRID_STACK_LAYOUT_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/math/vec.h"

namespace isoscope::source {

struct StackPlane {
  std::int32_t file = -1;  // into StackLayout::files; below 0: nobody has named the plane
  std::int64_t index = 0;  // of the planes of the file, in their order
};

struct StackLayout {
  std::int64_t slices = 1;
  std::int64_t channels = 1;
  std::int64_t steps = 1;
  math::Vec3d spacing{1, 1, 1};
  math::Vec3d origin{};     // of the first sample
  std::string distances{};  // which of them the head lacks, for people; the spacing is 1 there
  std::string length_unit{};
  std::vector<std::string> channel_names{};  // none, or one a channel; may be empty or alike
  std::vector<double> times{};               // none, or one a step
  std::string time_unit{};
  std::vector<std::string> files{};  // names in the folder of the stack; none: its own files
  // The planes by step, channel and slice, the slice fastest.
  std::vector<StackPlane> planes{};

  [[nodiscard]] const StackPlane& PlaneOf(std::int64_t step, std::int64_t channel,
                                          std::int64_t slice) const {
    return planes[static_cast<std::size_t>((step * channels + channel) * slices + slice)];
  }
};

// The most planes that a layout may have.
inline constexpr std::int64_t kMaxStackPlanes = 1'000'000;

// Lays out planes that lie in a row. `letters` has T, C and Z, slowest first. The planes have file
// 0. REQUIRES: a product of counts within kMaxStackPlanes.
void LayPlanes(absl::string_view letters, StackLayout* layout);

// Lays out `planes` planes as `axes` say: letters T, C and Z, slowest first, each at most once,
// each with its count but for one, "TC3Z20"; Y and X may follow. Counts that are not given are
// those of the layout if `is_known`. INVALID_ARGUMENT: no such text; counts that make another
// number of planes. The message is to follow a name and a colon.
absl::Status ApplyPageAxes(absl::string_view axes, std::int64_t planes, bool is_known,
                           StackLayout* layout);

// The command that says what the pages of a file are: "say what its pages are, as in `isoscope
// partition ... --axes Z ...`".
std::string PagesAdvice(const std::string& path);

// A unit of length in metres, of the spellings that microscopes use; not set for others.
struct LengthUnit {
  std::string name;  // as the scale bar has it: "um"
  double metres = 0;
};
std::optional<LengthUnit> LengthUnitOf(absl::string_view text);

// Names the channels, uniquely; `field` is the name of the only one.
std::vector<std::string> NamesOfChannels(const StackLayout& layout, const std::string& field);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_GRID_STACK_LAYOUT_H_
