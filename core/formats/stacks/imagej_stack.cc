// Lines "key=value":
//
//   ImageJ=1.53t
//   images=60          all of them; one without this line
//   channels=2         each of these three only if it is above 1
//   slices=10
//   frames=3
//   unit=micron        of x; yunit and zunit follow if they differ
//   spacing=0.5        between slices, in this unit; 1 without this line; the sign does not count
//   xorigin=10         pixels (also yorigin, zorigin) from the first one to 0, 0, 0
//   finterval=2.5      seconds between frames; 0 where nobody said it
//
// The sizes of pixels are TIFF's resolution, in pixels per unit. Without the line unit its unit is
// TIFF's, inches or centimetres, but not of 72 pixels an inch, which is no size.
//
// Source: https://github.com/imagej/ImageJ, ij/io/FileSaver.java and TiffDecoder.java.

#include "core/formats/stacks/imagej_stack.h"

#include <cmath>
#include <cstdint>
#include <map>
#include <optional>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
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

// "" if the line is missing.
std::string ImageJLine(const Lines& lines, const std::string& key) {
  const auto line = lines.find(key);
  return line == lines.end() ? "" : line->second;
}

// 0 if the line is missing or no finite number.
double ImageJNumber(const Lines& lines, const std::string& key) {
  double number = 0;
  return absl::SimpleAtod(ImageJLine(lines, key), &number) && std::isfinite(number) ? number : 0;
}

// The unit of an axis in the one of x: the factor of its lengths.
absl::StatusOr<double> ImageJUnitFactor(const Lines& lines, const std::string& key,
                                        const std::string& unit_of_x) {
  const std::string text = ImageJLine(lines, key);
  const std::optional<LengthUnit> own = LengthUnitOf(text);
  const std::optional<LengthUnit> of_x = LengthUnitOf(unit_of_x);
  if (text.empty() || text == unit_of_x) {
    return 1;
  }
  if (!own.has_value() || !of_x.has_value()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "ImageJ's description has unit=%s and %s=%s; expected one unit, or units of "
        "length",
        unit_of_x, key, text));
  }
  return own->metres / of_x->metres;
}

// Sets the size of pixels along x and y, as far as the tags say it.
void TakeImageJPixels(const Lines& lines, const PixelDensity& density, StackLayout* layout) {
  const bool has_unit = !ImageJLine(lines, "unit").empty();
  const bool is_of_print = !has_unit && !density.unit.empty();
  constexpr double kScreen = 72;
  if (is_of_print && (ImageJLine(lines, "spacing").empty() ||
                      (density.unit == "in" && density.x == kScreen && density.y == kScreen))) {
    return;
  }
  const auto is_size = [](double pixels) { return pixels > 0 && std::isfinite(1 / pixels); };
  const bool has_x = is_size(density.x);
  const bool has_y = is_size(density.y);
  layout->spacing.x = has_x ? 1 / density.x : 1;
  layout->spacing.y = has_y ? 1 / density.y : 1;
  if (is_of_print) {
    layout->length_unit = density.unit;
  }
  const bool has_slices = !ImageJLine(lines, "spacing").empty();
  if (has_x != has_y || (!has_x && has_slices)) {
    layout->distances = absl::StrFormat(
        "ImageJ's description has %s, the tags an XResolution of %g and a YResolution of %g",
        has_slices ? absl::StrCat("spacing=", ImageJLine(lines, "spacing")) : "no spacing",
        density.x, density.y);
  }
}

absl::Status TakeImageJSpacing(const Lines& lines, const PixelDensity& density,
                               StackLayout* layout) {
  const std::string unit = ImageJLine(lines, "unit");
  if (unit != "pixel" && unit != "pixels") {
    const std::optional<LengthUnit> known = LengthUnitOf(unit);
    layout->length_unit = known.has_value() ? known->name : unit;
  }
  TakeImageJPixels(lines, density, layout);
  const std::string between = ImageJLine(lines, "spacing");
  // ImageJ drops the sign: a stack that was turned around has a negative one.
  const double distance = std::fabs(ImageJNumber(lines, "spacing"));
  if (!between.empty() && distance == 0) {
    layout->distances = absl::StrCat("ImageJ's description has spacing=", between);
  }
  layout->spacing.z = distance > 0 ? distance : 1;
  ISOSCOPE_ASSIGN_OR_RETURN(const double y_factor, ImageJUnitFactor(lines, "yunit", unit));
  ISOSCOPE_ASSIGN_OR_RETURN(const double z_factor, ImageJUnitFactor(lines, "zunit", unit));
  layout->spacing.y *= y_factor;
  layout->spacing.z *= z_factor;
  for (int axis = 0; axis < 3; ++axis) {
    const std::string key = absl::StrCat(std::string(1, "xyz"[axis]), "origin");
    layout->origin[axis] = 0 - ImageJNumber(lines, key) * layout->spacing[axis];
  }
  return absl::OkStatus();
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
        "their product",
        images, layout.channels, layout.slices, layout.steps));
  }
  ISOSCOPE_RETURN_IF_ERROR(TakeImageJSpacing(lines, density, &layout));
  double interval = 0;  // 0: not known
  const std::string interval_text = ImageJLine(lines, "finterval");
  if (layout.steps > 1 && !interval_text.empty() &&
      (!absl::SimpleAtod(interval_text, &interval) || !(interval >= 0) ||
       !std::isfinite(interval * static_cast<double>(layout.steps)))) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "ImageJ's description has finterval=%s; expected the seconds between its %d frames, 0 or "
        "more",
        interval_text, layout.steps));
  }
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
