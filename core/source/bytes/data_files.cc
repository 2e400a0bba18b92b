// A header names its files in one of three ways:
//
//   SingleFile      head.raw
//   ListedFiles     a.raw, b.raw, ...
//   NumberedFiles   slice%03d.raw 1 93 1: slice001.raw to slice093.raw
//
// CheckCount compares their number with the axes that a file holds. For 64 x 64 x 93 samples, two
// axes a file need 93 files. With three axes a file, their number must divide 93. It runs before
// names are made, so a header can't ask for billions of them. CheckExist runs last. Sources: NRRD's
// "data file", http://teem.sourceforge.net/nrrd/format.html; MetaImage's ElementDataFile,
// https://itk.org/Wiki/MetaIO/Documentation.

#include "core/source/bytes/data_files.h"

#include <algorithm>
#include <cstddef>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/io/mounted_file.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxFiles = 100000;

// "data.raw" beside "/d/head.nhdr" is "/d/data.raw".
std::string BesideHeader(const std::string& header_path, absl::string_view name) {
  const std::size_t slash = header_path.rfind('/');
  if (absl::StartsWith(name, "/") || slash == std::string::npos) {
    return absl::StrCat(name);
  }
  return absl::StrCat(header_path.substr(0, slash + 1), name);
}

absl::Status CheckExist(const std::string& header_path, const std::vector<std::string>& files) {
  // What an address sends names no file of this machine, and no other address.
  if (io::IsMounted(header_path) && files != std::vector<std::string>{header_path}) {
    return absl::InvalidArgumentError(absl::StrCat(
        header_path, ": its samples are in ", files.size() == 1 ? "another file" : "other files",
        ", which can't be read at an address; bring them all to a folder, each with: "
        "isoscope copy ADDRESS DIR"));
  }
  for (const std::string& file : files) {
    if (!io::PathExists(file)) {
      return absl::NotFoundError(
          absl::StrCat(header_path, ": its data file ", file, " does not exist"));
    }
  }
  return absl::OkStatus();
}

absl::Status CheckCount(const std::string& header_path, std::int64_t count,
                        const FileShares& shares) {
  const auto axis_count = static_cast<std::int64_t>(shares.sizes.size());
  if (shares.axes_per_file < 1 || shares.axes_per_file > axis_count) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: data files of %d axes each; expected 1 to %d", header_path,
                        shares.axes_per_file, axis_count));
  }
  const std::string sizes = absl::StrJoin(shares.sizes, " x ");
  if (count < 1 || count > kMaxFiles) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d data files for %s samples; expected 1 to %d", header_path, count,
                        sizes, kMaxFiles));
  }
  if (shares.axes_per_file == axis_count) {
    if (shares.sizes.back() % count != 0) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: %d data files, which can't share the last axis of %s samples evenly",
                          header_path, count, sizes));
    }
    return absl::OkStatus();
  }
  double needed = 1;  // any product of sizes
  for (std::int64_t axis = shares.axes_per_file; axis < axis_count; ++axis) {
    needed *= static_cast<double>(shares.sizes[static_cast<std::size_t>(axis)]);
  }
  if (static_cast<double>(count) != needed) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d data files of %d axes each; %s samples need %.0f", header_path,
                        count, shares.axes_per_file, sizes, needed));
  }
  return absl::OkStatus();
}

}  // namespace

std::optional<NumberedName> ParseNumberedName(absl::string_view text) {
  constexpr std::size_t kMaxWidthDigits = 3;
  const std::size_t percent = text.find('%');
  if (percent == absl::string_view::npos) {
    return std::nullopt;
  }
  std::size_t at = percent + 1;
  while (at < text.size() && absl::ascii_isdigit(static_cast<unsigned char>(text[at]))) {
    ++at;
  }
  if (at == text.size() || at - percent - 1 > kMaxWidthDigits ||
      (text[at] != 'd' && text[at] != 'i' && text[at] != 'u')) {
    return std::nullopt;
  }
  // Names may have spaces before the number, none behind.
  const std::size_t end = std::min(text.find_first_of(" \t", at), text.size());
  NumberedName name;
  name.pattern = absl::StrCat(text.substr(0, at), "d", text.substr(at + 1, end - at - 1));
  for (const absl::string_view word :
       absl::StrSplit(text.substr(end), absl::ByAnyChar(" \t"), absl::SkipEmpty())) {
    std::int32_t number = 0;  // no format has more bits
    if (!absl::SimpleAtoi(word, &number)) {
      return std::nullopt;
    }
    name.numbers.push_back(number);
  }
  return name;
}

absl::StatusOr<std::vector<std::string>> SingleFile(const std::string& header_path,
                                                    absl::string_view name) {
  std::vector<std::string> files{BesideHeader(header_path, name)};
  ISOSCOPE_RETURN_IF_ERROR(CheckExist(header_path, files));
  return files;
}

absl::StatusOr<std::vector<std::string>> ListedFiles(const std::string& header_path,
                                                     const std::vector<std::string>& names,
                                                     const FileShares& shares) {
  ISOSCOPE_RETURN_IF_ERROR(
      CheckCount(header_path, static_cast<std::int64_t>(names.size()), shares));
  std::vector<std::string> files;
  files.reserve(names.size());
  for (const std::string& name : names) {
    files.push_back(BesideHeader(header_path, name));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckExist(header_path, files));
  return files;
}

absl::StatusOr<std::vector<std::string>> NumberedFiles(const std::string& header_path,
                                                       const std::string& pattern,
                                                       std::int64_t first, std::int64_t last,
                                                       std::int64_t step,
                                                       const FileShares& shares) {
  constexpr std::int64_t kMaxNumber = std::int64_t{1} << 31;  // the formats' own
  const auto is_number = [](std::int64_t n) { return n >= -kMaxNumber && n < kMaxNumber; };
  if (!is_number(first) || !is_number(last) || !is_number(step) || step == 0 ||
      (first != last && (last > first) != (step > 0))) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: data files %s from %d to %d by %d; expected a step that leads from "
                        "the first to the last, of 32 bits each",
                        header_path, pattern, first, last, step));
  }
  const std::int64_t count = (last - first) / step + 1;
  ISOSCOPE_RETURN_IF_ERROR(CheckCount(header_path, count, shares));
  const auto format = absl::ParsedFormat<'d'>::New(pattern);
  if (format == nullptr) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: data files \"%s\"; expected one number in the name, as %%d or %%03d",
                        header_path, pattern));
  }
  std::vector<std::string> files;
  files.reserve(static_cast<std::size_t>(count));
  for (std::int64_t i = 0; i < count; ++i) {
    files.push_back(BesideHeader(header_path, absl::StrFormat(*format, first + i * step)));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckExist(header_path, files));
  return files;
}

}  // namespace isoscope::source
