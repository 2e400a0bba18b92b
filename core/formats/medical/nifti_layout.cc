// NIfTI is a header in front of the samples (one file .nii), or beside them (a pair .hdr and .img);
// either may be a gzip stream. Its numbers have the byte order of the machine that wrote it: the
// first one, 348 or 540, shows which. NIfTI-2 is NIfTI-1 with wider numbers in another order:
//
//   NIfTI-1           NIfTI-2
//   byte   0 int32      0 int32   348; 540
//   byte 344 char[4]    4 char[8] "n+1" or "n+2"; of a pair "ni1" or "ni2"
//   byte  40 int16     16 int64   [8]: number of axes, x, y, z, t, components, two more
//   byte  70 int16     12 int16   type of the samples (kNiftiTypes)
//   byte  76 float    104 double  [8]: sign of z in the qform (qfac), distances along the axes
//   byte 108 float    168 int64   vox_offset: bytes before the samples, 352 or 544 at least in .nii
//   byte 112 float    176 double  slope, intercept; a slope of 0 (or NaN) means that none is set
//   byte 123 uint8    500 int32   units, of space in bits 0 to 2, of time in bits 3 to 5
//   byte 136 float    216 double  toffset: the time of the first step
//   byte 252 int16    344 int32   qform_code; above 0 the quaternion holds
//   byte 254 int16    348 int32   sform_code; above 0 the affine transform holds
//   byte 256 float    352 double  quaternion b, c, d, and its offset x, y, z
//   byte 280 float    400 double  [3][4], rows of the sform
//
// The samples of all steps of the first component come first.
//
// Source: https://nifti.nimh.nih.gov/nifti-1, nifti1.h; https://nifti.nimh.nih.gov/nifti-2,
// nifti2.h.

#include "core/formats/medical/nifti_layout.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/formats/medical/layout_formats.h"
#include "core/source/adapt/wide_source.h"
#include "core/source/bytes/binary_header.h"
#include "core/source/bytes/file_start.h"
#include "core/source/bytes/sample_location.h"
#include "core/source/grid/affine_grid.h"
#include "core/source/grid/sample_distance.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kNifti1HeaderBytes = 348;
constexpr std::size_t kNifti2HeaderBytes = 540;

// The numbers of a header of either version.
class NiftiNumbers {
 public:
  NiftiNumbers(std::string bytes, bool is_big_endian, bool is_second)
      : header_(std::move(bytes), is_big_endian), is_second_(is_second) {}

  [[nodiscard]] const char* name() const { return is_second_ ? "NIfTI-2" : "NIfTI-1"; }
  [[nodiscard]] bool is_big_endian() const { return header_.is_big_endian(); }
  [[nodiscard]] std::int64_t header_bytes() const {
    return static_cast<std::int64_t>(is_second_ ? kNifti2HeaderBytes : kNifti1HeaderBytes);
  }
  [[nodiscard]] std::int16_t datatype() const {
    return header_.Load<std::int16_t>(is_second_ ? 12 : 70);
  }
  // Number 0 counts the axes.
  [[nodiscard]] std::int64_t Size(std::size_t number) const {
    return is_second_ ? header_.Load<std::int64_t>(16 + 8 * number)
                      : header_.Load<std::int16_t>(40 + 2 * number);
  }
  // Number 0 has the sign of z in the qform.
  [[nodiscard]] double Distance(std::size_t number) const { return Real(76, 104, number); }
  [[nodiscard]] double skip() const {
    return is_second_ ? static_cast<double>(header_.Load<std::int64_t>(168))
                      : static_cast<double>(header_.Load<float>(108));
  }
  // The least vox_offset of a single file: the header, and four bytes that tell of extensions.
  [[nodiscard]] std::int64_t least_skip() const { return header_bytes() + 4; }
  [[nodiscard]] double slope() const { return Real(112, 176, 0); }
  [[nodiscard]] double intercept() const { return Real(112, 176, 1); }
  [[nodiscard]] std::int32_t units() const {
    return is_second_ ? header_.Load<std::int32_t>(500) : header_.Load<std::uint8_t>(123);
  }
  // The time of the first step.
  [[nodiscard]] double first_time() const { return Real(136, 216, 0); }
  [[nodiscard]] bool has_qform() const { return Code(252, 344) > 0; }
  [[nodiscard]] bool has_sform() const { return Code(254, 348) > 0; }
  // Returns number 0 to 5 of the qform: b, c, d, and the offset x, y, z.
  [[nodiscard]] double Quaternion(std::size_t number) const { return Real(256, 352, number); }
  [[nodiscard]] AffineRows Sform() const {
    AffineRows rows;
    for (std::size_t i = 0; i < 12; ++i) {
      rows[i / 4][i % 4] = Real(280, 400, i);
    }
    return rows;
  }
  // The byte of a number of the sform.
  [[nodiscard]] std::size_t SformByte(std::size_t number) const {
    return is_second_ ? 400 + 8 * number : 280 + 4 * number;
  }
  [[nodiscard]] bool is_pair() const {
    return header_.bytes().substr(is_second_ ? 4 : 344, 3) == (is_second_ ? "ni2" : "ni1");
  }

