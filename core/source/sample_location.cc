#include "core/source/sample_location.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/source/inflate_reader.h"

namespace isoscope::source {
namespace {

// Headers of text formats are at most this long.
constexpr std::int64_t kMaxTextHeaderBytes = 256 * base::kKiB;

// "data.raw" beside "/d/head.nhdr" is "/d/data.raw".
std::string BesideHeader(const std::string& header_path, absl::string_view name) {
  const std::size_t slash = header_path.rfind('/');
  if (absl::StartsWith(name, "/") || slash == std::string::npos) {
    return absl::StrCat(name);
  }
  return absl::StrCat(header_path.substr(0, slash + 1), name);
}

absl::Status CheckDataFile(const std::string& header_path, const std::string& data_path) {
  if (!io::PathExists(data_path)) {
    return absl::NotFoundError(
        absl::StrCat(header_path, ": its data file ", data_path, " does not exist"));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::string> ReadTextHeader(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(path));
  std::string text(static_cast<std::size_t>(std::min(file->size_bytes(), kMaxTextHeaderBytes)),
                   '\0');
  ISOSCOPE_RETURN_IF_ERROR(file->ReadAt(0, text.size(), text.data()));
  return text;
}

// Takes the next line off `text`, from `position`, without its end. False at the end of the text.
bool NextLine(absl::string_view text, std::size_t* position, absl::string_view* line) {
  if (*position >= text.size()) {
    return false;
  }
  const std::size_t end = text.find('\n', *position);
  if (end == absl::string_view::npos) {
    *line = text.substr(*position);
    *position = text.size();
  } else {
    *line = text.substr(*position, end - *position);
    *position = end + 1;
  }
  *line = absl::StripSuffix(*line, "\r");
  return true;
}

// A field of a text header, "" if it is absent.
class Fields {
 public:
  explicit Fields(std::string path) : path_(std::move(path)) {}

  void Set(absl::string_view key, absl::string_view value) {
    fields_[absl::AsciiStrToLower(absl::StripAsciiWhitespace(key))] =
        std::string(absl::StripAsciiWhitespace(value));
  }
  [[nodiscard]] std::string Get(const std::string& key) const {
    const auto found = fields_.find(key);
    return found == fields_.end() ? "" : found->second;
  }
  // An integer, `fallback` if absent.
  [[nodiscard]] absl::StatusOr<std::int64_t> GetInteger(const std::string& key,
                                                        std::int64_t fallback) const {
    const std::string text = Get(key);
    std::int64_t value = fallback;
    if (!text.empty() && !absl::SimpleAtoi(text, &value)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: header field \"%s\" is \"%s\"; expected an integer", path_, key, text));
    }
    return value;
  }

