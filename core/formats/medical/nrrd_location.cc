// An NRRD header is lines of text, up to an empty line:
//
//   NRRD0004                       "NRRD000" and the version
//   # anything                     a comment
//   type: short
//   dimension: 3
//   sizes: 64 64 93                fastest first
//   endian: big                    or little; for samples of several bytes
//   encoding: gzip                 or raw, bzip2, ascii (numbers), hex
//   line skip: 3                   lines before that, before anything is decoded
//   byte skip: 12                  bytes (decoded ones, if compressed) before the samples; -1: the
//                                  samples are the last bytes
//   data file: quarter.%d 1 93 1   see below
//
// Without a data file the samples follow the empty line. A data file is one of
//
//   data file: name
//   data file: FORMAT MIN MAX STEP [SUBDIM]     numbered names, the first has the number MIN
//   data file: LIST [SUBDIM]                    names in the lines that follow, to the file's end
//
// SUBDIM is the number of axes in one file: by default all but the last. With all of them, each
// file holds as many slices of the last axis. Encoding and skips are those of every file. Source:
// http://teem.sourceforge.net/nrrd/format.html, sections 4 and 5.

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"

#include "core/base/status_macros.h"
#include "core/formats/medical/nrrd_layout.h"
#include "core/formats/medical/sample_format.h"
#include "core/io/file.h"
#include "core/source/bytes/data_files.h"
#include "core/source/bytes/sample_location.h"
#include "core/source/bytes/text_header.h"

namespace isoscope::source {
namespace {

struct Encoding {
  const char* name;
  SampleEncoding encoding;
};
constexpr std::array<Encoding, 9> kEncodings{{{"raw", SampleEncoding::kRaw},
                                              {"gzip", SampleEncoding::kDeflate},
                                              {"gz", SampleEncoding::kDeflate},
                                              {"bzip2", SampleEncoding::kBzip2},
                                              {"bz2", SampleEncoding::kBzip2},
                                              {"ascii", SampleEncoding::kText},
                                              {"text", SampleEncoding::kText},
                                              {"txt", SampleEncoding::kText},
                                              {"hex", SampleEncoding::kHex}}};

struct NrrdHeader {
  HeaderFields fields;
  bool has_end = false;              // an empty line
  std::int64_t end = 0;              // the byte behind it
  std::vector<std::string> names{};  // of data files in a LIST

  // Returns a field that the format spells with a space or without.
  [[nodiscard]] std::string Get(const char* a, const char* b) const {
    return fields.Get(fields.Get(a).empty() ? b : a);
  }
  [[nodiscard]] absl::StatusOr<std::int64_t> GetInteger(const char* a, const char* b) const {
    return fields.GetInteger(fields.Get(a).empty() ? b : a, 0);
  }
  [[nodiscard]] std::string data_file() const { return Get("data file", "datafile"); }
  [[nodiscard]] bool has_list() const {
    const std::string file = data_file();
    return file == "LIST" || absl::StartsWith(file, "LIST ") || absl::StartsWith(file, "LIST\t");
  }
};

absl::StatusOr<NrrdHeader> ReadNrrdHeader(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string text, ReadTextHeader(path));
  if (!absl::StartsWith(text, "NRRD000")) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": does not start with \"NRRD000\": not an NRRD file, though its name says so"));
  }
  NrrdHeader header{.fields = HeaderFields(path)};
  std::size_t position = 0;
  absl::string_view line;
  while (!header.has_end && NextLine(text, &position, &line)) {
    const std::size_t colon = line.find(": ");
    if (line.empty()) {
      header.has_end = true;
      header.end = static_cast<std::int64_t>(position);
    } else if (header.has_list()) {
      header.names.emplace_back(absl::StripAsciiWhitespace(line));
    } else if (line[0] != '#' && colon != absl::string_view::npos) {
      const std::string key = absl::AsciiStrToLower(line.substr(0, colon));
      if (!header.fields.Get(key).empty()) {
        return absl::InvalidArgumentError(absl::StrFormat(
            "%s: NRRD header: two fields \"%s\"; expected each once", path, key.substr(0, 60)));
      }
      header.fields.Set(line.substr(0, colon), line.substr(colon + 2));
    }
  }
  return header;
}

