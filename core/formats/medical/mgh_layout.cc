// MGH is a header of 284 bytes, the samples, and a footer, whose first float is the repetition time
// in ms. MGZ is the same as a gzip stream; there the footer is not read, because all samples would
// have to be decoded for it. Numbers are big-endian:
//
//   byte   0  int32     1, the version
//   byte   4  int32[4]  x, y, z, frames
//   byte  20  int32     type of the samples: 0 uint8, 1 int32, 3 float32, 4 int16, 10 uint16
//   byte  28  int16     above 0 if the rest is set
//   byte  30  float[3]  distances of samples
//   byte  42  float[9]  directions of x, of y, of z in RAS
//   byte  78  float[3]  RAS position of sample dims / 2, in halves where dims are odd
//
// Without the mark at byte 28 FreeSurfer takes distances of 1 and coronal directions, and nothing
// is known of the patient. Source: https://surfer.nmr.mgh.harvard.edu/fswiki/FsTutorial/MghFormat;
// nibabel's freesurfer/mghformat.py.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <utility>

#include "absl/strings/str_format.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/formats/medical/layout_formats.h"
#include "core/io/file.h"
#include "core/source/bytes/binary_header.h"
#include "core/source/bytes/file_start.h"
#include "core/source/grid/affine_grid.h"
#include "core/source/grid/sample_distance.h"

namespace isoscope::source {
namespace {

constexpr std::size_t kMghHeaderBytes = 284;

absl::StatusOr<volume::ScalarType> MghType(std::int32_t code, const std::string& path) {
  switch (code) {
    case 0:
      return volume::ScalarType::kUint8;
    case 1:
      return volume::ScalarType::kInt32;
    case 3:
      return volume::ScalarType::kFloat32;
    case 4:
      return volume::ScalarType::kInt16;
    case 10:
      return volume::ScalarType::kUint16;
    default:
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: MGH type %d; expected 0 (uint8), 1 (int32), 3 (float32), 4 (int16) or 10 (uint16): "
          "convert it (mri_convert -odt float)",
          path, code));
  }
}

// Returns the distance, or 1 if it is not above 0 and finite: FileLayout::faults then refuses it.
double DistanceOfMgh(const BinaryHeader& header, std::size_t axis) {
  const auto distance = static_cast<double>(header.Load<float>(30 + 4 * axis));
  return std::isfinite(distance) && distance > 0 ? distance : 1;
}

AffineRows MghTransform(const BinaryHeader& header, const std::array<std::int64_t, 3>& dims,
                        bool is_set) {
  AffineRows rows{{{-1, 0, 0, 0}, {0, 0, 1, 0}, {0, -1, 0, 0}}};  // FreeSurfer's coronal
  for (std::size_t r = 0; r < 3; ++r) {
    double offset = is_set ? static_cast<double>(header.Load<float>(78 + 4 * r)) : 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (is_set) {
        rows[r][axis] = static_cast<double>(header.Load<float>(42 + 12 * axis + 4 * r)) *
                        DistanceOfMgh(header, axis);
      }
      offset -= rows[r][axis] * static_cast<double>(dims[axis]) / 2;
    }
    rows[r][3] = offset;
  }
  return rows;
}

// The time between frames in ms; 0 if the file does not say.
absl::StatusOr<double> MghRepetitionTime(const std::string& path, const FileLayout& layout) {
  const math::Index3& dims = layout.geometry.sample_dims;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(path));
  const double footer = static_cast<double>(kMghHeaderBytes) +
                        static_cast<double>(dims.x) * static_cast<double>(dims.y) *
                            static_cast<double>(dims.z) * static_cast<double>(layout.steps) *
                            static_cast<double>(volume::SizeOf(layout.location.stored_type));
  if (footer + sizeof(float) > static_cast<double>(file->size_bytes())) {
    return 0;
  }
  std::array<char, sizeof(float)> bytes{};
  ISOSCOPE_RETURN_IF_ERROR(
      file->ReadAt(static_cast<std::int64_t>(footer), bytes.size(), bytes.data()));
  std::reverse(bytes.begin(), bytes.end());
  const auto time = static_cast<double>(base::LoadLittleEndian<float>(bytes.data()));
  return std::isfinite(time) && time > 0 ? time : 0;
}

}  // namespace

absl::StatusOr<FileLayout> ReadMghLayout(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const FileStart head, ReadFileStart(path, kMghHeaderBytes));
  if (head.bytes.size() < kMghHeaderBytes) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: the MGH header has %d bytes, expected %d: the file is cut", path,
                        head.bytes.size(), kMghHeaderBytes));
  }
  const BinaryHeader header(head.bytes, true);
  if (header.Load<std::int32_t>(0) != 1) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: the header starts with %d, expected 1: not an MGH file", path,
                        header.Load<std::int32_t>(0)));
  }
  std::array<std::int64_t, 3> dims{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    dims[axis] = header.Load<std::int32_t>(4 + 4 * axis);
  }
  FileLayout layout{.steps = header.Load<std::int32_t>(16), .length_unit = "mm"};
  if (layout.steps < 1) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d frames in the MGH header; expected 1 or more", path, layout.steps));
  }
  layout.location = {.files = {path},
                     .encoding = head.is_gzip ? SampleEncoding::kDeflate : SampleEncoding::kRaw,
                     .is_big_endian = true};
  (layout.location.is_encoded() ? layout.location.decoded_skip : layout.location.offset) =
      kMghHeaderBytes;
  layout.location.volume_count = layout.steps;
  ISOSCOPE_ASSIGN_OR_RETURN(layout.location.stored_type,
                            MghType(header.Load<std::int32_t>(20), path));
  const bool is_set = header.Load<std::int16_t>(28) > 0;
  for (std::size_t axis = 0; axis < 3 && is_set; ++axis) {
    layout.faults.distances.Update(
        CheckSampleDistance(path, absl::StrFormat("distance %d of the MGH header", axis + 1),
                            static_cast<double>(header.Load<float>(30 + 4 * axis))));
  }
  const AffineRows rows = MghTransform(header, dims, is_set);
  ISOSCOPE_ASSIGN_OR_RETURN(
      layout.geometry,
      GridFromAffine({dims[0], dims[1], dims[2]}, rows, PatientWorld::kRas, path, &layout.faults));
  layout.shear = FindShear(rows);
  if (layout.steps > 1 && !head.is_gzip) {
    ISOSCOPE_ASSIGN_OR_RETURN(const double time, MghRepetitionTime(path, layout));
    layout.interval = time > 0 ? time : 1;
    layout.time_unit = time > 0 ? "ms" : "";
  }
  if (is_set) {
    layout.patient_frame.emplace();
  }
  return layout;
}

}  // namespace isoscope::source