 private:
  std::string path_;
  std::map<std::string, std::string> fields_;
};

// NIfTI-1: https://nifti.nimh.nih.gov/nifti-1, nifti1.h.

struct NiftiType {
  std::int16_t code;
  volume::ScalarType type;
};
constexpr std::array<NiftiType, 8> kNiftiTypes{{{2, volume::ScalarType::kUint8},
                                                {4, volume::ScalarType::kInt16},
                                                {8, volume::ScalarType::kInt32},
                                                {16, volume::ScalarType::kFloat32},
                                                {64, volume::ScalarType::kFloat64},
                                                {256, volume::ScalarType::kInt8},
                                                {512, volume::ScalarType::kUint16},
                                                {768, volume::ScalarType::kUint32}}};
constexpr std::size_t kNiftiHeaderBytes = 348;

template <typename T>
T LoadSwapped(const char* in, bool is_swapped) {
  std::array<char, sizeof(T)> bytes;
  std::copy_n(in, sizeof(T), bytes.begin());
  if (is_swapped) {
    std::reverse(bytes.begin(), bytes.end());
  }
  return base::LoadLittleEndian<T>(bytes.data());
}

bool IsGzipName(const std::string& path) { return absl::EndsWithIgnoreCase(path, ".gz"); }

absl::StatusOr<SampleLocation> LocateNifti(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(path));
  std::array<char, kNiftiHeaderBytes> header{};
  std::size_t size = 0;
  if (IsGzipName(path)) {
    InflateReader reader(file.get(), 0);
    ISOSCOPE_ASSIGN_OR_RETURN(size, reader.Read(header.size(), header.data()));
  } else {
    size = static_cast<std::size_t>(
        std::min(file->size_bytes(), static_cast<std::int64_t>(header.size())));
    ISOSCOPE_RETURN_IF_ERROR(file->ReadAt(0, size, header.data()));
  }
  if (size < header.size()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: the NIfTI header has %d bytes, expected %d: the file is cut", path,
                        size, header.size()));
  }
  SampleLocation location;
  if (LoadSwapped<std::int32_t>(header.data(), true) == std::int32_t{kNiftiHeaderBytes}) {
    location.is_big_endian = true;
  } else if (LoadSwapped<std::int32_t>(header.data(), false) != std::int32_t{kNiftiHeaderBytes}) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: the header starts with %d, expected 348: not a NIfTI-1 file (NIfTI-2 "
                        "is not supported)",
                        path, LoadSwapped<std::int32_t>(header.data(), false)));
  }
  const bool is_swapped = location.is_big_endian;
  const std::string magic(header.data() + 344, 3);
  if (magic != "n+1" && magic != "ni1") {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": no NIfTI-1 magic at byte 344 (an ANALYZE 7.5 header?): convert it to NIfTI"));
  }
  const auto code = LoadSwapped<std::int16_t>(header.data() + 70, is_swapped);
  const auto* row = std::find_if(kNiftiTypes.begin(), kNiftiTypes.end(),
                                 [&](const NiftiType& known) { return known.code == code; });
  if (row == kNiftiTypes.end()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: NIfTI datatype %d; expected one number a sample, of (u)int8, (u)int16, (u)int32, "
        "float32 or float64 (codes 2, 4, 8, 16, 64, 256, 512, 768): convert the file to one of "
        "them",
        path, code));
  }
  location.stored_type = row->type;
  const auto vox_offset = static_cast<double>(LoadSwapped<float>(header.data() + 108, is_swapped));
  if (!(vox_offset >= 0 && vox_offset < 0x1p53)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: NIfTI vox_offset %g; expected 0 or more", path, vox_offset));
  }
  auto skip = static_cast<std::int64_t>(vox_offset);
  location.path = path;
  if (magic == "n+1") {
    skip = std::max(skip, std::int64_t{kNiftiHeaderBytes});
  } else {
    const std::string stem = path.substr(0, path.rfind('.'));
    location.path = absl::StrCat(stem, ".img");
    if (!io::PathExists(location.path) && io::PathExists(location.path + ".gz")) {
      location.path += ".gz";
    }
    ISOSCOPE_RETURN_IF_ERROR(CheckDataFile(path, location.path));
  }
  location.is_compressed = IsGzipName(location.path);
  (location.is_compressed ? location.decoded_skip : location.offset) = skip;
  const auto slope = static_cast<double>(LoadSwapped<float>(header.data() + 112, is_swapped));
  const auto intercept = static_cast<double>(LoadSwapped<float>(header.data() + 116, is_swapped));
  if (std::isfinite(slope) && std::isfinite(intercept) && slope != 0) {
    location.slope = slope;  // the format: a slope of 0 means that none is set
    location.intercept = intercept;
  }
  return location;
}

// NRRD: http://teem.sourceforge.net/nrrd/format.html.
absl::StatusOr<SampleLocation> LocateNrrd(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string text, ReadTextHeader(path));
  if (!absl::StartsWith(text, "NRRD000")) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": does not start with \"NRRD000\": not an NRRD file, though its name says so"));
  }
  Fields fields(path);
  std::size_t position = 0;
  absl::string_view line;
  bool has_end = false;
  while (NextLine(text, &position, &line)) {
    if (line.empty()) {
      has_end = true;
      break;
    }
    const std::size_t colon = line.find(": ");
    if (line[0] != '#' && colon != absl::string_view::npos) {
      fields.Set(line.substr(0, colon), line.substr(colon + 2));
    }
  }
  const auto either = [&](const char* a, const char* b) {
    return fields.Get(a).empty() ? b : a;  // the format allows both spellings
  };
  SampleLocation location;
  const std::string data_file = fields.Get(either("data file", "datafile"));
  if (data_file.empty()) {
    if (!has_end) {
      return absl::InvalidArgumentError(
          absl::StrCat(path, ": the NRRD header has no empty line at its end: the file is cut"));
    }
    location.path = path;
    location.offset = static_cast<std::int64_t>(position);
  } else {
    if (absl::StartsWith(data_file, "LIST") || absl::StrContains(data_file, "%")) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: data file \"%s\": samples in several files are not supported; join "
                          "them into one (unu save)",
                          path, data_file));
    }
    location.path = BesideHeader(path, data_file);
    ISOSCOPE_RETURN_IF_ERROR(CheckDataFile(path, location.path));
  }
  const std::string encoding = absl::AsciiStrToLower(fields.Get("encoding"));
  if (encoding == "gzip" || encoding == "gz") {
    location.is_compressed = true;
  } else if (encoding != "raw") {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: NRRD encoding \"%s\"; expected raw or gzip: convert it (unu save -e gzip)", path,
        encoding));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t line_skip,
                            fields.GetInteger(either("line skip", "lineskip"), 0));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t byte_skip,
                            fields.GetInteger(either("byte skip", "byteskip"), 0));
  if (line_skip != 0 || byte_skip < -1 || (byte_skip == -1 && location.is_compressed)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: line skip %d, byte skip %d with encoding %s: expected no line skip, and a byte skip "
        "of 0 or more (-1 only with encoding raw)",
        path, line_skip, byte_skip, encoding));
  }
  if (byte_skip == -1) {
    location.at_file_end = true;
  } else {
    (location.is_compressed ? location.decoded_skip : location.offset) += byte_skip;
  }
  location.is_big_endian = absl::EqualsIgnoreCase(fields.Get("endian"), "big");
  return location;
}

