// NIfTI-1 is a header of 348 bytes in front of the samples ("n+1", one file .nii), or beside them
// ("ni1", a pair .hdr and .img); either may be a gzip stream. Its numbers have the byte order of
// the machine that wrote it: the first one, 348, shows which. These fields describe where the
// samples lie:
//
//   byte   0  int32   348
//   byte  40  int16   [8]: number of axes, x, y, z, t, components, two more
//   byte  70  int16   type of the samples (kNiftiTypes)
//   byte  76  float   [8]: distances of samples along the axes, from number 1 on
//   byte 108  float   vox_offset: bytes before the samples, 352 in most files .nii
//   byte 112  float   slope, intercept; a slope of 0 means that none is set
//   byte 123  uint8   units, of space in bits 0 to 2, of time in bits 3 to 5
//   byte 252  int16   qform_code; above 0 the quaternion behind it holds
//   byte 254  int16   sform_code; above 0 the affine transform at byte 280 holds
//   byte 280  float   [3][4], rows of that transform
//   byte 344  char[4] "n+1" or "ni1"
//
// Source: https://nifti.nimh.nih.gov/nifti-1, nifti1.h.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/formats/medical/nifti_layout.h"
#include "core/formats/medical/sample_format.h"
#include "core/io/file.h"
#include "core/source/bytes/data_files.h"
#include "core/source/bytes/file_start.h"
#include "core/source/bytes/sample_location.h"
#include "core/source/grid/affine_grid.h"

namespace isoscope::source {
namespace {

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

struct NiftiHeader {
  std::array<char, kNiftiHeaderBytes> bytes{};
  bool is_big_endian = false;

  template <typename T>
  [[nodiscard]] T Load(std::size_t offset) const {
    std::array<char, sizeof(T)> value;
    std::copy_n(bytes.data() + offset, sizeof(T), value.begin());
    if (is_big_endian) {
      std::reverse(value.begin(), value.end());
    }
    return base::LoadLittleEndian<T>(value.data());
  }
  // "n+1" or "ni1".
  [[nodiscard]] std::string magic() const { return {bytes.data() + 344, 3}; }
};

bool IsGzipName(const std::string& path) { return absl::EndsWithIgnoreCase(path, ".gz"); }

absl::StatusOr<NiftiHeader> ReadNiftiHeader(const std::string& path) {
  NiftiHeader header;
  ISOSCOPE_ASSIGN_OR_RETURN(const FileStart start, ReadFileStart(path, header.bytes.size()));
  if (start.bytes.size() < header.bytes.size()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: the NIfTI header has %d bytes, expected %d: the file is cut", path,
                        start.bytes.size(), header.bytes.size()));
  }
  std::copy_n(start.bytes.data(), header.bytes.size(), header.bytes.data());
  const auto first = header.Load<std::int32_t>(0);
  header.is_big_endian = true;
  if (header.Load<std::int32_t>(0) != std::int32_t{kNiftiHeaderBytes}) {
    header.is_big_endian = false;
    if (first != std::int32_t{kNiftiHeaderBytes}) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: the header starts with %d, expected 348: not a NIfTI file", path, first));
    }
  }
  if (header.magic() != "n+1" && header.magic() != "ni1") {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": no NIfTI-1 magic at byte 344 (an ANALYZE 7.5 header?): convert it to NIfTI"));
  }
  return header;
}

// " (complex)"; "" for codes that NIfTI does not have.
const char* NameOfOtherType(std::int16_t code) {
  switch (code) {
    case 1:
      return " (single bits)";
    case 32:
    case 1792:
    case 2048:
      return " (complex)";
    case 128:
    case 2304:
      return " (RGB colours)";
    case 1536:
      return " (float128)";
    default:
      return "";
  }
}

}  // namespace

absl::StatusOr<volume::ScalarType> NiftiSampleType(std::int16_t code, const std::string& path) {
  const auto* row = std::find_if(kNiftiTypes.begin(), kNiftiTypes.end(),
                                 [&](const NiftiType& known) { return known.code == code; });
  if (row == kNiftiTypes.end()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: NIfTI datatype %d%s; expected one number a sample, an integer of 8 to 64 bits, "
        "float32 or float64 (codes 2, 4, 8, 16, 64, 256, 512, 768, 1024, 1280): convert the file "
        "to one of them",
        path, code, NameOfOtherType(code)));
  }
  return row->type;
}

namespace {

// ITK takes the qform in place of a sheared sform. Without one it refuses the file.
absl::Status CheckShear(const NiftiHeader& header, const std::string& path) {
  AffineRows rows;
  for (std::size_t i = 0; i < 12; ++i) {
    rows[i / 4][i % 4] = static_cast<double>(header.Load<float>(280 + 4 * i));
  }
  const std::optional<Shear> shear = FindShear(rows);
  return shear.has_value() && header.Load<std::int16_t>(252) <= 0 ? ShearError(*shear, path)
                                                                  : absl::OkStatus();
}

// ITK ends the process where the transform is not finite, or overflows as it is inverted.
absl::Status CheckTransform(const NiftiHeader& header, const std::string& path) {
  if (header.Load<std::int16_t>(254) <= 0) {
    return absl::OkStatus();
  }
  constexpr float kMaxElement = 1e12F;
  for (std::size_t offset = 280; offset < 328; offset += sizeof(float)) {
    const auto element = header.Load<float>(offset);
    if (!std::isfinite(element)) {
      ISOSCOPE_RETURN_IF_ERROR(ReadNiftiGrid(path).status());  // says which flags give it
    }
    if (!(std::abs(element) <= kMaxElement)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: the transform of the NIfTI header (sform) has %g at byte %d; expected a number of "
          "millimetres: the file is damaged",
          path, element, offset));
    }
  }
  return CheckShear(header, path);
}

}  // namespace

