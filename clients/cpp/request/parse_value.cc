// Grammar of the values, shared by flags, URLs and files:
//
//   number    what absl::SimpleAtod accepts, finite; surrounding text is an error
//   list      COUNT numbers between commas
//   size      number and unit, powers of 1024; the number must end in a digit
//   color     CSS name, "#" and hexadecimal digits, or a list of 3 or 4 numbers in [0, 1]
//
// A parser accepts the whole text or returns an error that quotes it.

#include "clients/cpp/request/parse_value.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

#include "clients/cpp/request/color_names.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/volume/block_layout.h"

namespace isoscope::client {
namespace {

absl::Status Malformed(absl::string_view text, absl::string_view expected) {
  return absl::InvalidArgumentError(absl::StrCat(base::Quoted(text, '\''), " is not ", expected));
}

// Parses `count` numbers between commas.
absl::StatusOr<std::vector<double>> ParseList(absl::string_view text, std::size_t min_count,
                                              std::size_t max_count, absl::string_view expected) {
  const std::vector<absl::string_view> elements = absl::StrSplit(text, ',');
  if (elements.size() < min_count || elements.size() > max_count) {
    return Malformed(text, expected);
  }
  std::vector<double> values;
  for (const absl::string_view element : elements) {
    double value = 0;
    if (!absl::SimpleAtod(element, &value) || !std::isfinite(value)) {
      return Malformed(text, expected);
    }
    values.push_back(value);
  }
  return values;
}

absl::StatusOr<math::Index3> ParseIndex3(absl::string_view text, char separator, std::int64_t min,
                                         std::int64_t max, absl::string_view expected) {
  const std::vector<absl::string_view> elements = absl::StrSplit(text, separator);
  if (elements.size() != 3) {
    return Malformed(text, expected);
  }
  math::Index3 result;
  for (int axis = 0; axis < 3; ++axis) {
    std::int64_t value = 0;
    if (!absl::SimpleAtoi(elements[static_cast<std::size_t>(axis)], &value) || value < min ||
        value > max) {
      return Malformed(text, expected);
    }
    result[axis] = value;
  }
  return result;
}

}  // namespace

absl::StatusOr<std::int64_t> ParseInteger(absl::string_view text, std::int64_t min,
                                          std::int64_t max) {
  std::int64_t value = 0;
  if (!absl::SimpleAtoi(text, &value) || value < min || value > max) {
    return Malformed(text, absl::StrCat("a whole number from ", min, " to ", max));
  }
  return value;
}

absl::StatusOr<std::uint64_t> ParseUnsigned(absl::string_view text) {
  std::uint64_t value = 0;
  if (!absl::SimpleAtoi(text, &value)) {
    return Malformed(
        text, absl::StrCat("a whole number from 0 to ", std::numeric_limits<std::uint64_t>::max()));
  }
  return value;
}

absl::StatusOr<double> ParseNumber(absl::string_view text) {
  double value = 0;
  if (!absl::SimpleAtod(text, &value) || !std::isfinite(value)) {
    return Malformed(text, "a finite number");
  }
  return value;
}

absl::StatusOr<double> ParsePositiveNumber(absl::string_view text) {
  double value = 0;
  if (!absl::SimpleAtod(text, &value) || !std::isfinite(value) || value <= 0) {
    return Malformed(text, "a number above 0");
  }
  return value;
}

absl::StatusOr<math::Vec3d> ParseVector(absl::string_view text) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> values,
                            ParseList(text, 3, 3, "X,Y,Z, three numbers between commas"));
  return math::Vec3d{values[0], values[1], values[2]};
}

absl::StatusOr<math::Vec3d> ParsePositiveVector(absl::string_view text) {
  constexpr absl::string_view kExpected = "X,Y,Z, three numbers above 0 between commas";
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> values, ParseList(text, 3, 3, kExpected));
  for (const double value : values) {
    if (value <= 0) {
      return Malformed(text, kExpected);
    }
  }
  return math::Vec3d{values[0], values[1], values[2]};
}

absl::StatusOr<view::Region> ParseRegion(absl::string_view text) {
  constexpr absl::string_view kExpected =
      "X,Y,W,H, four whole numbers of pixels: the first column and row, from 0, and the size";
  const std::vector<absl::string_view> elements = absl::StrSplit(text, ',');
  std::array<int, 4> values{};
  if (elements.size() != values.size()) {
    return Malformed(text, kExpected);
  }
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!absl::SimpleAtoi(elements[i], &values[i]) || values[i] < (i < 2 ? 0 : 1) ||
        values[i] > view::kMaxWholeViewportPx) {
      return Malformed(text, kExpected);
    }
  }
  return view::Region{values[0], values[1], values[2], values[3]};
}