 private:
  // A row of numbers that begins at these bytes in the two versions.
  [[nodiscard]] double Real(std::size_t first, std::size_t second, std::size_t number) const {
    return is_second_ ? header_.Load<double>(second + 8 * number)
                      : static_cast<double>(header_.Load<float>(first + 4 * number));
  }
  [[nodiscard]] std::int32_t Code(std::size_t first, std::size_t second) const {
    return is_second_ ? header_.Load<std::int32_t>(second) : header_.Load<std::int16_t>(first);
  }

  const BinaryHeader header_;
  const bool is_second_;
};

// The distance of samples along an axis, from 0 on. 1 in place of one that is none, which becomes
// the error of the layout.
double NiftiDistance(const NiftiNumbers& header, std::size_t axis, const std::string& path,
                     FileLayout* layout) {
  const double distance = header.Distance(axis + 1);
  const absl::Status good = CheckSampleDistance(
      path, absl::StrFormat("pixdim[%d] of the %s header", axis + 1, header.name()), distance);
  layout->faults.distances.Update(good);
  return good.ok() ? distance : 1;
}

AffineRows QformOf(const NiftiNumbers& header, const std::string& path, FileLayout* layout) {
  double b = header.Quaternion(0);
  double c = header.Quaternion(1);
  double d = header.Quaternion(2);
  double a = 1 - (b * b + c * c + d * d);
  // The sum of squares is 1 at most, but the numbers are rounded.
  constexpr double kMaxExcess = 1e-3;
  if (!(a >= -kMaxExcess) || std::isnan(header.Distance(0))) {
    layout->faults.directions.Update(NoDirections(
        path,
        absl::StrFormat("the %s header has the quaternion %g, %g, %g and qfac (pixdim[0]) %g, "
                        "which is no rotation, whose squares sum up to 1 at most, and -1 or 1",
                        header.name(), b, c, d, header.Distance(0))));
    b = c = d = 0;
    a = 1;
  }
  if (a < 1e-7) {
    const double scale = 1 / std::sqrt(b * b + c * c + d * d);
    b *= scale;
    c *= scale;
    d *= scale;
    a = 0;
  } else {
    a = std::sqrt(a);
  }
  const double flip = header.Distance(0) < 0 ? -1 : 1;  // 0 means 1
  AffineRows rows{{{a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c), 0},
                   {2 * (b * c + a * d), a * a + c * c - b * b - d * d, 2 * (c * d - a * b), 0},
                   {2 * (b * d - a * c), 2 * (c * d + a * b), a * a + d * d - c * c - b * b, 0}}};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double distance = NiftiDistance(header, axis, path, layout);
    for (std::array<double, 4>& row : rows) {
      row[axis] *= distance * (axis == 2 ? flip : 1);
    }
  }
  for (std::size_t r = 0; r < 3; ++r) {
    rows[r][3] = header.Quaternion(3 + r);
  }
  return rows;
}

// Returns true if the sform has an axis without a length, as one that is set by its code only.
bool IsFlat(const AffineRows& rows) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (rows[0][axis] == 0 && rows[1][axis] == 0 && rows[2][axis] == 0) {
      return true;
    }
  }
  return false;
}