// The files that the samples lie in, if the header names any.
absl::StatusOr<std::vector<std::string>> FindDataFiles(const NrrdHeader& header,
                                                       const std::string& path) {
  const std::string data_file = header.data_file();
  const std::optional<NumberedName> numbered = ParseNumberedName(data_file);
  const bool is_numbered = numbered.has_value() && !numbered->numbers.empty();
  if (!header.has_list() && !is_numbered) {
    return SingleFile(path, data_file);
  }
  FileShares shares;
  ISOSCOPE_ASSIGN_OR_RETURN(shares.sizes, header.fields.GetIntegers("sizes"));
  shares.axes_per_file = static_cast<std::int64_t>(shares.sizes.size()) - 1;
  if (header.has_list()) {
    const absl::string_view subdim =
        absl::StripAsciiWhitespace(absl::string_view(data_file).substr(4));
    if (!subdim.empty() && !absl::SimpleAtoi(subdim, &shares.axes_per_file)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: data file \"%s\"; expected \"LIST\" or \"LIST SUBDIM\"", path, data_file));
    }
    return ListedFiles(path, header.names, shares);
  }
  const std::vector<std::int64_t>& numbers = numbered->numbers;
  if (numbers.size() < 3 || numbers.size() > 4) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: data file \"%s\"; expected \"FORMAT MIN MAX STEP [SUBDIM]\"", path, data_file));
  }
  if (numbers.size() == 4) {
    shares.axes_per_file = numbers[3];
  }
  return NumberedFiles(path, numbered->pattern, numbers[0], numbers[1], numbers[2], shares);
}

// Moves the offset of the first file behind this number of lines.
absl::Status SkipLines(std::int64_t lines, const std::string& path, SampleLocation* location) {
  if (lines == 0) {
    return absl::OkStatus();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const auto file, io::OpenRandomAccessFile(location->files.front()));
  std::string portion(std::size_t{64} << 10, '\0');
  std::int64_t found = 0;
  for (std::int64_t at = location->offset; at < file->size_bytes();) {
    const auto size = static_cast<std::size_t>(
        std::min(file->size_bytes() - at, static_cast<std::int64_t>(portion.size())));
    ISOSCOPE_RETURN_IF_ERROR(file->ReadAt(at, size, portion.data()));
    for (std::size_t i = 0; i < size; ++i) {
      if (portion[i] == '\n' && ++found == lines) {
        location->offset = at + static_cast<std::int64_t>(i) + 1;
        return absl::OkStatus();
      }
    }
    at += static_cast<std::int64_t>(size);
  }
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: line skip %d, but %s has only %d lines there: the file is cut", path,
                      lines, location->files.front(), found));
}

absl::Status SetEncoding(const NrrdHeader& header, const std::string& path,
                         SampleLocation* location) {
  const std::string encoding = absl::AsciiStrToLower(header.fields.Get("encoding"));
  const auto* known = std::find_if(kEncodings.begin(), kEncodings.end(),
                                   [&](const Encoding& e) { return encoding == e.name; });
  if (known == kEncodings.end()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: NRRD encoding \"%s\"; expected raw, gzip, bzip2, ascii or hex: convert it (unu save "
        "-e gzip)",
        path, encoding));
  }
  location->encoding = known->encoding;
  const bool is_text = location->encoding == SampleEncoding::kText;
  const bool has_end = !is_text && location->encoding != SampleEncoding::kHex;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t line_skip,
                            header.GetInteger("line skip", "lineskip"));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t byte_skip,
                            header.GetInteger("byte skip", "byteskip"));
  if (line_skip < 0 || (line_skip > 0 && location->files.size() > 1) || byte_skip < -1 ||
      (byte_skip == -1 && !has_end) || (byte_skip > 0 && is_text)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: line skip %d, byte skip %d with encoding %s: expected a line skip of 0 or more (0 "
        "with several data files), and a byte skip of 0 or more (0 with ascii), or -1 for samples "
        "at the end of the file (with raw, gzip or bzip2)",
        path, line_skip, byte_skip, encoding));
  }
  ISOSCOPE_RETURN_IF_ERROR(SkipLines(line_skip, path, location));
  if (byte_skip == -1) {
    location->at_file_end = true;
  } else {
    (location->is_encoded() ? location->decoded_skip : location->offset) += byte_skip;
  }
  const std::string endian = absl::AsciiStrToLower(header.fields.Get("endian"));
  const std::optional<NrrdSampleType> type = NrrdTypeFromName(header.fields.Get("type"));
  const bool has_order =
      !is_text && type.has_value() && (type->wide.has_value() || volume::SizeOf(type->scalar) > 1);
  if (has_order && endian != "little" && endian != "big") {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: NRRD header: endian \"%s\" with samples of type \"%s\" in encoding %s; expected "
        "\"endian: little\" or \"endian: big\", the order of the bytes of a sample",
        path, endian, header.fields.Get("type"), encoding));
  }
  location->is_big_endian = !is_text && endian == "big";
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<HeaderFields> ReadNrrdFields(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(NrrdHeader header, ReadNrrdHeader(path));
  return std::move(header.fields);
}

absl::StatusOr<SampleLocation> LocateNrrdSamples(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const NrrdHeader header, ReadNrrdHeader(path));
  SampleLocation location;
  if (!header.data_file().empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(location.files, FindDataFiles(header, path));
  } else if (header.has_end) {
    location.files = {path};
    location.offset = header.end;
  } else {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": the NRRD header has no empty line at its end: the file is cut"));
  }
  ISOSCOPE_RETURN_IF_ERROR(SetEncoding(header, path, &location));
  return location;
}

}  // namespace isoscope::source
