#include "core/formats/medical/itk_header.h"

#include <cstddef>
#include <exception>
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "itkMetaImageIO.h"
#include "itkNrrdImageIO.h"

#include "core/base/status_macros.h"
#include "core/formats/medical/meta_image_grid.h"
#include "core/source/bytes/text_header.h"
#include "core/source/child/itk_types.h"
#include "core/source/child/silent_libraries.h"

namespace isoscope::source {
namespace {

absl::string_view NameOf(FileFormat format) {
  switch (format) {
    case FileFormat::kNrrd:
      return "NRRD";
    case FileFormat::kMetaImage:
      return "MetaImage";
  }
  return "";
}

itk::ImageIOBase::Pointer MakeImageIo(FileFormat format) {
  switch (format) {
    case FileFormat::kNrrd:
      return itk::NrrdImageIO::New().GetPointer();
    case FileFormat::kMetaImage:
      return itk::MetaImageIO::New().GetPointer();
  }
  return nullptr;
}

// The field "space" of an NRRD header in lower case; "" if there is none. ITK keeps only the space
// into which it has converted the file.
std::string NrrdSpaceOf(const std::string& path) {
  const absl::StatusOr<std::string> text = ReadTextHeader(path);
  std::size_t position = 0;
  absl::string_view line;
  while (text.ok() && NextLine(*text, &position, &line) && !line.empty()) {
    if (absl::StartsWith(line, "space:")) {
      return absl::AsciiStrToLower(absl::StripAsciiWhitespace(line.substr(6)));
    }
  }
  return "";
}

// Whether the file defines how its world, which ITK has converted to LPS, lies in the patient.
bool HasPatientFrame(FileFormat format, const std::string& path) {
  switch (format) {
    case FileFormat::kNrrd: {
      // Not left-anterior-superior: ITK 5.2 negates x instead of y.
      const std::string space = NrrdSpaceOf(path);
      return space == "left-posterior-superior" || space == "lps" ||
             space == "right-anterior-superior" || space == "ras";
    }
    case FileFormat::kMetaImage:
      return false;
  }
  return false;
}

absl::StatusOr<ImageHeader> Convert(const itk::ImageIOBase& io, ImageLayout layout,
                                    const std::string& path) {
  std::int64_t extra_samples = 1;
  for (std::size_t axis = 3; axis < layout.dims.size(); ++axis) {
    extra_samples *= layout.dims[axis];
  }
  if (layout.dims.size() < 3 || extra_samples != 1) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": ", layout.dims.size(), "-dimensional, ", absl::StrJoin(layout.dims, " x "),
        " samples; expected one three-dimensional volume",
        layout.dims.size() < 3 ? ", of 2 samples or more along each of three axes"
                               : ": extract one (time step, channel)"));
  }
  if (layout.components != 1) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": ", layout.components,
                     " components a sample (a colour or vector volume); expected 1: extract one"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::ScalarType type,
                            ScalarTypeOf(io.GetComponentType(), path));
  return ImageHeader{
      .geometry = layout.geometry, .type = type, .patient_frame = layout.patient_frame};
}

// Without a check of the number of axes.
ImageLayout LayoutOf(const itk::ImageIOBase& io) {
  ImageLayout layout;
  const unsigned int dimension_count = io.GetNumberOfDimensions();
  for (unsigned int axis = 0; axis < dimension_count; ++axis) {
    layout.dims.push_back(static_cast<std::int64_t>(io.GetDimensions(axis)));
  }
  layout.components = static_cast<std::int64_t>(io.GetNumberOfComponents());
  for (unsigned int axis = 0; axis < 3 && dimension_count >= 3; ++axis) {
    const int index = static_cast<int>(axis);
    layout.geometry.sample_dims[index] = layout.dims[axis];
    layout.geometry.spacing[index] = io.GetSpacing(axis);
    layout.geometry.origin[index] = io.GetOrigin(axis);
    const std::vector<double> direction = io.GetDirection(axis);
    layout.geometry.direction.columns[axis] = {direction[0], direction[1], direction[2]};
  }
  const auto type = ScalarTypeOf(io.GetComponentType(), "");
  if (type.ok()) {
    layout.type = *type;
  }
  return layout;
}

