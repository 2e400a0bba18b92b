// Labels: sample values that stand for a thing, such as an organ, with a name and a colour each.

#ifndef ISOSCOPE_CORE_VOLUME_LABEL_H_
#define ISOSCOPE_CORE_VOLUME_LABEL_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace isoscope::volume {

inline constexpr std::size_t kMaxNamedLabels = 65536;   // of a dataset
inline constexpr std::size_t kMaxLabelNameBytes = 256;  // of UTF-8
// The bytes of all names together, so that a manifest stays below its limit.
inline constexpr std::size_t kMaxLabelTextBytes = std::size_t{4} << 20;

// sRGB.
struct LabelColor {
  std::uint8_t red = 0;
  std::uint8_t green = 0;
  std::uint8_t blue = 0;

  friend bool operator==(const LabelColor&, const LabelColor&) = default;
};

struct Label {
  double value = 0;                   // of the samples; finite
  std::string name{};                 // for people; may be empty
  std::optional<LabelColor> color{};  // not set: DefaultLabelColor(value)

  friend bool operator==(const Label&, const Label&) = default;
};

// OK if the labels ascend by value, each once, and keep to the limits above; names are one line of
// UTF-8 without control characters. INVALID_ARGUMENT names the value and what is wrong.
absl::Status ValidateLabels(const std::vector<Label>& labels);

// Sorts by value, and makes -0 to 0.
void SortLabels(std::vector<Label>* labels);

// The label of that value; null if there is none. REQUIRES: ascending by value.
const Label* FindLabel(const std::vector<Label>& labels, double value);

// `text` as a name that ValidateLabels accepts: without spaces around it; bytes that a name can't
// have become '?', and what is beyond the limit is left out, by whole characters.
std::string CleanLabelName(absl::string_view text);

// The colour of a label that has none: one of 16 by floor(value) modulo 16, so that neighbouring
// values differ. Clients in other languages have the same list (docs/labels.md).
LabelColor DefaultLabelColor(double value);

// "#rrggbb", in lower case; not set if the text has another form.
std::string ToHex(const LabelColor& color);
std::optional<LabelColor> LabelColorFromHex(absl::string_view text);

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_LABEL_H_
