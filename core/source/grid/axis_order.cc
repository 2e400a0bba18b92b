#include "core/source/grid/axis_order.h"

#include <array>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

namespace isoscope::source {
namespace {

struct AxisLabel {
  const char* text;
  char letter;
};
constexpr std::array<AxisLabel, 22> kAxisLabels{
    {{"t", 'T'},          {"time", 'T'}, {"times", 'T'},   {"step", 'T'},     {"timestep", 'T'},
     {"frame", 'T'},      {"c", 'C'},    {"channel", 'C'}, {"channels", 'C'}, {"component", 'C'},
     {"components", 'C'}, {"z", 'Z'},    {"nz", 'Z'},      {"depth", 'Z'},    {"slice", 'Z'},
     {"y", 'Y'},          {"ny", 'Y'},   {"height", 'Y'},  {"row", 'Y'},      {"x", 'X'},
     {"nx", 'X'},         {"width", 'X'}}};

}  // namespace

absl::StatusOr<AxisOrder> ParseAxisOrder(absl::string_view letters) {
  std::array<std::optional<std::size_t>, 5> found;
  constexpr absl::string_view kLetters = "TCZYX";
  bool is_good = true;
  for (std::size_t axis = 0; axis < letters.size(); ++axis) {
    const std::size_t letter =
        kLetters.find(absl::ascii_toupper(static_cast<unsigned char>(letters[axis])));
    if (letter != absl::string_view::npos && !found[letter].has_value()) {
      found[letter] = axis;
    } else if (letters[axis] != '-') {
      is_good = false;
    }
  }
  const auto& [t, c, z, y, x] = found;
  if (!is_good || !z.has_value() || !y.has_value() || !x.has_value() || *z > *y || *y > *x) {
    return absl::InvalidArgumentError(absl::StrCat(
        "axes \"", letters,
        "\"; expected one letter for each axis, slowest first: Z, Y and X in this order, at most "
        "one T (time) and one C (components)"));
  }
  return AxisOrder{.z = *z, .y = *y, .x = *x, .t = t, .c = c};
}

std::string AxisLetters(const AxisOrder& order, std::size_t rank) {
  std::string letters(rank, '-');
  letters[order.z] = 'Z';
  letters[order.y] = 'Y';
  letters[order.x] = 'X';
  if (order.t.has_value()) {
    letters[*order.t] = 'T';
  }
  if (order.c.has_value()) {
    letters[*order.c] = 'C';
  }
  return letters;
}

char AxisLetterOf(absl::string_view label) {
  const std::string lower = absl::AsciiStrToLower(absl::StripAsciiWhitespace(label));
  for (const AxisLabel& known : kAxisLabels) {
    if (lower == known.text) {
      return known.letter;
    }
  }
  return '?';
}

std::vector<std::string> AxisLabelsIn(absl::string_view text) {
  std::vector<std::string> labels;
  if (text.find("\"key\"") != absl::string_view::npos) {
    constexpr absl::string_view kKey = "\"key\"";
    for (std::size_t at = text.find(kKey); at != absl::string_view::npos;
         at = text.find(kKey, at + 1)) {
      const std::size_t begin = text.find('"', at + kKey.size());
      const std::size_t end = begin == absl::string_view::npos ? begin : text.find('"', begin + 1);
      if (end == absl::string_view::npos) {
        return {};
      }
      labels.emplace_back(text.substr(begin + 1, end - begin - 1));
    }
    return labels;
  }
  labels = absl::StrSplit(text, absl::ByAnyChar(" ,;[]()\"'\t"), absl::SkipEmpty());
  if (labels.size() == 1) {
    const std::string word = labels[0];
    labels.clear();
    for (const char letter : word) {
      labels.emplace_back(1, letter);
    }
  }
  return labels;
}

std::optional<AxisOrder> PlainAxisOrder(const std::vector<std::int64_t>& dims) {
  std::vector<std::size_t> wide;
  for (std::size_t axis = 0; axis < dims.size(); ++axis) {
    if (dims[axis] != 1) {
      wide.push_back(axis);
    }
  }
  if (dims.size() == 3) {
    return AxisOrder{.z = 0, .y = 1, .x = 2};
  }
  if (dims.size() < 3 || wide.size() != 3) {
    return std::nullopt;
  }
  return AxisOrder{.z = wide[0], .y = wide[1], .x = wide[2]};
}

std::string AxisChoices(std::size_t rank) {
  return rank == 3   ? "ZYX"
         : rank == 4 ? "TZYX, CZYX or ZYXC"
         : rank == 5 ? "TCZYX, TZYXC, TZCYX or CTZYX"
                     : "";
}

}  // namespace isoscope::source
