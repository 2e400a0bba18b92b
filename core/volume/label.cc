#include "core/volume/label.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/printable.h"

namespace isoscope::volume {
namespace {

// Hues lie a golden section of the circle apart, in three lightnesses, so that values next to each
// other differ in both. Made in the OKLCH space with chroma 0.16, or less where sRGB ends.
constexpr std::array<std::uint32_t, 16> kPalette{
    {0xfe8677, 0x2a89e2, 0xd0dc51, 0xec83d4, 0x0a999d, 0xfec493, 0xa4a2fe, 0x339f46, 0xfebdc7,
     0x18bdfa, 0x9f840d, 0xebbdfd, 0x0cc9af, 0xd35e2e, 0xbad1ff, 0x94bf41}};

LabelColor ColorOf(std::uint32_t rgb) {
  return {.red = static_cast<std::uint8_t>(rgb >> 16),
          .green = static_cast<std::uint8_t>((rgb >> 8) & 0xff),
          .blue = static_cast<std::uint8_t>(rgb & 0xff)};
}

bool IsBefore(const Label& a, const Label& b) { return a.value < b.value; }

}  // namespace

absl::Status ValidateLabels(const std::vector<Label>& labels) {
  if (labels.size() > kMaxNamedLabels) {
    return absl::InvalidArgumentError(
        absl::StrCat(labels.size(), " labels: at most ", kMaxNamedLabels, " are allowed"));
  }
  std::size_t text_bytes = 0;
  const Label* before = nullptr;
  for (const Label& label : labels) {
    if (!std::isfinite(label.value)) {
      return absl::InvalidArgumentError(
          absl::StrCat("the value of a label is ", label.value, "; expected a finite number"));
    }
    if (before != nullptr && !(before->value < label.value)) {
      return absl::InvalidArgumentError(absl::StrCat("the label ", label.value, " comes after ",
                                                     before->value,
                                                     "; expected ascending values, each once"));
    }
    if (label.name.size() > kMaxLabelNameBytes) {
      return absl::InvalidArgumentError(absl::StrCat("the name of the label ", label.value, " has ",
                                                     label.name.size(), " bytes: at most ",
                                                     kMaxLabelNameBytes, " are allowed"));
    }
    if (base::Printable(label.name) != label.name) {
      return absl::InvalidArgumentError(
          absl::StrCat("the name of the label ", label.value, ", \"", base::Printable(label.name),
                       "\", has bytes that are no UTF-8, or control characters"));
    }
    text_bytes += label.name.size();
    before = &label;
  }
  if (text_bytes > kMaxLabelTextBytes) {
    return absl::InvalidArgumentError(absl::StrCat(
        "names of ", text_bytes, " bytes together: at most ", kMaxLabelTextBytes, " are allowed"));
  }
  return absl::OkStatus();
}

void SortLabels(std::vector<Label>* labels) {
  for (Label& label : *labels) {
    label.value += 0.0;
  }
  std::stable_sort(labels->begin(), labels->end(), IsBefore);
}

const Label* FindLabel(const std::vector<Label>& labels, double value) {
  const auto found =
      std::lower_bound(labels.begin(), labels.end(), Label{.value = value}, IsBefore);
  return found != labels.end() && found->value == value ? &*found : nullptr;
}

std::string CleanLabelName(absl::string_view text) {
  std::string name = base::Printable(absl::StripAsciiWhitespace(text));
  if (name.size() > kMaxLabelNameBytes) {
    std::size_t end = kMaxLabelNameBytes;
    while (end > 0 && (static_cast<unsigned char>(name[end]) & 0xc0U) == 0x80U) {
      --end;
    }
    name.resize(end);
  }
  return std::string(absl::StripAsciiWhitespace(name));
}

LabelColor DefaultLabelColor(double value) {
  constexpr auto kCount = static_cast<double>(kPalette.size());
  const double index = std::isfinite(value) ? std::floor(value) : 0;
  const double turn = index - std::floor(index / kCount) * kCount;  // exact: kCount is 2^4
  return ColorOf(kPalette[static_cast<std::size_t>(turn)]);
}

std::string ToHex(const LabelColor& color) {
  return absl::StrFormat("#%02x%02x%02x", color.red, color.green, color.blue);
}

std::optional<LabelColor> LabelColorFromHex(absl::string_view text) {
  const bool has_form =
      text.size() == 7 && text[0] == '#' && std::all_of(text.begin() + 1, text.end(), [](char c) {
        return absl::ascii_isxdigit(static_cast<unsigned char>(c));
      });
  if (!has_form) {
    return std::nullopt;
  }
  const std::string bytes = absl::HexStringToBytes(text.substr(1));
  return LabelColor{.red = static_cast<std::uint8_t>(bytes[0]),
                    .green = static_cast<std::uint8_t>(bytes[1]),
                    .blue = static_cast<std::uint8_t>(bytes[2])};
}

}  // namespace isoscope::volume
