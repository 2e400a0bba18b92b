#include "client-cli/output/surface_name.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/printable.h"
#include "core/cli/format.h"
#include "core/cli/usage.h"

namespace isoscope::cli {
namespace {

constexpr int kMaxZeros = 9;
constexpr std::size_t kMaxNameBytes = 255;  // of a file on Linux

// A part of a pattern that begins with a percent sign.
struct Placeholder {
  std::size_t begin = 0;
  std::size_t size = 0;
  char letter = '\0';  // 'l', 'n', '%'; 0: none of these
  int digits = 0;
};

std::vector<Placeholder> PlaceholdersOf(absl::string_view pattern) {
  std::vector<Placeholder> found;
  for (std::size_t i = pattern.find('%'); i != absl::string_view::npos;
       i = pattern.find('%', found.back().begin + found.back().size)) {
    std::size_t end = i + 1;
    while (end < pattern.size() && absl::ascii_isdigit(static_cast<unsigned char>(pattern[end]))) {
      ++end;
    }
    const absl::string_view digits = pattern.substr(i + 1, end - i - 1);
    const char letter = end < pattern.size() ? pattern[end] : '\0';
    Placeholder placeholder{.begin = i, .size = std::min(end + 1, pattern.size()) - i};
    const bool has_digits = !digits.empty();
    const bool are_digits_known =
        absl::SimpleAtoi(digits, &placeholder.digits) && placeholder.digits <= kMaxZeros;
    if ((letter == 'l' && (!has_digits || are_digits_known)) ||
        ((letter == 'n' || letter == '%') && !has_digits)) {
      placeholder.letter = letter;
    } else if (letter == '%') {
      --placeholder.size;  // the next one begins there
    }
    found.push_back(placeholder);
  }
  return found;
}

bool NamesSurface(const Placeholder& placeholder) {
  return placeholder.letter == 'l' || placeholder.letter == 'n';
}

bool IsWhole(double value) { return value == std::trunc(value) && std::abs(value) < 0x1.0p53; }

// "3+7-9".
std::string TextOfLabels(const std::vector<double>& labels) {
  std::string text;
  for (std::size_t i = 0; i < labels.size(); ++i) {
    std::size_t last = i;
    while (last + 1 < labels.size() && IsWhole(labels[last]) &&
           labels[last + 1] == labels[last] + 1) {
      ++last;
    }
    absl::StrAppend(&text, text.empty() ? "" : "+", FormatValue(labels[i]));
    if (last > i) {
      absl::StrAppend(&text, last == i + 1 ? "+" : "-", FormatValue(labels[last]));
    }
    i = last;
  }
  return text;
}

std::string TextOf(const Placeholder& placeholder, const NamedSurface& surface) {
  if (placeholder.letter == '%') {
    return "%";
  }
  if (placeholder.letter == 'n' && !surface.labels.empty()) {
    std::string name = surface.name;
    std::replace_if(
        name.begin(), name.end(),
        [](char c) {
          return !absl::ascii_isalnum(static_cast<unsigned char>(c)) && c != '.' && c != '-' &&
                 c != '_' && static_cast<unsigned char>(c) < 0x80;
        },
        '_');
    return name;
  }
  if (surface.labels.empty()) {
    return FormatValue(surface.isovalue);
  }
  const double first = surface.labels.front();
  if (placeholder.digits > 0 && surface.labels.size() == 1 && IsWhole(first)) {
    return absl::StrFormat("%0*d", placeholder.digits, static_cast<std::int64_t>(first));
  }
  return TextOfLabels(surface.labels);
}

}  // namespace

bool HasSurfaceName(absl::string_view pattern) {
  const std::vector<Placeholder> placeholders = PlaceholdersOf(pattern);
  return std::any_of(placeholders.begin(), placeholders.end(), NamesSurface);
}

absl::Status CheckSurfaceName(absl::string_view pattern) {
  if (!HasSurfaceName(pattern)) {
    return absl::OkStatus();
  }
  for (const Placeholder& placeholder : PlaceholdersOf(pattern)) {
    if (placeholder.letter == '\0') {
      return UsageError(absl::StrCat("--output '", base::Printable(pattern), "': '",
                                     pattern.substr(placeholder.begin, placeholder.size),
                                     "' is not known: write %l for the label, %03l for leading "
                                     "zeros (up to %0",
                                     kMaxZeros, "l), %n for its name, and %% for a percent sign"));
    }
  }
  return absl::OkStatus();
}

absl::StatusOr<std::vector<std::string>> SurfaceFileNames(
    absl::string_view pattern, const std::vector<NamedSurface>& surfaces) {
  const std::vector<Placeholder> placeholders = PlaceholdersOf(pattern);
  std::vector<std::string> names;
  std::map<std::string, std::size_t> surface_of_name;
  for (std::size_t i = 0; i < surfaces.size(); ++i) {
    std::string name;
    std::size_t end = 0;  // of the part that `name` has
    for (const Placeholder& placeholder : placeholders) {
      absl::StrAppend(&name, pattern.substr(end, placeholder.begin - end),
                      TextOf(placeholder, surfaces[i]));
      end = placeholder.begin + placeholder.size;
    }
    absl::StrAppend(&name, pattern.substr(end));
    if (std::filesystem::path(name).filename().string().size() > kMaxNameBytes) {
      return absl::InvalidArgumentError(
          absl::StrCat("--output '", base::Printable(pattern), "': the name of surface ", i,
                       "'s file would be longer than ", kMaxNameBytes,
                       " bytes: choose fewer labels for a surface, or name all in one file"));
    }
    const auto [known, is_new] = surface_of_name.try_emplace(name, i);
    if (!is_new) {
      return absl::InvalidArgumentError(
          absl::StrCat("--output '", base::Printable(pattern), "': surfaces ", known->second,
                       " and ", i, " would both be '", base::Printable(name),
                       "': write %l, which tells labels apart, and choose each label once"));
    }
    names.push_back(std::move(name));
  }
  return names;
}

}  // namespace isoscope::cli
