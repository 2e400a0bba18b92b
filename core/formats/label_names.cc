// Each line is one label. The first form that fits counts, in this order:
//
// 1. Label description, as ITK-SNAP writes it: seven numbers, then a name in quotation marks.
// 2. CSV: two or three cells. A quotation mark inside a quoted cell is written twice.
// 3. Colour table, as FreeSurfer writes it: a number, a name, four numbers. The last four words are
//    the numbers, so the name may have spaces.
// 4. List, as MRIcron has it: a number, a name of one word that is no number, and maybe a number.
//
// Empty lines, lines that begin with # and a first line of words are passed over. A value may occur
// once. Its line is kept until the end, for the message about a second one.

#include "core/formats/label_names.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/source/bytes/text_header.h"

namespace isoscope::source {
namespace {

using volume::Label;
using volume::LabelColor;
using LabelWords = std::vector<absl::string_view>;

constexpr std::int64_t kMaxFileBytes = 16 * base::kMiB;
// More than a name and the numbers around it take; a longer line is quoted in no message.
constexpr std::size_t kMaxQuotedBytes = 80;
constexpr const char* kForms =
    "expected VALUE NAME RED GREEN BLUE ALPHA of a colour table, VALUE RED GREEN BLUE OPACITY "
    "VISIBLE MESH \"NAME\" of a label description, VALUE NAME [NUMBER] of a list, or "
    "VALUE,NAME[,#rrggbb]";

std::optional<double> NumberIn(absl::string_view word) {
  double value = 0;
  if (!absl::SimpleAtod(word, &value) || !std::isfinite(value)) {
    return std::nullopt;
  }
  return value;
}

// Three numbers of a colour, 0 to 255.
std::optional<LabelColor> ColorOfBytes(const LabelWords& words, std::size_t first) {
  std::array<int, 3> bytes{};
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    if (!absl::SimpleAtoi(words[first + i], &bytes[i]) || bytes[i] < 0 || bytes[i] > 255) {
      return std::nullopt;
    }
  }
  return LabelColor{.red = static_cast<std::uint8_t>(bytes[0]),
                    .green = static_cast<std::uint8_t>(bytes[1]),
                    .blue = static_cast<std::uint8_t>(bytes[2])};
}

LabelWords WordsOf(absl::string_view text) {
  return absl::StrSplit(text, absl::ByAnyChar(" \t"), absl::SkipEmpty());
}

// 17 220 216 20 1 1 1 "left hippocampus"
std::optional<Label> ParseDescriptionLine(absl::string_view line) {
  const std::size_t quote = line.find('"');
  if (quote == absl::string_view::npos || line.back() != '"' || quote + 1 == line.size()) {
    return std::nullopt;
  }
  const LabelWords words = WordsOf(line.substr(0, quote));
  if (words.size() != 7) {
    return std::nullopt;
  }
  const std::optional<double> value = NumberIn(words[0]);
  const std::optional<LabelColor> color = ColorOfBytes(words, 1);
  if (!value || !color || !NumberIn(words[4]) || !NumberIn(words[5]) || !NumberIn(words[6])) {
    return std::nullopt;
  }
  return Label{.value = *value,
               .name = std::string(line.substr(quote + 1, line.size() - quote - 2)),
               .color = color};
}

// 17 Left-Hippocampus 220 216 20 0
std::optional<Label> ParseTableLine(absl::string_view line) {
  const LabelWords words = WordsOf(line);
  if (words.size() < 6) {
    return std::nullopt;
  }
  const std::size_t numbers = words.size() - 4;
  const std::optional<double> value = NumberIn(words[0]);
  const std::optional<LabelColor> color = ColorOfBytes(words, numbers);
  if (!value || !color || !NumberIn(words.back())) {
    return std::nullopt;
  }
  return Label{.value = *value,
               .name = absl::StrJoin(words.begin() + 1,
                                     words.begin() + static_cast<std::ptrdiff_t>(numbers), " "),
               .color = color};
}

// 17 Hippocampus_L 4101
std::optional<Label> ParseListLine(absl::string_view line) {
  const LabelWords words = WordsOf(line);
  if (words.size() < 2 || words.size() > 3 ||
      line.find_first_of(",\"") != absl::string_view::npos) {
    return std::nullopt;
  }
  const std::optional<double> value = NumberIn(words[0]);
  // Two numbers are no label: tables of other things have such lines.
  if (!value || NumberIn(words[1]) || (words.size() == 3 && !NumberIn(words[2]))) {
    return std::nullopt;
  }
  return Label{.value = *value, .name = std::string(words[1]), .color = std::nullopt};
}

// The cells of a line of CSV, without white space around them and quotation marks; not set if a
// quotation mark has no end.
std::optional<std::vector<std::string>> CellsOf(absl::string_view line) {
  std::vector<std::string> cells;
  for (bool has_more = true; has_more;) {
    line = absl::StripLeadingAsciiWhitespace(line);
    std::string cell;
    if (absl::ConsumePrefix(&line, "\"")) {
      for (;;) {
        const std::size_t end = line.find('"');
        if (end == absl::string_view::npos) {
          return std::nullopt;
        }
        absl::StrAppend(&cell, line.substr(0, end));
        line.remove_prefix(end + 1);
        if (!absl::ConsumePrefix(&line, "\"")) {
          break;
        }
        cell += '"';
      }
      line = absl::StripLeadingAsciiWhitespace(line);
      if (!line.empty() && line[0] != ',') {
        return std::nullopt;
      }
    } else {
      cell = std::string(absl::StripTrailingAsciiWhitespace(line.substr(0, line.find(','))));
    }
    line.remove_prefix(std::min(line.find(','), line.size()));
    has_more = absl::ConsumePrefix(&line, ",");
    cells.push_back(std::move(cell));
  }
  return cells;
}

// 17,left hippocampus,#dcd814
std::optional<Label> ParseCsvLine(absl::string_view line) {
  const std::optional<std::vector<std::string>> cells = CellsOf(line);
  if (!cells || cells->size() < 2 || cells->size() > 3) {
    return std::nullopt;
  }
  const std::optional<double> value = NumberIn((*cells)[0]);
  if (!value) {
    return std::nullopt;
  }
  Label label{.value = *value, .name = (*cells)[1]};
  if (cells->size() == 3 && !(*cells)[2].empty()) {
    label.color = volume::LabelColorFromHex((*cells)[2]);
    if (!label.color) {
      return std::nullopt;
    }
  }
  return label;
}

// "value,name,color".
bool IsCsvHead(absl::string_view line) {
  double number = 0;  // "nan" is a number, and no head
  const std::string word = absl::AsciiStrToLower(
      absl::StripAsciiWhitespace(absl::StripPrefix(line.substr(0, line.find(',')), "\"")));
  return absl::StrContains(line, ',') && !word.empty() &&
         absl::ascii_isalpha(static_cast<unsigned char>(word[0])) &&
         !absl::SimpleAtod(word, &number);
}

std::optional<Label> ParseLine(absl::string_view line) {
  for (const auto parse : {ParseDescriptionLine, ParseCsvLine, ParseTableLine, ParseListLine}) {
    if (std::optional<Label> label = parse(line)) {
      return label;
    }
  }
  return std::nullopt;
}

}  // namespace

