// MINC 2 is an HDF5 file with dimensions "xspace", "yspace" and "zspace": each has a start, a step
// and the cosines of its direction, in RAS. Samples are stored as integers between two limits,
// whose real values may differ from slice to slice; libminc gives the real ones. ITK keeps the
// directions as they are, so this file turns them to LPS.
//
// Source: https://en.wikibooks.org/wiki/MINC/Reference/MINC2.0_File_Format_Reference.

#include "core/formats/netcdf/minc_source.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "itkMINCImageIO.h"

#include "core/base/status_macros.h"
#include "core/formats/netcdf/minc1_series.h"
#include "core/formats/netcdf/minc2_header.h"
#include "core/math/matrix.h"
#include "core/source/bytes/file_start.h"
#include "core/source/child/itk_types.h"
#include "core/source/child/silent_libraries.h"
#include "core/source/child/walled_source.h"
#include "core/source/grid/affine_grid.h"
#include "core/source/hdf5/hdf5_file.h"
#include "core/source/single_series.h"

namespace isoscope::source {
namespace {

class MincSource final : public VolumeSource {
 public:
  MincSource(itk::MINCImageIO::Pointer io, const volume::GridGeometry& geometry,
             volume::ScalarType type, const std::string& name)
      : VolumeSource({.name = name,
                      .geometry = geometry,
                      .type = type,
                      .patient_frame = volume::PatientFrame()}),
        io_(std::move(io)) {}

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const math::Index3& dims = info().geometry.sample_dims;
    try {
      while (begin_row < end_row) {
        const std::int64_t y = begin_row % dims.y;
        const std::int64_t rows = std::min(end_row - begin_row, dims.y - y);
        itk::ImageIORegion region(3);
        region.SetIndex({0, y, begin_row / dims.y});
        region.SetSize({static_cast<std::size_t>(dims.x), static_cast<std::size_t>(rows), 1});
        io_->SetIORegion(region);
        io_->Read(out);
        out += rows * info().row_bytes();
        begin_row += rows;
      }
    } catch (const std::exception& error) {
      return absl::DataLossError(
          absl::StrFormat("%s: can't be read as MINC: %s", info().name, TextOfItk(error)));
    }
    return absl::OkStatus();
  }

 private:
  const itk::MINCImageIO::Pointer io_;
};

// `factors`: what turns the lengths along each axis to millimetres.
absl::StatusOr<volume::GridGeometry> GridOf(const itk::ImageIOBase& io,
                                            const std::array<double, 3>& factors,
                                            const std::string& path) {
  AffineRows rows;
  math::Mat3d directions;
  math::Vec3d origin{io.GetOrigin(0), io.GetOrigin(1), io.GetOrigin(2)};
  for (unsigned axis = 0; axis < 3; ++axis) {
    const std::vector<double> direction = io.GetDirection(axis);
    directions.columns.at(axis) = {direction.at(0), direction.at(1), direction.at(2)};
    for (unsigned r = 0; r < 3; ++r) {
      rows.at(r).at(axis) = direction.at(r) * io.GetSpacing(axis) * factors.at(axis);
    }
  }
  if (factors != std::array<double, 3>{1, 1, 1}) {
    // The origin is the sum of the starts along the axes, each in the unit of its own.
    const math::Vec3d starts = math::Inverted(directions) * origin;
    origin = directions *
             math::Vec3d{starts.x * factors[0], starts.y * factors[1], starts.z * factors[2]};
  }
  for (unsigned r = 0; r < 3; ++r) {
    rows.at(r).at(3) = origin[static_cast<int>(r)];
  }
  return GridFromAffine({static_cast<std::int64_t>(io.GetDimensions(0)),
                         static_cast<std::int64_t>(io.GetDimensions(1)),
                         static_cast<std::int64_t>(io.GetDimensions(2))},
                        rows, PatientWorld::kRas, path);
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenMincChild(const std::string& path) {
  SilenceImageLibraries();  // first, so that its lock is free when the process forks
  return OpenWalled({.name = "libminc", .open = OpenMincFile}, path);
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenMincFile(const std::string& path,
                                                           const std::string& /*part*/) {
  PrepareHdf5();
  ISOSCOPE_ASSIGN_OR_RETURN(const auto factors, CheckMinc2Header(path));
  try {
    auto io = itk::MINCImageIO::New();
    io->SetFileName(path);
    io->ReadImageInformation();
    if (io->GetNumberOfDimensions() != 3 || io->GetNumberOfComponents() != 1) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: a MINC file of %d axes and %d components a sample; expected one three-dimensional "
          "volume: extract one (mincreshape)",
          path, io->GetNumberOfDimensions(), io->GetNumberOfComponents()));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const volume::ScalarType type,
                              ScalarTypeOf(io->GetComponentType(), path));
    ISOSCOPE_ASSIGN_OR_RETURN(const volume::GridGeometry geometry, GridOf(*io, factors, path));
    return std::make_unique<MincSource>(std::move(io), geometry, type, path);
  } catch (const std::exception& error) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: can't be read as MINC: %s", path, TextOfItk(error)));
  }
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenMincSeries(const std::string& path,
                                                             const std::string& field) {
  ISOSCOPE_ASSIGN_OR_RETURN(const FileStart head, ReadFileStart(path, 8));
  if (!head.is_gzip && IsMinc1(head.bytes)) {
    return OpenMinc1Series(path, field);
  }
  if (head.is_gzip || !absl::StartsWith(head.bytes, "\x89HDF\r\n\x1a\n")) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: not a MINC file, though its name says so", path));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> volume, OpenMincChild(path));
  return MakeSingleSeries({.path = path,
                           .field = field,
                           .length_unit = "mm",
                           .volume = std::move(volume),
                           .open = [path] { return OpenMincChild(path); }});
}

}  // namespace isoscope::source