// The transform of indices to RAS, in the file's unit of length.
AffineRows TransformOf(const NiftiNumbers& header, const std::string& path, FileLayout* layout) {
  const bool is_odd =
      header.has_sform() && (IsFlat(header.Sform()) || FindShear(header.Sform()).has_value());
  if (header.has_sform() && (!is_odd || !header.has_qform())) {
    return header.Sform();
  }
  if (header.has_qform()) {
    return QformOf(header, path, layout);
  }
  AffineRows rows{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    rows[axis][axis] = NiftiDistance(header, axis, path, layout);
  }
  return rows;
}

// Refuses numbers that were meant as others, as those of the other byte order. A NaN or an infinite
// number becomes a fault of the layout.
absl::Status CheckSform(const NiftiNumbers& header, const std::string& path) {
  constexpr double kMaxElement = 1e12;
  const AffineRows rows = header.Sform();
  for (std::size_t i = 0; i < 12 && header.has_sform(); ++i) {
    const double element = rows[i / 4][i % 4];
    if (std::isfinite(element) && std::abs(element) > kMaxElement) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: the transform of the %s header (sform) has %g at byte %d; expected a number of "
          "millimetres: the file is damaged",
          path, header.name(), element, header.SformByte(i)));
    }
  }
  return absl::OkStatus();
}

// Millimetres of the file's unit of length: metres, millimetres, micrometres.
double MillimetresOf(std::int32_t units) {
  switch (units & 7) {
    case 1:
      return 1000;
    case 3:
      return 0.001;
    default:
      return 1;
  }
}

// The times of several steps: numbers without a unit where the header has no interval above 0.
absl::Status SetNiftiTimes(const NiftiNumbers& header, const std::string& path,
                           FileLayout* layout) {
  const double interval = header.Distance(4);
  if (layout->steps == 1 || !std::isfinite(interval) || interval <= 0) {
    return absl::OkStatus();
  }
  layout->interval = interval;
  layout->time_unit = NiftiTimeUnit(static_cast<std::uint8_t>(header.units() & 0xff));
  layout->first_time = header.first_time();
  if (!std::isfinite(layout->first_time)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: toffset of the %s header is %g; expected the time of the first step, a finite number",
        path, header.name(), layout->first_time));
  }
  return absl::OkStatus();
}

absl::Status SetNiftiAxes(const NiftiNumbers& header, const std::string& path, FileLayout* layout) {
  constexpr std::int64_t kMaxVolumes = std::int64_t{1} << 31;
  const std::int64_t axes = header.Size(0);
  std::array<std::int64_t, 7> dims{1, 1, 1, 1, 1, 1, 1};
  if (axes < 1 || axes > 7) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: %d axes in the %s header; expected 1 to 7", path, axes, header.name()));
  }
  for (std::size_t axis = 0; axis < static_cast<std::size_t>(axes); ++axis) {
    dims[axis] = header.Size(axis + 1);
  }
  if (axes < 3) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: %d-dimensional, %s samples; expected one three-dimensional volume, of 2 samples or "
        "more along each of three axes",
        path, axes, absl::StrJoin(dims.begin(), dims.begin() + axes, " x ")));
  }
  if (*std::min_element(dims.begin(), dims.end()) < 1 || dims[5] != 1 || dims[6] != 1 ||
      dims[3] > kMaxVolumes || dims[4] > kMaxVolumes) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %s samples in the %s header; expected x, y, z, time and components",
                        path, absl::StrJoin(dims, " x "), header.name()));
  }
  layout->steps = dims[3];
  layout->components = dims[4];
  layout->location.volume_count = dims[3] * dims[4];
  ISOSCOPE_RETURN_IF_ERROR(CheckSform(header, path));
  AffineRows rows = TransformOf(header, path, layout);
  for (std::array<double, 4>& row : rows) {
    for (double& number : row) {
      number *= MillimetresOf(header.units());
    }
  }
  ISOSCOPE_ASSIGN_OR_RETURN(
      layout->geometry,
      GridFromAffine({dims[0], dims[1], dims[2]}, rows, PatientWorld::kRas, path, &layout->faults));
  layout->shear = FindShear(rows);
  if (header.has_qform() || header.has_sform()) {
    layout->patient_frame.emplace();
  }
  const std::int32_t length_unit = header.units() & 7;
  layout->length_unit = length_unit >= 1 && length_unit <= 3 ? "mm" : "";
  return SetNiftiTimes(header, path, layout);
}

