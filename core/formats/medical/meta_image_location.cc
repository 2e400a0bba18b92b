// A MetaImage header is lines of text, the last of which says where the samples are:
//
//   ObjectType = Image
//   NDims = 3
//   DimSize = 64 64 93                  fastest first
//   ElementType = MET_SHORT
//   BinaryDataByteOrderMSB = True       big-endian
//   CompressedData = True               a zlib stream
//   BinaryData = False                  numbers as text
//   HeaderSize = 12                     bytes before the samples; -1: at the end of the file
//   ElementDataFile = quarter.%d 1 93 1
//
// ElementDataFile is one of
//
//   LOCAL                     behind this line
//   name
//   FORMAT [MIN [MAX [STEP]]] numbered names, one slice of the last axis each; from 1 by 1
//   LIST [AXES]               names in the lines that follow; AXES ("3" or "3D") is the number of
//                             axes in one file, by default all but the last
//
// Byte order, compression and HeaderSize are those of every file.
// Source: https://itk.org/Wiki/ITK/MetaIO/Documentation; MetaIO's metaImage.cxx, ReadStream.

#include <algorithm>
#include <cstddef>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

#include "core/base/status_macros.h"
#include "core/formats/medical/meta_image_grid.h"
#include "core/formats/medical/sample_format.h"
#include "core/source/bytes/data_files.h"
#include "core/source/bytes/sample_location.h"
#include "core/source/bytes/text_header.h"

namespace isoscope::source {
namespace {

struct MetaHeader {
  HeaderFields fields;
  std::string text{};
  std::size_t end = 0;  // of the line ElementDataFile, in the text

  [[nodiscard]] std::string data_file() const { return fields.Get("elementdatafile"); }
  [[nodiscard]] bool IsTrue(const char* key) const {
    return absl::StartsWithIgnoreCase(fields.Get(key), "t") || fields.Get(key) == "1";
  }
};

// MetaIO uses NDims as the length of other fields, and loops for minutes if it is negative.
absl::Status CheckAxes(const HeaderFields& fields, const std::string& path) {
  constexpr std::int64_t kMaxAxes = 10;  // MetaIO's
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t axes, fields.GetInteger("ndims", 1));
  if (axes < 1 || axes > kMaxAxes) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: NDims = %d; expected 1 to %d axes", path, axes, kMaxAxes));
  }
  return absl::OkStatus();
}

// Returns true if the field decides a sample or its place. Others, as comments, may be there twice.
bool IsFieldOfVolume(absl::string_view name) {
  for (const absl::string_view known :
       {"NDims", "DimSize", "ElementSpacing", "ElementSize", "Offset", "Position", "Origin",
        "TransformMatrix", "Rotation", "Orientation", "ElementType", "ElementNumberOfChannels",
        "BinaryData", "BinaryDataByteOrderMSB", "ElementByteOrderMSB", "CompressedData",
        "HeaderSize"}) {
    if (absl::EqualsIgnoreCase(name, known)) {
      return true;
    }
  }
  return false;
}

absl::StatusOr<MetaHeader> ReadMetaHeader(const std::string& path) {
  MetaHeader header{.fields = HeaderFields(path)};
  ISOSCOPE_ASSIGN_OR_RETURN(header.text, ReadTextHeader(path));
  absl::string_view line;
  while (header.data_file().empty() && NextLine(header.text, &header.end, &line)) {
    const std::size_t equals = line.find('=');
    if (equals == absl::string_view::npos) {
      break;  // no header line: unknown files are not read to their end
    }
    const absl::string_view name = absl::StripAsciiWhitespace(line.substr(0, equals));
    const absl::string_view value = absl::StripAsciiWhitespace(line.substr(equals + 1));
    const std::string known = header.fields.Get(absl::AsciiStrToLower(name));
    if (IsFieldOfVolume(name) && !known.empty() && known != value) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: %s = %s, and before that %s; expected the field once", path, name,
                          value.substr(0, 200), absl::string_view(known).substr(0, 200)));
    }
    header.fields.Set(name, value);
    // The check follows each line, because MetaIO does not wait for a later line either.
    ISOSCOPE_RETURN_IF_ERROR(CheckAxes(header.fields, path));
  }
  if (header.data_file().empty()) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": no line \"ElementDataFile = ...\": not a MetaImage header, or it is cut"));
  }
  if (header.fields.Get("ndims").empty() || header.fields.Get("dimsize").empty() ||
      header.fields.Get("elementtype").empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": NDims, DimSize or ElementType is missing: not a MetaImage header"));
  }
  return header;
}

