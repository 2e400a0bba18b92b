// NIfTI-2 is NIfTI-1 with wider numbers in another order: a header of 540 bytes in front of the
// samples ("n+2", .nii), or beside them ("ni2", a pair .hdr and .img). The first number, 540, shows
// the byte order:
//
//   byte   0  int32      540
//   byte   4  char[8]    "n+2" or "ni2", and bytes that a transfer as text changes
//   byte  12  int16      type of the samples
//   byte  16  int64[8]   number of axes, x, y, z, t, components, two more
//   byte 104  double[8]  sign of z in the qform, distances of samples along the axes
//   byte 168  int64      bytes before the samples
//   byte 176  double     slope, intercept; a slope of 0 means that none is set
//   byte 344  int32      qform_code, sform_code; 0: the transform is not set
//   byte 352  double     quaternion b, c, d, and its offset x, y, z
//   byte 400  double[12] rows of the sform
//   byte 500  int32      units, of space in bits 0 to 2, of time in bits 3 to 5
//
// Source: https://nifti.nimh.nih.gov/nifti-2, nifti2.h; the transforms as in nifti1.h.

#include <algorithm>
#include <array>
#include <cmath>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/status_macros.h"
#include "core/source/affine_grid.h"
#include "core/source/binary_header.h"
#include "core/source/layout_formats.h"
#include "core/source/nifti_layout.h"
#include "core/source/sample_location.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kNifti2HeaderBytes = 540;

AffineRows SformOf(const BinaryHeader& header) {
  AffineRows rows;
  for (std::size_t i = 0; i < 12; ++i) {
    rows[i / 4][i % 4] = header.Load<double>(400 + 8 * i);
  }
  return rows;
}

AffineRows QformOf(const BinaryHeader& header) {
  double b = header.Load<double>(352);
  double c = header.Load<double>(360);
  double d = header.Load<double>(368);
  double a = 1 - (b * b + c * c + d * d);
  if (a < 1e-7) {
    const double scale = 1 / std::sqrt(b * b + c * c + d * d);
    b *= scale;
    c *= scale;
    d *= scale;
    a = 0;
  } else {
    a = std::sqrt(a);
  }
  const double flip = header.Load<double>(104) < 0 ? -1 : 1;
  const AffineRows rotation{
      {{a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c), 0},
       {2 * (b * c + a * d), a * a + c * c - b * b - d * d, 2 * (c * d - a * b), 0},
       {2 * (b * d - a * c), 2 * (c * d + a * b), a * a + d * d - c * c - b * b, 0}}};
  AffineRows rows = rotation;
  for (std::size_t r = 0; r < 3; ++r) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double distance = header.Load<double>(112 + 8 * axis);
      rows[r][axis] *= (distance > 0 ? distance : 1) * (axis == 2 ? flip : 1);
    }
    rows[r][3] = header.Load<double>(376 + 8 * r);
  }
  return rows;
}