absl::StatusOr<std::vector<Label>> ParseLabelNames(absl::string_view text,
                                                   absl::string_view where) {
  absl::ConsumePrefix(&text, "\xef\xbb\xbf");  // the mark that some editors put before UTF-8
  std::vector<Label> labels;
  std::map<double, std::int64_t> lines;  // of values
  std::size_t position = 0;
  absl::string_view line;
  std::int64_t number = 0;
  bool is_first = true;
  while (NextLine(text, &position, &line)) {
    ++number;
    line = absl::StripAsciiWhitespace(line);
    if (line.empty() || line[0] == '#' || (std::exchange(is_first, false) && IsCsvHead(line))) {
      continue;
    }
    std::optional<Label> label = ParseLine(line);
    if (!label) {
      return absl::InvalidArgumentError(absl::StrCat(
          where, ": line ", number, ": \"", base::Printable(line.substr(0, kMaxQuotedBytes)),
          line.size() > kMaxQuotedBytes ? "..." : "", "\"; ", kForms));
    }
    label->value += 0.0;  // -0 is 0
    const auto [before, is_new] = lines.emplace(label->value, number);
    if (!is_new) {
      return absl::InvalidArgumentError(absl::StrCat(where, ": line ", number, ": the value ",
                                                     label->value, " has a name in line ",
                                                     before->second, " already"));
    }
    if (const absl::Status valid = volume::ValidateLabels({*label}); !valid.ok()) {
      return absl::InvalidArgumentError(
          absl::StrCat(where, ": line ", number, ": ", valid.message()));
    }
    labels.push_back(*std::move(label));
    if (labels.size() > volume::kMaxNamedLabels) {
      break;
    }
  }
  volume::SortLabels(&labels);
  const absl::Status valid = volume::ValidateLabels(labels);
  if (!valid.ok()) {
    return absl::InvalidArgumentError(absl::StrCat(where, ": ", valid.message()));
  }
  return labels;
}

absl::StatusOr<std::vector<Label>> ReadLabelNames(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string text, io::ReadWholeFile(path, kMaxFileBytes));
  return ParseLabelNames(text, path);
}

std::optional<std::string> LabelNamesBeside(const std::string& path) {
  const absl::string_view plain = absl::StripSuffix(path, ".gz");
  if (!absl::EndsWith(plain, ".nii")) {
    return std::nullopt;
  }
  std::string names = absl::StrCat(plain, ".txt");
  if (!io::PathExists(names) || io::IsDirectory(names)) {
    return std::nullopt;
  }
  return names;
}

}  // namespace isoscope::source