absl::StatusOr<math::Index3> ParseDims(absl::string_view text) {
  return ParseIndex3(text, ',', 2, std::numeric_limits<std::int32_t>::max(),
                     "X,Y,Z, three whole numbers of samples, each at least 2");
}

absl::StatusOr<math::Index3> ParseBlockCells(absl::string_view text) {
  constexpr std::int64_t kMax = volume::BlockLayout::kMaxBlockCells;
  const std::string expected =
      absl::StrCat("N or NXxNYxNZ, whole numbers of cells from 1 to ", kMax);
  if (absl::StrContains(text, 'x')) {
    return ParseIndex3(text, 'x', 1, kMax, expected);
  }
  std::int64_t value = 0;
  if (!absl::SimpleAtoi(text, &value) || value < 1 || value > kMax) {
    return Malformed(text, expected);
  }
  return math::Index3{value, value, value};
}

absl::StatusOr<std::int64_t> ParseByteSize(absl::string_view text) {
  constexpr absl::string_view kExpected =
      "a size of at least one byte: a number, then K, M, G, T, KiB, MiB, GiB, TiB or nothing";
  constexpr std::array<std::pair<absl::string_view, std::int64_t>, 4> kUnits = {
      {{"K", base::kKiB}, {"M", base::kMiB}, {"G", base::kGiB}, {"T", 1024 * base::kGiB}}};
  absl::string_view digits = text;
  std::int64_t unit = 1;
  for (const auto& [name, factor] : kUnits) {
    if (absl::EndsWith(digits, absl::StrCat(name, "iB"))) {
      digits.remove_suffix(3);
      unit = factor;
      break;
    }
    if (absl::EndsWith(digits, name)) {
      digits.remove_suffix(1);
      unit = factor;
      break;
    }
  }
  double value = 0;
  // The digit at the end excludes "1 K", "infK" and "1e".
  if (digits.empty() || !absl::ascii_isdigit(static_cast<unsigned char>(digits.back())) ||
      !absl::SimpleAtod(digits, &value)) {
    return Malformed(text, kExpected);
  }
  const double bytes = std::floor(value * static_cast<double>(unit));
  if (!(bytes >= 1 && bytes < 9.0e18)) {
    return Malformed(text, kExpected);
  }
  return static_cast<std::int64_t>(bytes);
}

absl::StatusOr<absl::Duration> ParseSeconds(absl::string_view text) {
  double seconds = 0;
  absl::Duration duration;
  if (absl::SimpleAtod(text, &seconds)) {
    duration = std::isfinite(seconds) ? absl::Seconds(seconds) : absl::ZeroDuration();
  } else if (!absl::ParseDuration(text, &duration)) {
    duration = absl::ZeroDuration();
  }
  if (duration <= absl::ZeroDuration() || duration == absl::InfiniteDuration()) {
    return Malformed(text, "a number of seconds above 0 (30, 1.5s, 2m)");
  }
  return duration;
}

namespace {

absl::StatusOr<frame::Color> ParseChannels(absl::string_view text, std::size_t max_count,
                                           absl::string_view expected) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> values,
                            ParseList(text, 3, max_count, expected));
  for (const double value : values) {
    if (value < 0 || value > 1) {
      return Malformed(text, expected);
    }
  }
  const auto channel = [&](std::size_t i) { return static_cast<float>(values[i]); };
  return frame::Color{.red = channel(0),
                      .green = channel(1),
                      .blue = channel(2),
                      .alpha = values.size() > 3 ? channel(3) : 1.0F};
}