std::optional<WideType> WideTypeOf(std::int16_t datatype) {
  return datatype == 1024   ? std::optional(WideType::kInt64)
         : datatype == 1280 ? std::optional(WideType::kUint64)
                            : std::nullopt;
}

absl::StatusOr<NiftiNumbers> ReadNiftiNumbers(const std::string& path, bool* is_gzip) {
  ISOSCOPE_ASSIGN_OR_RETURN(const FileStart head, ReadFileStart(path, kNifti2HeaderBytes));
  const bool is_second = IsNifti2Header(head.bytes);
  const std::size_t header_bytes = is_second ? kNifti2HeaderBytes : kNifti1HeaderBytes;
  if (head.bytes.size() < header_bytes) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: the NIfTI header has %d bytes, expected %d: the file is cut", path,
                        head.bytes.size(), header_bytes));
  }
  if (IsAnalyzeHeader(head.bytes)) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": no NIfTI-1 magic at byte 344 (an ANALYZE 7.5 header?): convert it to NIfTI"));
  }
  if (!is_second && !IsNifti1Header(head.bytes)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: the header starts with %d, expected 348, or 540 and the mark of NIfTI-2: not a NIfTI "
        "file",
        path, base::LoadLittleEndian<std::int32_t>(head.bytes.data())));
  }
  *is_gzip = head.is_gzip;
  return NiftiNumbers(
      head.bytes, BeginsBigEndian(head.bytes, static_cast<std::uint32_t>(header_bytes)), is_second);
}

// Bytes before the samples. In a single file they lie behind the header; 0 says no more than that.
absl::StatusOr<std::int64_t> NiftiSkip(const NiftiNumbers& header, const std::string& path) {
  const double skip = header.skip();
  if (!(skip >= 0 && skip < 0x1p53)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %s vox_offset %g; expected 0 or more", path, header.name(), skip));
  }
  const auto bytes = static_cast<std::int64_t>(skip);
  if (header.is_pair() || bytes >= header.least_skip()) {
    return bytes;
  }
  if (skip > 0) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: %s vox_offset %g, which is within the header; expected %d bytes or more before the "
        "samples of a single file, or 0 for %d",
        path, header.name(), skip, header.least_skip(), header.least_skip()));
  }
  return header.least_skip();
}

}  // namespace

absl::StatusOr<FileLayout> ReadNiftiHeaderLayout(const std::string& path) {
  bool is_gzip = false;
  ISOSCOPE_ASSIGN_OR_RETURN(const NiftiNumbers header, ReadNiftiNumbers(path, &is_gzip));
  FileLayout layout;
  ISOSCOPE_RETURN_IF_ERROR(SetNiftiAxes(header, path, &layout));
  SampleLocation& location = layout.location;
  location.is_big_endian = header.is_big_endian();
  layout.wide = WideTypeOf(header.datatype());
  if (layout.wide.has_value()) {
    location.stored_type = CarrierType(*layout.wide);
  } else {
    ISOSCOPE_ASSIGN_OR_RETURN(location.stored_type, NiftiSampleType(header.datatype(), path));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t skip, NiftiSkip(header, path));
  if (header.is_pair()) {
    ISOSCOPE_ASSIGN_OR_RETURN(location.files, NiftiImageOfPair(path));
    is_gzip = IsNiftiStream(path, location.files.front());
  } else {
    location.files = {path};
  }
  location.encoding = is_gzip ? SampleEncoding::kDeflate : SampleEncoding::kRaw;
  (location.is_encoded() ? location.decoded_skip : location.offset) = skip;
  ISOSCOPE_RETURN_IF_ERROR(
      SetNiftiScale(header.slope(), header.intercept(), header.name(), path, &location));
  if (layout.wide.has_value() && (location.slope != 1 || location.intercept != 0)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: 64-bit integers with slope %g and intercept %g; expected slope 1 and intercept 0: "
        "convert the file to float64",
        path, location.slope, location.intercept));
  }
  return layout;
}

}  // namespace isoscope::source
