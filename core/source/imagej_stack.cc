// Lines "key=value":
//
//   ImageJ=1.53t
//   images=60          all of them; one without this line
//   channels=2         each of these three only if it is above 1
//   slices=10
//   frames=3
//   unit=micron
//   spacing=0.5        between slices, in this unit; 1 without this line
//   finterval=2.5      seconds between frames
//
// The sizes of pixels are TIFF's resolution, in pixels per unit.
//
// Source: https://github.com/imagej/ImageJ, ij/io/FileSaver.java and TiffDecoder.java.

#include "core/source/imagej_stack.h"

#include <cmath>
#include <cstdint>
#include <map>
#include <optional>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"

#include "core/base/status_macros.h"

namespace isoscope::source {
namespace {

using Lines = std::map<std::string, std::string>;

Lines ImageJLines(absl::string_view description) {
  Lines lines;
  for (const absl::string_view line : absl::StrSplit(description, '\n')) {
    const std::pair<absl::string_view, absl::string_view> pair =
        absl::StrSplit(line, absl::MaxSplits('=', 1));
    lines[std::string(absl::StripAsciiWhitespace(pair.first))] =
        std::string(absl::StripAsciiWhitespace(pair.second));
  }
  return lines;
}

// 1 if the line is missing.
absl::StatusOr<std::int64_t> CountIn(const Lines& lines, const std::string& key) {
  const auto line = lines.find(key);
  std::int64_t count = 1;
  if (line != lines.end() &&
      (!absl::SimpleAtoi(line->second, &count) || count < 1 || count > kMaxStackPlanes)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("ImageJ's description has %s=%s; expected 1 "
                        "to %d",
                        key, line->second, kMaxStackPlanes));
  }
  return count;
}

// 0 if the line is missing or no number above 0.
double NumberIn(const Lines& lines, const std::string& key) {
  const auto line = lines.find(key);
  double number = 0;
  return line != lines.end() && absl::SimpleAtod(line->second, &number) && std::isfinite(number) &&
                 std::fabs(number) > 0
             ? std::fabs(number)  // a stack that was turned around has a negative one
             : 0;
}

void TakeSpacing(const Lines& lines, const PixelDensity& density, StackLayout* layout) {
  const auto unit = lines.find("unit");
  if (unit != lines.end() && unit->second != "pixel" && unit->second != "pixels") {
    const std::optional<LengthUnit> known = LengthUnitOf(unit->second);
    layout->length_unit = known.has_value() ? known->name : unit->second;
  }
  const auto size_of = [](double pixels) { return std::isfinite(1 / pixels) ? 1 / pixels : 1; };
  layout->spacing.x = density.x > 0 ? size_of(density.x) : 1;
  layout->spacing.y = density.y > 0 ? size_of(density.y) : layout->spacing.x;
  const double between = NumberIn(lines, "spacing");
  layout->spacing.z = between > 0 ? between : 1;
}

}  // namespace

bool IsImageJDescription(absl::string_view description) {
  return absl::StartsWith(description, "ImageJ=");
}

absl::StatusOr<StackLayout> ParseImageJ(absl::string_view description,
                                        const PixelDensity& density) {
  const Lines lines = ImageJLines(description);
  StackLayout layout;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t images, CountIn(lines, "images"));
  ISOSCOPE_ASSIGN_OR_RETURN(layout.channels, CountIn(lines, "channels"));
  ISOSCOPE_ASSIGN_OR_RETURN(layout.slices, CountIn(lines, "slices"));
  ISOSCOPE_ASSIGN_OR_RETURN(layout.steps, CountIn(lines, "frames"));
  if (layout.channels == 1 && layout.slices == 1 && layout.steps == 1) {
    layout.slices = images;
  }
  const std::int64_t channels_and_slices = layout.channels * layout.slices;  // below 2^40
  if (channels_and_slices > images || channels_and_slices * layout.steps != images) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "ImageJ's description has %d images, but %d channels, %d slices and %d frames; expected "
        "their product: say what they are, as with --axes Z",
        images, layout.channels, layout.slices, layout.steps));
  }
  TakeSpacing(lines, density, &layout);
  const double interval = NumberIn(lines, "finterval");
  for (std::int64_t i = 0; interval > 0 && layout.steps > 1 && i < layout.steps; ++i) {
    layout.times.push_back(static_cast<double>(i) * interval);
  }
  layout.time_unit = layout.times.empty() ? "" : "s";
  const auto time_unit = lines.find("tunit");
  if (!layout.times.empty() && time_unit != lines.end()) {
    layout.time_unit = time_unit->second;
  }
  LayPlanes("TZC", &layout);
  return layout;
}

}  // namespace isoscope::source