// "#RGB", "#RRGGBB", and with an alpha of as many digits each, "#RGBA", "#RRGGBBAA".
absl::StatusOr<frame::Color> ParseHexColor(absl::string_view text, std::size_t max_count,
                                           absl::string_view expected) {
  const absl::string_view digits = text.substr(1);
  const std::size_t digits_each = digits.size() > 4 ? 2 : 1;
  const std::size_t count = digits.size() / digits_each;
  std::uint32_t value = 0;
  if (count < 3 || count > max_count || digits.size() % digits_each != 0 ||
      !std::all_of(digits.begin(), digits.end(), absl::ascii_isxdigit) ||
      !absl::SimpleHexAtoi(digits, &value)) {
    return Malformed(text, expected);
  }
  const unsigned bits = digits_each == 2 ? 8U : 4U;
  const std::uint32_t most = (1U << bits) - 1;
  const auto channel = [&](std::size_t i) {
    const auto shift = static_cast<unsigned>(count - 1 - i) * bits;
    return static_cast<float>(value >> shift & most) / static_cast<float>(most);
  };
  return frame::Color{.red = channel(0),
                      .green = channel(1),
                      .blue = channel(2),
                      .alpha = count > 3 ? channel(3) : 1.0F};
}

absl::StatusOr<frame::Color> ParseAnyColor(absl::string_view text, std::size_t max_count,
                                           absl::string_view expected) {
  if (const std::optional<std::uint32_t> rgb = NamedColor(text); rgb) {
    const auto channel = [&](unsigned shift) {
      return static_cast<float>(*rgb >> shift & 0xff) / 255.0F;
    };
    return frame::Color{.red = channel(16), .green = channel(8), .blue = channel(0), .alpha = 1};
  }
  return absl::StartsWith(text, "#") ? ParseHexColor(text, max_count, expected)
                                     : ParseChannels(text, max_count, expected);
}

}  // namespace

absl::StatusOr<frame::Color> ParseColor(absl::string_view text) {
  return ParseAnyColor(text, 3,
                       "a colour: a name of CSS as 'teal', #RRGGBB, or R,G,B, three numbers from 0 "
                       "to 1 between commas");
}

absl::StatusOr<frame::Color> ParseColorWithAlpha(absl::string_view text) {
  return ParseAnyColor(text, 4,
                       "a colour: a name of CSS as 'teal', #RRGGBB or #RRGGBBAA, or R,G,B or "
                       "R,G,B,A, numbers from 0 to 1 between commas");
}

absl::StatusOr<SurfaceValue> ParseSurface(absl::string_view text) {
  constexpr absl::string_view kExpected =
      "V, V:COLOR or V:COLOR:OPACITY, a level, a colour (a name of CSS as 'teal', #RRGGBB, or "
      "R,G,B "
      "from 0 to 1), and a number above 0, at most 1";
  const std::vector<absl::string_view> parts = absl::StrSplit(text, ':');
  const absl::StatusOr<double> isovalue = ParseNumber(parts[0]);
  if (!isovalue.ok() || parts.size() > 3) {
    return Malformed(text, kExpected);
  }
  SurfaceValue surface{.isovalue = *isovalue, .color = std::nullopt};
  if (parts.size() > 1) {
    const absl::StatusOr<frame::Color> color = ParseColor(parts[1]);
    if (!color.ok()) {
      return Malformed(text, kExpected);
    }
    surface.color = *color;
  }
  if (parts.size() > 2) {
    const absl::StatusOr<double> opacity = ParseNumber(parts[2]);
    if (!opacity.ok() || !(*opacity > 0) || *opacity > 1) {
      return Malformed(text, kExpected);
    }
    surface.color->alpha = static_cast<float>(*opacity);
  }
  return surface;
}

absl::StatusOr<PlaneValue> ParsePlane(absl::string_view text) {
  constexpr absl::string_view kExpected =
      "NX,NY,NZ,D, four numbers between commas, the first three not all 0";
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> values, ParseList(text, 4, 4, kExpected));
  if (values[0] == 0 && values[1] == 0 && values[2] == 0) {
    return Malformed(text, kExpected);
  }
  return PlaneValue{.normal = {values[0], values[1], values[2]}, .offset = values[3]};
}

absl::StatusOr<math::Box3d> ParseBox(absl::string_view text) {
  constexpr absl::string_view kExpected =
      "X0,X1,Y0,Y1,Z0,Z1, six numbers between commas, each first one at most the second";
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> values, ParseList(text, 6, 6, kExpected));
  math::Box3d box;
  for (int axis = 0; axis < 3; ++axis) {
    const auto first = static_cast<std::size_t>(2 * axis);
    if (values[first] > values[first + 1]) {
      return Malformed(text, kExpected);
    }
    box.min[axis] = values[first];
    box.max[axis] = values[first + 1];
  }
  return box;
}

}  // namespace isoscope::client