// MetaImage: https://itk.org/Wiki/ITK/MetaIO/Documentation.
absl::StatusOr<SampleLocation> LocateMetaImage(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string text, ReadTextHeader(path));
  Fields fields(path);
  std::size_t position = 0;
  absl::string_view line;
  std::string data_file;
  while (data_file.empty() && NextLine(text, &position, &line)) {
    const std::size_t equals = line.find('=');
    if (equals == absl::string_view::npos) {
      break;  // no header line: whatever this is, it is not looked through to its end
    }
    fields.Set(line.substr(0, equals), line.substr(equals + 1));
    data_file = fields.Get("elementdatafile");
  }
  if (data_file.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": no line \"ElementDataFile = ...\": not a MetaImage header, or it is cut"));
  }
  if (fields.Get("ndims").empty() || fields.Get("dimsize").empty() ||
      fields.Get("elementtype").empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": NDims, DimSize or ElementType is missing: not a MetaImage header"));
  }
  SampleLocation location;
  if (absl::EqualsIgnoreCase(data_file, "LOCAL")) {
    location.path = path;
    location.offset = static_cast<std::int64_t>(position);
  } else if (absl::StartsWithIgnoreCase(data_file, "LIST") || absl::StrContains(data_file, "%")) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: ElementDataFile = %s: samples in several files are not supported; "
                        "write the volume into one .mha file",
                        path, data_file));
  } else {
    location.path = BesideHeader(path, data_file);
    ISOSCOPE_RETURN_IF_ERROR(CheckDataFile(path, location.path));
  }
  const auto is_true = [&](const char* key) {
    return absl::StartsWithIgnoreCase(fields.Get(key), "t") || fields.Get(key) == "1";
  };
  if (!fields.Get("binarydata").empty() && !is_true("binarydata")) {
    return absl::InvalidArgumentError(
        absl::StrCat(path,
                     ": BinaryData = False: samples as text are not supported; write the "
                     "volume with binary data"));
  }
  location.is_compressed = is_true("compresseddata");
  location.is_big_endian = is_true("binarydatabyteordermsb") || is_true("elementbyteordermsb");
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t header_size, fields.GetInteger("headersize", 0));
  if (header_size < -1 || (header_size == -1 && location.is_compressed)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: HeaderSize = %d: expected 0 or more, or -1 without compression", path, header_size));
  }
  if (header_size == -1) {
    location.at_file_end = true;
  } else if (header_size > 0) {
    location.offset = header_size;  // counted from the start of the file, LOCAL or not
  }
  return location;
}

}  // namespace

std::string NiftiHeaderPath(const std::string& path) {
  for (const char* suffix : {".img", ".img.gz"}) {
    if (absl::EndsWithIgnoreCase(path, suffix)) {
      return absl::StrCat(path.substr(0, path.size() - std::string(suffix).size()), ".hdr");
    }
  }
  return path;
}

absl::StatusOr<SampleLocation> LocateSamples(FileFormat format, const std::string& path) {
  switch (format) {
    case FileFormat::kNifti:
      return LocateNifti(path);
    case FileFormat::kNrrd:
      return LocateNrrd(path);
    case FileFormat::kMetaImage:
      return LocateMetaImage(path);
  }
  return absl::InternalError("file format out of range");
}

}  // namespace isoscope::source