absl::StatusOr<std::vector<std::string>> NiftiImageOfPair(const std::string& header_path) {
  const std::size_t slash = header_path.rfind('/');
  std::string name = header_path.substr(slash == std::string::npos ? 0 : slash + 1);
  if (IsGzipName(name)) {
    name.resize(name.size() - 3);
  }
  const std::string image = absl::StrCat(name.substr(0, name.rfind('.')), ".img");
  auto plain = SingleFile(header_path, image);
  auto packed = plain.ok() ? plain : SingleFile(header_path, image + ".gz");
  return packed.ok() ? packed : plain;
}

absl::Status SetNiftiScale(double slope, double intercept, const char* format,
                           const std::string& path, SampleLocation* location) {
  if (slope == 0 || std::isnan(slope)) {
    return absl::OkStatus();
  }
  if (!std::isfinite(slope) || !std::isfinite(intercept)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: the %s header scales samples by %g and adds %g; expected finite numbers, or a slope "
        "of 0 for none: the file is damaged",
        path, format, slope, intercept));
  }
  location->slope = slope;
  location->intercept = intercept;
  return absl::OkStatus();
}

bool IsNiftiStream(const std::string& header_path, const std::string& file) {
  return (file == header_path || IsGzipName(file)) && IsGzipFile(file);
}

const char* NiftiTimeUnit(std::uint8_t units) {
  switch (units & 0x38) {
    case 8:
      return "s";
    case 16:
      return "ms";
    case 24:
      return "us";
    default:
      return "";
  }
}

absl::StatusOr<NiftiLayout> ReadNiftiLayout(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const NiftiHeader header, ReadNiftiHeader(path));
  const auto axes = header.Load<std::int16_t>(40);
  std::array<std::int64_t, 7> dims{1, 1, 1, 1, 1, 1, 1};
  if (axes < 1 || axes > 7) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d axes in the NIfTI header; expected 1 to 7", path, axes));
  }
  for (std::size_t axis = 0; axis < static_cast<std::size_t>(axes); ++axis) {
    dims[axis] = header.Load<std::int16_t>(42 + 2 * axis);
  }
  if (*std::min_element(dims.begin(), dims.end()) < 1 || dims[5] != 1 || dims[6] != 1) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %s samples in the NIfTI header; expected x, y, z, time and components",
                        path, absl::StrJoin(dims, " x ")));
  }
  const auto units = header.Load<std::uint8_t>(123);
  NiftiLayout layout{.steps = dims[3],
                     .components = dims[4],
                     .time_unit = NiftiTimeUnit(units),
                     .length_unit = (units & 7) >= 1 && (units & 7) <= 3 ? "mm" : ""};
  const auto interval = static_cast<double>(header.Load<float>(76 + 4 * 4));
  if (std::isfinite(interval) && interval > 0) {
    layout.interval = interval;
  } else {
    layout.time_unit = "";
  }
  return layout;
}

std::string NiftiHeaderPath(const std::string& path) {
  for (const char* suffix : {".img", ".img.gz"}) {
    if (absl::EndsWithIgnoreCase(path, suffix)) {
      std::string header =
          absl::StrCat(path.substr(0, path.size() - std::string(suffix).size()), ".hdr");
      const std::string packed = header + ".gz";
      return !io::PathExists(header) && io::PathExists(packed) ? packed : header;
    }
  }
  return path;
}

absl::StatusOr<SampleLocation> LocateNiftiSamples(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const NiftiHeader header, ReadNiftiHeader(path));
  SampleLocation location;
  location.is_big_endian = header.is_big_endian;
  ISOSCOPE_ASSIGN_OR_RETURN(location.stored_type,
                            NiftiSampleType(header.Load<std::int16_t>(70), path));
  ISOSCOPE_RETURN_IF_ERROR(CheckTransform(header, path));
  const auto vox_offset = static_cast<double>(header.Load<float>(108));
  if (!(vox_offset >= 0 && vox_offset < 0x1p53)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: NIfTI vox_offset %g; expected 0 or more", path, vox_offset));
  }
  auto skip = static_cast<std::int64_t>(vox_offset);
  if (header.magic() == "n+1") {
    location.files = {path};
    skip = std::max(skip, std::int64_t{kNiftiHeaderBytes});
  } else {
    ISOSCOPE_ASSIGN_OR_RETURN(location.files, NiftiImageOfPair(path));
  }
  location.encoding =
      IsNiftiStream(path, location.files.front()) ? SampleEncoding::kDeflate : SampleEncoding::kRaw;
  (location.is_encoded() ? location.decoded_skip : location.offset) = skip;
  ISOSCOPE_RETURN_IF_ERROR(SetNiftiScale(static_cast<double>(header.Load<float>(112)),
                                         static_cast<double>(header.Load<float>(116)), "NIfTI-1",
                                         path, &location));
  return location;
}

}  // namespace isoscope::source
