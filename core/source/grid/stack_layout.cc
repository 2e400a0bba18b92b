// A layout says which plane of a file holds each slice (Z), channel (C) and step (T). LayPlanes
// computes it from letters, slowest first. A letter's stride is the product of the counts behind
// it: with "TCZ", 2 channels and 20 slices, the plane of t, c, z is 40 t + 20 c + z.
//
// ApplyPageAxes takes the letters of the user, as "TC2Z20":
//
// 1. ParsePageAxes splits it into letters and counts.
// 2. If several counts are missing, the file's own are used, if it knows them.
// 3. The last missing count follows from the number of planes: 120 planes make 3 steps.
// 4. Times and names of another count than that of steps and channels are dropped.

#include "core/source/grid/stack_layout.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <set>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/shell_word.h"

namespace isoscope::source {
namespace {

struct PageAxis {
  char letter = 'Z';
  std::int64_t count = 0;  // 0: not given
};

// Not set if the text is none. Letters in any case.
std::optional<std::vector<PageAxis>> ParsePageAxes(absl::string_view text) {
  std::string letters = absl::AsciiStrToUpper(text);
  if (absl::EndsWith(letters, "YX")) {
    letters.resize(letters.size() - 2);
  }
  std::vector<PageAxis> axes;
  std::set<char> seen;
  for (std::size_t at = 0; at < letters.size();) {
    PageAxis axis{.letter = letters[at++]};
    const std::size_t digits = at;
    while (at < letters.size() && absl::ascii_isdigit(static_cast<unsigned char>(letters[at]))) {
      ++at;
    }
    const bool has_count = at > digits;
    if (absl::string_view("TCZ").find(axis.letter) == absl::string_view::npos ||
        !seen.insert(axis.letter).second ||
        (has_count && (!absl::SimpleAtoi(letters.substr(digits, at - digits), &axis.count) ||
                       axis.count < 1 || axis.count > kMaxStackPlanes))) {
      return std::nullopt;
    }
    axes.push_back(axis);
  }
  return axes.empty() ? std::nullopt : std::optional<std::vector<PageAxis>>(axes);
}

std::int64_t* CountOf(char letter, StackLayout* layout) {
  return letter == 'T' ? &layout->steps : letter == 'C' ? &layout->channels : &layout->slices;
}

}  // namespace

void LayPlanes(absl::string_view letters, StackLayout* layout) {
  const std::int64_t count = layout->steps * layout->channels * layout->slices;
  ISOSCOPE_CHECK(count >= 1 && count <= kMaxStackPlanes);
  std::int64_t step_stride = 0;
  std::int64_t channel_stride = 0;
  std::int64_t slice_stride = 0;
  std::int64_t stride = 1;
  for (auto letter = letters.rbegin(); letter != letters.rend(); ++letter) {
    (*letter == 'T' ? step_stride : *letter == 'C' ? channel_stride : slice_stride) = stride;
    stride *= *CountOf(*letter, layout);
  }
  layout->planes.clear();
  layout->planes.reserve(static_cast<std::size_t>(count));
  for (std::int64_t t = 0; t < layout->steps; ++t) {
    for (std::int64_t c = 0; c < layout->channels; ++c) {
      for (std::int64_t z = 0; z < layout->slices; ++z) {
        layout->planes.push_back(
            {.file = 0, .index = t * step_stride + c * channel_stride + z * slice_stride});
      }
    }
  }
}

absl::Status ApplyPageAxes(absl::string_view axes, std::int64_t planes, bool is_known,
                           StackLayout* layout) {
  // 1. Letters and counts.
  std::optional<std::vector<PageAxis>> parsed = ParsePageAxes(axes);
  const auto open_count = [&] {
    return std::count_if(parsed->begin(), parsed->end(),
                         [](const PageAxis& axis) { return axis.count == 0; });
  };
  // 2. The file's own counts.
  if (parsed.has_value() && is_known && open_count() > 1) {
    for (PageAxis& axis : *parsed) {
      axis.count = axis.count == 0 ? *CountOf(axis.letter, layout) : axis.count;
    }
  }
  if (!parsed.has_value() || open_count() > 1) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "--axes %s: expected what its %d planes are, slowest first, of T (time), C (channel) and Z "
        "(slice), with the counts of all but one: --axes Z, --axes TZ20, --axes TC3Z20",
        axes, planes));
  }
  // 3. The missing count.
  std::int64_t product = 1;
  for (const PageAxis& axis : *parsed) {
    product *= std::max<std::int64_t>(axis.count, 1);
    if (product > planes) {
      break;
    }
  }
  std::string letters;
  layout->slices = layout->channels = layout->steps = 1;
  std::string counts;
  for (PageAxis& axis : *parsed) {
    if (axis.count == 0) {
      axis.count = product > 0 && planes % product == 0 ? planes / product : 0;
      product *= axis.count;
    }
    *CountOf(axis.letter, layout) = axis.count;
    letters += axis.letter;
    absl::StrAppend(&counts, counts.empty() ? "" : " x ", axis.count, " ",
                    std::string(1, axis.letter));
  }
  if (product != planes) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "--axes %s: %d planes can't be so many; they would have to be %s", axes, planes, counts));
  }
  // 4. Times and names.
  if (static_cast<std::int64_t>(layout->times.size()) != layout->steps) {
    layout->times.clear();
    layout->time_unit.clear();
  }
  if (static_cast<std::int64_t>(layout->channel_names.size()) != layout->channels) {
    layout->channel_names.clear();
  }
  layout->files.clear();
  LayPlanes(letters, layout);
  return absl::OkStatus();
}

