// Analyze 7.5 is a header of 348 bytes, .hdr, beside the samples, .img; either may be a gzip stream
// of .hdr.gz or .img.gz. Its first number, 348, shows the byte order:
//
//   byte   0  int32     348
//   byte  40  int16[8]  number of axes, x, y, z, t
//   byte  70  int16     type of the samples (kAnalyzeTypes)
//   byte  76  float[8]  distances of samples along the axes, from number 1 on
//   byte 108  float     bytes before the samples
//   byte 112  float     SPM: factor of the samples, 0 or NaN if there is none
//
// NIfTI-1 is the same with a magic at byte 344. Source: the header dbh.h of the Mayo Foundation,
// and nibabel's analyze.py and spm99analyze.py.

#include <array>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/formats/medical/layout_formats.h"
#include "core/formats/medical/nifti_layout.h"
#include "core/source/bytes/binary_header.h"
#include "core/source/bytes/file_start.h"
#include "core/source/grid/sample_distance.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kAnalyzeHeaderBytes = 348;

struct AnalyzeType {
  std::int16_t code;
  volume::ScalarType type;
};
// The codes from 130 on are SPM's.
constexpr std::array<AnalyzeType, 8> kAnalyzeTypes{{{2, volume::ScalarType::kUint8},
                                                    {4, volume::ScalarType::kInt16},
                                                    {8, volume::ScalarType::kInt32},
                                                    {16, volume::ScalarType::kFloat32},
                                                    {64, volume::ScalarType::kFloat64},
                                                    {130, volume::ScalarType::kInt8},
                                                    {132, volume::ScalarType::kUint16},
                                                    {136, volume::ScalarType::kUint32}}};

absl::StatusOr<volume::ScalarType> AnalyzeTypeOf(std::int16_t code, const std::string& path) {
  for (const AnalyzeType& known : kAnalyzeTypes) {
    if (known.code == code) {
      return known.type;
    }
  }
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: Analyze datatype %d; expected one number a sample, of uint8, int16, int32, float32 or "
      "float64 (codes 2, 4, 8, 16, 64; of SPM 130, 132, 136): convert the file",
      path, code));
}

absl::Status SetAnalyzeGrid(const BinaryHeader& header, const std::string& path,
                            FileLayout* layout) {
  const auto axes = header.Load<std::int16_t>(40);
  if (axes < 3 || axes > 7) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d axes in the Analyze header; expected 3 or 4", path, axes));
  }
  std::array<std::int64_t, 7> dims{1, 1, 1, 1, 1, 1, 1};
  for (std::size_t axis = 0; axis < static_cast<std::size_t>(axes); ++axis) {
    dims[axis] = header.Load<std::int16_t>(42 + 2 * axis);
  }
  for (std::size_t axis = 0; axis < dims.size(); ++axis) {
    // Writers leave 0 behind the third axis.
    if (dims[axis] < (axis < 3 ? 1 : 0) || (axis > 3 && dims[axis] > 1)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: %d samples on axis %d of the Analyze header; expected x, y, z and time", path,
          dims[axis], axis + 1));
    }
  }
  layout->steps = std::max<std::int64_t>(dims[3], 1);
  volume::GridGeometry& geometry = layout->geometry;
  geometry.sample_dims = {dims[0], dims[1], dims[2]};
  for (int axis = 0; axis < 3; ++axis) {
    // Some programs take 0 for 1, and a negative one for a flipped axis: the format says neither.
    const auto distance =
        static_cast<double>(header.Load<float>(80 + 4 * static_cast<std::size_t>(axis)));
    const absl::Status good = CheckSampleDistance(
        path, absl::StrFormat("pixdim[%d] of the Analyze header", axis + 1), distance);
    layout->faults.distances.Update(good);
    geometry.spacing[axis] = good.ok() ? distance : 1;
  }
  const absl::Status valid = volume::Validate(geometry);
  return valid.ok() ? valid : absl::Status(valid.code(), absl::StrCat(path, ": ", valid.message()));
}

}  // namespace

absl::StatusOr<FileLayout> ReadAnalyzeLayout(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const FileStart head, ReadFileStart(path, kAnalyzeHeaderBytes));
  if (head.bytes.size() < kAnalyzeHeaderBytes) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: the Analyze header has %d bytes, expected %d: the file is cut", path,
                        head.bytes.size(), kAnalyzeHeaderBytes));
  }
  const BinaryHeader header(head.bytes, BeginsBigEndian(head.bytes, kAnalyzeHeaderBytes));
  FileLayout layout;
  ISOSCOPE_RETURN_IF_ERROR(SetAnalyzeGrid(header, path, &layout));
  SampleLocation& location = layout.location;
  location.is_big_endian = header.is_big_endian();
  location.volume_count = layout.steps;
  ISOSCOPE_ASSIGN_OR_RETURN(location.stored_type,
                            AnalyzeTypeOf(header.Load<std::int16_t>(70), path));
  ISOSCOPE_ASSIGN_OR_RETURN(location.files, NiftiImageOfPair(path));
  if (IsNiftiStream(path, location.files.front())) {
    location.encoding = SampleEncoding::kDeflate;
  }
  const auto skip = static_cast<double>(header.Load<float>(108));
  if (!(skip >= 0 && skip < 0x1p53)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: Analyze vox_offset %g; expected 0 or more", path, skip));
  }
  (location.is_encoded() ? location.decoded_skip : location.offset) =
      static_cast<std::int64_t>(skip);
  ISOSCOPE_RETURN_IF_ERROR(
      SetNiftiScale(static_cast<double>(header.Load<float>(112)), 0, "Analyze", path, &location));
  return layout;
}

}  // namespace isoscope::source