absl::Status CheckGrid(const volume::GridGeometry& geometry, const std::string& path) {
  const absl::Status valid = volume::Validate(geometry);
  return valid.ok() ? valid : absl::Status(valid.code(), absl::StrCat(path, ": ", valid.message()));
}

// Calls `convert` with ITK's reader and the layout of the file.
template <typename Result>
absl::StatusOr<Result> ReadHeader(
    FileFormat format, const std::string& path,
    const std::function<absl::StatusOr<Result>(const itk::ImageIOBase&, ImageLayout)>& convert) {
  SilenceImageLibraries();
  try {
    const itk::ImageIOBase::Pointer io = MakeImageIo(format);
    io->SetFileName(path);
    // Before MetaIO, which passes over some numbers that are none.
    std::optional<volume::GridGeometry> grid;
    if (format == FileFormat::kMetaImage) {
      ISOSCOPE_ASSIGN_OR_RETURN(grid, ReadMetaImageGrid(path, {}));
    }
    io->ReadImageInformation();
    ImageLayout layout = LayoutOf(*io);
    if (grid.has_value()) {
      layout.geometry = *grid;
    }
    if (HasPatientFrame(format, path)) {
      layout.patient_frame.emplace();
    }
    return convert(*io, std::move(layout));
  } catch (const std::exception& error) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: can't be read as %s: %s", path, NameOf(format), TextOfItk(error)));
  }
}

}  // namespace

std::string TextOfItk(const std::exception& error) {
  const auto* const of_itk = dynamic_cast<const itk::ExceptionObject*>(&error);
  const std::string text = of_itk == nullptr ? error.what() : of_itk->GetDescription();
  const std::size_t begin = text.find("(0x");
  const std::size_t end = begin == std::string::npos ? begin : text.find("): ", begin);
  return end == std::string::npos ? text : text.substr(end + 3);
}

absl::StatusOr<volume::ScalarType> ScalarTypeOf(itk::ImageIOBase::IOComponentEnum component,
                                                const std::string& path) {
  using Component = itk::ImageIOBase::IOComponentEnum;
  switch (component) {
    case Component::UCHAR:
      return volume::ScalarType::kUint8;
    case Component::CHAR:
      return volume::ScalarType::kInt8;
    case Component::USHORT:
      return volume::ScalarType::kUint16;
    case Component::SHORT:
      return volume::ScalarType::kInt16;
    case Component::UINT:
      return volume::ScalarType::kUint32;
    case Component::INT:
      return volume::ScalarType::kInt32;
    case Component::FLOAT:
      return volume::ScalarType::kFloat32;
    case Component::DOUBLE:
      return volume::ScalarType::kFloat64;
    default:
      return absl::InvalidArgumentError(absl::StrCat(
          path, ": samples of type ", itk::ImageIOBase::GetComponentTypeAsString(component),
          "; expected (u)int8, (u)int16, (u)int32, float32 or float64: convert the file to one of "
          "them"));
  }
}

absl::StatusOr<ImageHeader> ReadImageHeader(FileFormat format, const std::string& path) {
  return ReadHeader<ImageHeader>(
      format, path,
      [&](const itk::ImageIOBase& io, ImageLayout layout) -> absl::StatusOr<ImageHeader> {
        ISOSCOPE_ASSIGN_OR_RETURN(ImageHeader header, Convert(io, std::move(layout), path));
        ISOSCOPE_RETURN_IF_ERROR(CheckGrid(header.geometry, path));
        return header;
      });
}

absl::StatusOr<ImageLayout> ReadImageLayout(FileFormat format, const std::string& path) {
  return ReadHeader<ImageLayout>(
      format, path,
      [&](const itk::ImageIOBase& /*io*/, ImageLayout layout) -> absl::StatusOr<ImageLayout> {
        if (layout.dims.size() < 3) {
          return absl::InvalidArgumentError(
              absl::StrCat(path, ": ", layout.dims.size(), "-dimensional, ",
                           absl::StrJoin(layout.dims, " x "), " samples; expected three axes"));
        }
        ISOSCOPE_RETURN_IF_ERROR(CheckGrid(layout.geometry, path));
        return layout;
      });
}

}  // namespace isoscope::source