std::string PagesAdvice(const std::string& path) {
  return absl::StrCat(
      "say what its pages are (T time, C channel, Z slice), as in `isoscope partition ",
      base::ShellWord(path), " --axes Z --output DIR`");
}

std::optional<LengthUnit> LengthUnitOf(absl::string_view text) {
  struct Spelling {
    absl::string_view text;
    const char* name;
    double metres;
  };
  // The units of OME, and the spellings of ImageJ: the two letters mu of Unicode, that of Latin-1,
  // and an escape.
  static constexpr std::array<Spelling, 47> kSpellings{{{"m", "m", 1},
                                                        {"meter", "m", 1},
                                                        {"meters", "m", 1},
                                                        {"metre", "m", 1},
                                                        {"metres", "m", 1},
                                                        {"dm", "dm", 1e-1},
                                                        {"cm", "cm", 1e-2},
                                                        {"centimeter", "cm", 1e-2},
                                                        {"centimeters", "cm", 1e-2},
                                                        {"mm", "mm", 1e-3},
                                                        {"millimeter", "mm", 1e-3},
                                                        {"millimeters", "mm", 1e-3},
                                                        {"millimetre", "mm", 1e-3},
                                                        {"millimetres", "mm", 1e-3},
                                                        {"um", "um", 1e-6},
                                                        {"\xc2\xb5m", "um", 1e-6},
                                                        {"\xce\xbcm", "um", 1e-6},
                                                        {"\xb5m", "um", 1e-6},
                                                        {"\\u00B5m", "um", 1e-6},
                                                        {"micron", "um", 1e-6},
                                                        {"microns", "um", 1e-6},
                                                        {"micrometer", "um", 1e-6},
                                                        {"micrometers", "um", 1e-6},
                                                        {"micrometre", "um", 1e-6},
                                                        {"micrometres", "um", 1e-6},
                                                        {"nm", "nm", 1e-9},
                                                        {"nanometer", "nm", 1e-9},
                                                        {"nanometers", "nm", 1e-9},
                                                        {"pm", "pm", 1e-12},
                                                        {"fm", "fm", 1e-15},
                                                        {"\xc3\x85", "angstrom", 1e-10},
                                                        {"\xe2\x84\xab", "angstrom", 1e-10},
                                                        {"angstrom", "angstrom", 1e-10},
                                                        {"angstroms", "angstrom", 1e-10},
                                                        {"dam", "dam", 1e1},
                                                        {"hm", "hm", 1e2},
                                                        {"km", "km", 1e3},
                                                        {"Mm", "Mm", 1e6},
                                                        {"in", "in", 0.0254},
                                                        {"inch", "in", 0.0254},
                                                        {"inches", "in", 0.0254},
                                                        {"thou", "thou", 0.0254e-3},
                                                        {"ft", "ft", 0.3048},
                                                        {"yd", "yd", 0.9144},
                                                        {"mi", "mi", 1609.344},
                                                        {"li", "li", 0.0254 / 12},
                                                        {"pt", "pt", 0.0254 / 72}}};
  for (const Spelling& known : kSpellings) {
    if (known.text == text) {
      return LengthUnit{.name = known.name, .metres = known.metres};
    }
  }
  return std::nullopt;
}

std::vector<std::string> NamesOfChannels(const StackLayout& layout, const std::string& field) {
  std::vector<std::string> names;
  if (layout.channels == 1) {
    names.push_back(field);
    return names;
  }
  std::set<std::string> seen;
  for (std::int64_t c = 0; c < layout.channels; ++c) {
    const bool is_named =
        layout.channel_names.size() == static_cast<std::size_t>(layout.channels) &&
        !layout.channel_names[static_cast<std::size_t>(c)].empty();
    std::string name =
        is_named ? layout.channel_names[static_cast<std::size_t>(c)] : absl::StrCat("channel ", c);
    for (int number = 2; !seen.insert(name).second; ++number) {
      const absl::string_view stem = absl::string_view(name).substr(0, name.rfind(" #"));
      name = absl::StrCat(stem, " #", number);
    }
    names.push_back(std::move(name));
  }
  return names;
}

}  // namespace isoscope::source
