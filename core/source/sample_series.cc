#include "core/source/sample_series.h"

#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/source/nifti_layout.h"
#include "core/source/nrrd_layout.h"
#include "core/source/wide_source.h"

namespace isoscope::source {
namespace {

absl::StatusOr<std::optional<FileLayout>> NiftiFileLayout(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const NiftiLayout nifti, ReadNiftiLayout(path));
  if (nifti.steps == 1 && nifti.components == 1) {
    return std::nullopt;
  }
  FileLayout layout{.components = nifti.components,
                    .steps = nifti.steps,
                    .interval = nifti.interval,
                    .time_unit = nifti.time_unit,
                    .length_unit = nifti.length_unit};
  ISOSCOPE_ASSIGN_OR_RETURN(layout.location, LocateNiftiSamples(path));  // checks for ITK
  ISOSCOPE_ASSIGN_OR_RETURN(const ImageLayout image, ReadImageLayout(FileFormat::kNifti, path));
  layout.geometry = image.geometry;
  layout.patient_frame = image.patient_frame;
  layout.location.volume_count = nifti.steps * nifti.components;
  return layout;
}

absl::StatusOr<std::optional<FileLayout>> NrrdFileLayout(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const HeaderFields fields, ReadNrrdFields(path));
  const std::vector<std::int64_t> sizes =
      fields.GetIntegers("sizes").value_or(std::vector<std::int64_t>());
  const std::optional<NrrdSampleType> type = NrrdTypeFromName(fields.Get("type"));
  FileLayout layout;
  if (sizes.size() == 3 && type.has_value() && type->wide.has_value()) {
    ISOSCOPE_ASSIGN_OR_RETURN(const ImageLayout image, ReadImageLayout(FileFormat::kNrrd, path));
    if (image.dims != sizes || image.components != 1) {
      return std::nullopt;  // whatever it is, OpenVolumeFile says why not
    }
    layout.geometry = image.geometry;
    layout.patient_frame = image.patient_frame;
  } else if (sizes.size() == 4 && sizes[3] != 1) {
    ISOSCOPE_ASSIGN_OR_RETURN(const NrrdLayout nrrd, ReadNrrdLayout(path));
    layout.geometry = nrrd.geometry;
    layout.patient_frame = nrrd.patient_frame;
    const std::int64_t others = nrrd.tuples * nrrd.volumes;
    (nrrd.is_time ? layout.steps : layout.components) = others;
    layout.location.volume_count = nrrd.volumes;
    layout.location.components = nrrd.tuples;
    layout.interval = nrrd.interval;
    layout.time_unit = nrrd.time_unit;
    layout.length_unit = nrrd.length_unit;
    layout.sample_unit = nrrd.sample_unit;
  } else {
    return std::nullopt;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(SampleLocation location, LocateNrrdSamples(path));
  location.volume_count = layout.location.volume_count;
  location.components = layout.location.components;
  location.stored_type = type.has_value() ? type->scalar : volume::ScalarType::kUint8;
  layout.wide = type.has_value() ? type->wide : std::nullopt;
  if (layout.wide.has_value() && location.encoding == SampleEncoding::kText) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: 64-bit integers as text; expected encoding raw, gzip, bzip2 or hex: "
                        "convert it (unu save -e gzip)",
                        path));
  }
  layout.location = std::move(location);
  return layout;
}

absl::StatusOr<std::optional<FileLayout>> MetaImageFileLayout(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(SampleLocation location, LocateMetaImageSamples(path));
  ISOSCOPE_ASSIGN_OR_RETURN(const ImageLayout image, ReadImageLayout(FileFormat::kMetaImage, path));
  if (image.components <= 1 || image.dims.size() != 3 || !image.type.has_value()) {
    return std::nullopt;
  }
  FileLayout layout{.geometry = image.geometry, .components = image.components};
  location.stored_type = *image.type;
  location.components = image.components;
  layout.location = std::move(location);
  return layout;
}

absl::StatusOr<std::optional<FileLayout>> LayoutOfFile(FileFormat format, const std::string& path) {
  switch (format) {
    case FileFormat::kNifti:
      return NiftiFileLayout(path);
    case FileFormat::kNrrd:
      return NrrdFileLayout(path);
    case FileFormat::kMetaImage:
      return MetaImageFileLayout(path);
  }
  return absl::InternalError("file format out of range");
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenSampleSeries(FileFormat format,
                                                               const std::string& header_path,
                                                               const std::string& path,
                                                               const std::string& field) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::optional<FileLayout> layout, LayoutOfFile(format, header_path));
  if (!layout.has_value()) {
    return nullptr;
  }
  return MakeLayoutSeries(path, field, *std::move(layout));
}

}  // namespace isoscope::source
