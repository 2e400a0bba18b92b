// GIPL (Guy's Image Processing Lab) is a header of 256 bytes and the samples, also as one gzip
// stream. Numbers are big-endian:
//
//   byte   0  uint16[4]  samples along x, y, z, time; 0 for an axis that is not there
//   byte   8  uint16     type: 7 int8, 8 uint8, 15 int16, 16 uint16, 31 uint32, 32 int32,
//                        64 float32, 65 float64
//   byte  10  float[4]   distances of samples, in mm
//   byte 204  double[4]  position of the first sample
//   byte 252  uint32     the mark: 0xEFFFE9B0, of old files 0x2AE389B8
//
// The matrix at byte 106 is not used, as in ITK. Source: ITK's GiplImageIO,
// https://itk.org/Doxygen52/html/classitk_1_1GiplImageIO.html.

#include <array>
#include <cstdint>

#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/formats/medical/layout_formats.h"
#include "core/source/bytes/binary_header.h"
#include "core/source/bytes/file_start.h"
#include "core/source/grid/sample_distance.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kGiplHeaderBytes = 256;
constexpr std::size_t kMarkByte = 252;

bool IsMark(std::uint32_t mark) { return mark == 0xEFFFE9B0 || mark == 0x2AE389B8; }

absl::StatusOr<volume::ScalarType> GiplType(std::uint16_t code, const std::string& path) {
  switch (code) {
    case 7:
      return volume::ScalarType::kInt8;
    case 8:
      return volume::ScalarType::kUint8;
    case 15:
      return volume::ScalarType::kInt16;
    case 16:
      return volume::ScalarType::kUint16;
    case 31:
      return volume::ScalarType::kUint32;
    case 32:
      return volume::ScalarType::kInt32;
    case 64:
      return volume::ScalarType::kFloat32;
    case 65:
      return volume::ScalarType::kFloat64;
    default:
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: GIPL type %d; expected 7, 8 (8 bits), 15, 16 (16 bits), 31, 32 (32 bits), 64 or 65 "
          "(float): convert it to NIfTI or NRRD",
          path, code));
  }
}

}  // namespace

bool IsGiplHeader(absl::string_view head) {
  return head.size() >= kGiplHeaderBytes &&
         IsMark(BinaryHeader(std::string(head.substr(0, kGiplHeaderBytes)), true)
                    .Load<std::uint32_t>(kMarkByte));
}

absl::StatusOr<FileLayout> ReadGiplLayout(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const FileStart head, ReadFileStart(path, kGiplHeaderBytes));
  if (head.bytes.size() < kGiplHeaderBytes) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: the GIPL header has %d bytes, expected %d: the file is cut", path,
                        head.bytes.size(), kGiplHeaderBytes));
  }
  const BinaryHeader header(head.bytes, true);
  const auto mark = header.Load<std::uint32_t>(kMarkByte);
  if (!IsMark(mark)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: byte 252 has the mark 0x%08X, expected 0xEFFFE9B0: not a GIPL file", path, mark));
  }
  FileLayout layout{.length_unit = "mm"};
  std::array<std::int64_t, 4> dims{};
  std::array<double, 3> spacing{};
  std::array<double, 3> origin{};
  for (std::size_t axis = 0; axis < 4; ++axis) {
    dims[axis] = header.Load<std::uint16_t>(2 * axis);
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    spacing[axis] = static_cast<double>(header.Load<float>(10 + 4 * axis));
    const absl::Status good = CheckSampleDistance(
        path, absl::StrFormat("distance %d of the GIPL header", axis + 1), spacing[axis]);
    layout.faults.distances.Update(good);
    spacing[axis] = good.ok() ? spacing[axis] : 1;
    origin[axis] = header.Load<double>(204 + 8 * axis);
  }
  layout.geometry.sample_dims = {dims[0], dims[1], dims[2]};
  layout.geometry.spacing = {spacing[0], spacing[1], spacing[2]};
  layout.geometry.origin = {origin[0], origin[1], origin[2]};
  ReplaceFaults(path, &layout.geometry, &layout.faults);
  const absl::Status valid = volume::Validate(layout.geometry);
  if (!valid.ok()) {
    return absl::Status(valid.code(), absl::StrFormat("%s: %s", path, valid.message()));
  }
  layout.steps = dims[3] == 0 ? 1 : dims[3];
  const bool is_gzip = head.is_gzip;
  layout.location = {.files = {path},
                     .encoding = is_gzip ? SampleEncoding::kDeflate : SampleEncoding::kRaw,
                     .is_big_endian = true};
  (is_gzip ? layout.location.decoded_skip : layout.location.offset) = kGiplHeaderBytes;
  layout.location.volume_count = layout.steps;
  ISOSCOPE_ASSIGN_OR_RETURN(layout.location.stored_type,
                            GiplType(header.Load<std::uint16_t>(8), path));
  return layout;
}

}  // namespace isoscope::source