// The transform of indices to RAS, in the file's unit of length.
absl::StatusOr<AffineRows> TransformOf(const BinaryHeader& header, const std::string& path,
                                       bool* is_set) {
  const bool has_qform = header.Load<std::int32_t>(344) > 0;
  const bool has_sform = header.Load<std::int32_t>(348) > 0;
  *is_set = has_qform || has_sform;
  const std::optional<Shear> shear = has_sform ? FindShear(SformOf(header)) : std::nullopt;
  if (shear.has_value() && !has_qform) {
    return ShearError(*shear, path);
  }
  if (has_sform && !shear.has_value()) {
    return SformOf(header);
  }
  if (has_qform) {
    return QformOf(header);
  }
  AffineRows rows{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double distance = header.Load<double>(112 + 8 * axis);
    rows[axis][axis] = distance > 0 ? distance : 1;
  }
  return rows;
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

absl::Status SetNifti2Axes(const BinaryHeader& header, const std::string& path,
                           FileLayout* layout) {
  constexpr std::int64_t kMaxVolumes = std::int64_t{1} << 31;
  const auto axes = header.Load<std::int64_t>(16);
  std::array<std::int64_t, 7> dims{1, 1, 1, 1, 1, 1, 1};
  if (axes < 1 || axes > 7) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d axes in the NIfTI-2 header; expected 1 to 7", path, axes));
  }
  for (std::size_t axis = 0; axis < static_cast<std::size_t>(axes); ++axis) {
    dims[axis] = header.Load<std::int64_t>(24 + 8 * axis);
  }
  if (*std::min_element(dims.begin(), dims.end()) < 1 || dims[5] != 1 || dims[6] != 1 ||
      dims[3] > kMaxVolumes || dims[4] > kMaxVolumes) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: %s samples in the NIfTI-2 header; expected x, y, z, time and components", path,
        absl::StrJoin(dims, " x ")));
  }
  layout->steps = dims[3];
  layout->components = dims[4];
  layout->location.volume_count = dims[3] * dims[4];
  bool is_set = false;
  ISOSCOPE_ASSIGN_OR_RETURN(AffineRows rows, TransformOf(header, path, &is_set));
  const auto units = header.Load<std::int32_t>(500);
  for (std::array<double, 4>& row : rows) {
    for (double& number : row) {
      number *= MillimetresOf(units);
    }
  }
  ISOSCOPE_ASSIGN_OR_RETURN(layout->geometry, GridFromAffine({dims[0], dims[1], dims[2]}, rows,
                                                             PatientWorld::kRas, path));
  if (is_set) {
    layout->patient_frame.emplace();
  }
  layout->length_unit = (units & 7) >= 1 && (units & 7) <= 3 ? "mm" : "";
  const auto interval = header.Load<double>(136);
  if (std::isfinite(interval) && interval > 0) {
    layout->interval = interval;
    layout->time_unit = NiftiTimeUnit(static_cast<std::uint8_t>(units & 0xff));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<FileLayout> ReadNifti2Layout(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const FileHead head, ReadFileHead(path, kNifti2HeaderBytes));
  if (head.bytes.size() < kNifti2HeaderBytes) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: the NIfTI-2 header has %d bytes, expected %d: the file is cut", path,
                        head.bytes.size(), kNifti2HeaderBytes));
  }
  constexpr std::int32_t kSize = kNifti2HeaderBytes;
  const BinaryHeader header(head.bytes,
                            BinaryHeader(head.bytes, true).Load<std::int32_t>(0) == kSize);
  FileLayout layout;
  ISOSCOPE_RETURN_IF_ERROR(SetNifti2Axes(header, path, &layout));
  SampleLocation& location = layout.location;
  location.is_big_endian = header.is_big_endian();
  ISOSCOPE_ASSIGN_OR_RETURN(location.stored_type,
                            NiftiSampleType(header.Load<std::int16_t>(12), path));
  auto skip = header.Load<std::int64_t>(168);
  if (skip < 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: NIfTI-2 vox_offset %d; expected 0 or more", path, skip));
  }
  if (absl::StartsWith(absl::string_view(head.bytes).substr(4), "n+2")) {
    location.files = {path};
    location.encoding = head.encoding;
    skip = std::max(skip, std::int64_t{kNifti2HeaderBytes});
  } else {
    ISOSCOPE_ASSIGN_OR_RETURN(location.files, NiftiImageOfPair(path));
    location.encoding = absl::EndsWithIgnoreCase(location.files.front(), ".gz")
                            ? SampleEncoding::kDeflate
                            : SampleEncoding::kRaw;
  }
  (location.is_encoded() ? location.decoded_skip : location.offset) = skip;
  const auto slope = header.Load<double>(176);
  const auto intercept = header.Load<double>(184);
  if (std::isfinite(slope) && std::isfinite(intercept) && slope != 0) {
    location.slope = slope;
    location.intercept = intercept;
  }
  return layout;
}

}  // namespace isoscope::source