absl::StatusOr<std::vector<std::string>> FindListedFiles(const MetaHeader& header,
                                                         const std::string& path,
                                                         FileShares shares) {
  const std::string data_file = header.data_file();
  absl::string_view axes = absl::StripAsciiWhitespace(absl::string_view(data_file).substr(4));
  axes = absl::StripSuffix(absl::StripSuffix(axes, "D"), "d");
  if (!axes.empty() && !absl::SimpleAtoi(axes, &shares.axes_per_file)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: ElementDataFile = %s; expected LIST, or LIST and a number of axes", path, data_file));
  }
  std::vector<std::string> names;
  std::size_t position = header.end;
  absl::string_view line;
  while (NextLine(header.text, &position, &line)) {
    line = absl::StripAsciiWhitespace(line);
    if (!line.empty()) {
      names.emplace_back(line);
    }
  }
  return ListedFiles(path, names, shares);
}

// The files that the samples lie in, unless it is LOCAL.
absl::StatusOr<std::vector<std::string>> FindDataFiles(const MetaHeader& header,
                                                       const std::string& path) {
  const std::string data_file = header.data_file();
  const bool has_list =
      absl::EqualsIgnoreCase(data_file, "LIST") || absl::StartsWithIgnoreCase(data_file, "LIST ");
  if (!has_list && !absl::StrContains(data_file, '%')) {
    return SingleFile(path, data_file);
  }
  FileShares shares;
  ISOSCOPE_ASSIGN_OR_RETURN(shares.sizes, header.fields.GetIntegers("dimsize"));
  shares.axes_per_file = static_cast<std::int64_t>(shares.sizes.size()) - 1;
  if (has_list) {
    return FindListedFiles(header, path, std::move(shares));
  }
  const std::optional<NumberedName> numbered = ParseNumberedName(data_file);
  if (!numbered.has_value() || numbered->numbers.size() > 3 || shares.sizes.empty()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: ElementDataFile = %s; expected a name with one number (%%d, %%03d) and up to three "
        "numbers behind it: MIN MAX STEP",
        path, data_file));
  }
  std::vector<std::int64_t> numbers = numbered->numbers;
  if (numbers.empty()) {
    numbers.push_back(1);
  }
  if (numbers.size() == 1) {
    constexpr std::int64_t kMaxSize = std::int64_t{1} << 31;
    numbers.push_back(numbers[0] + std::clamp<std::int64_t>(shares.sizes.back(), 1, kMaxSize) - 1);
  }
  const std::int64_t step = numbers.size() > 2 ? numbers[2] : 1;
  return NumberedFiles(path, numbered->pattern, numbers[0], numbers[1], step, shares);
}

}  // namespace

absl::StatusOr<HeaderFields> ReadMetaImageFields(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(MetaHeader header, ReadMetaHeader(path));
  return std::move(header.fields);
}

absl::StatusOr<SampleLocation> LocateMetaImageSamples(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const MetaHeader header, ReadMetaHeader(path));
  SampleLocation location;
  if (absl::EqualsIgnoreCase(header.data_file(), "LOCAL")) {
    location.files = {path};
    location.offset = static_cast<std::int64_t>(header.end);
  } else {
    ISOSCOPE_ASSIGN_OR_RETURN(location.files, FindDataFiles(header, path));
  }
  const bool is_text = !header.fields.Get("binarydata").empty() && !header.IsTrue("binarydata");
  const bool is_compressed = header.IsTrue("compresseddata");
  if (is_text && is_compressed) {
    return absl::InvalidArgumentError(
        absl::StrCat(path,
                     ": BinaryData = False with CompressedData = True; expected text or compressed "
                     "bytes: write the volume with binary data"));
  }
  location.encoding = is_text         ? SampleEncoding::kText
                      : is_compressed ? SampleEncoding::kDeflate
                                      : SampleEncoding::kRaw;
  const std::string order = header.fields.Get("binarydatabyteordermsb");
  const std::string other_order = header.fields.Get("elementbyteordermsb");
  if (!order.empty() && !other_order.empty() &&
      header.IsTrue("binarydatabyteordermsb") != header.IsTrue("elementbyteordermsb")) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: BinaryDataByteOrderMSB = %s with ElementByteOrderMSB = %s; expected "
                        "one byte order",
                        path, order, other_order));
  }
  location.is_big_endian =
      !is_text && (header.IsTrue("binarydatabyteordermsb") || header.IsTrue("elementbyteordermsb"));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t header_size,
                            header.fields.GetInteger("headersize", 0));
  if (header_size < -1 || (header_size == -1 && location.is_encoded())) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: HeaderSize = %d: expected 0 or more, or -1 with bytes that are not compressed", path,
        header_size));
  }
  if (header_size == -1) {
    location.at_file_end = true;
  } else if (header_size > 0) {
    location.offset = header_size;  // counted from the start of the file, LOCAL or not
  }
  return location;
}

}  // namespace isoscope::source
