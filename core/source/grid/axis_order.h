// The meaning of an array's axes, as letters: "TCZYX", slowest first.

#ifndef ISOSCOPE_CORE_SOURCE_GRID_AXIS_ORDER_H_
#define ISOSCOPE_CORE_SOURCE_GRID_AXIS_ORDER_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::source {

// The index of each axis in an array. Other axes have one element.
struct AxisOrder {
  std::size_t z = 0;
  std::size_t y = 0;
  std::size_t x = 0;
  std::optional<std::size_t> t = std::nullopt;  // time
  std::optional<std::size_t> c = std::nullopt;  // components

  friend bool operator==(const AxisOrder&, const AxisOrder&) = default;
};

// One letter an axis, in any case; '-' for an axis that is left out. INVALID_ARGUMENT unless there
// are Z, Y and X, in this order, and each letter once; the message is to follow a name and a colon.
absl::StatusOr<AxisOrder> ParseAxisOrder(absl::string_view letters);
// The inverse, for an array of `rank` axes.
std::string AxisLetters(const AxisOrder& order, std::size_t rank);

// The letter that a label means: 'T' for "time", 'Z' for "z". '?' if none.
char AxisLetterOf(absl::string_view label);
// The labels in a text: "tzyx", "t, z, y, x", or vigra's JSON of axis tags,
// {"axes": [{"key": "t", ...}, ...]}.
std::vector<std::string> AxisLabelsIn(absl::string_view text);

// The order without being told: three axes are z, y, x, and so are those three of more that have
// more than one element. Not set for others.
std::optional<AxisOrder> PlainAxisOrder(const std::vector<std::int64_t>& dims);
// "TZYX, CZYX or ZYXC": what four axes can mean; "" if no letters fit so many.
std::string AxisChoices(std::size_t rank);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_GRID_AXIS_ORDER_H_
