#include "core/source/sample_series.h"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/source/file_source.h"
#include "core/source/nifti_layout.h"
#include "core/source/nrrd_layout.h"
#include "core/source/wide_source.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxFileSteps = 100'000;

// What the header says, whatever the format.
struct FileLayout {
  volume::GridGeometry geometry{};
  std::optional<volume::PatientFrame> patient_frame{};
  SampleLocation location{};  // with the number of volumes and components of a tuple
  std::optional<WideType> wide{};
  std::int64_t steps = 1;
  std::int64_t components = 1;
  double interval = 1;
  std::string time_unit{};
  std::string length_unit{};
  std::string sample_unit{};
};

class SampleSeries final : public VolumeSeries {
 public:
  SampleSeries(std::string path, const std::string& field, FileLayout layout)
      : path_(std::move(path)), layout_(std::move(layout)) {
    SourceField only{.name = field, .unit = layout_.sample_unit};
    if (layout_.components > 1) {
      only.components.clear();
      for (std::int64_t i = 0; i < layout_.components; ++i) {
        only.components.push_back(layout_.components == 3 ? std::string(1, "xyz"[i])
                                                          : absl::StrCat(i));
      }
    }
    fields_ = {std::move(only)};
    for (std::int64_t i = 0; layout_.steps > 1 && i < layout_.steps; ++i) {
      times_.push_back(static_cast<double>(i) * layout_.interval);
    }
  }

  [[nodiscard]] const std::string& name() const override { return path_; }
  [[nodiscard]] const std::vector<SourceField>& fields() const override { return fields_; }
  [[nodiscard]] const std::vector<double>& times() const override { return times_; }
  [[nodiscard]] const std::string& time_unit() const override { return layout_.time_unit; }
  [[nodiscard]] const std::string& length_unit() const override { return layout_.length_unit; }

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    ISOSCOPE_CHECK(field == 0);
    SampleLocation location = layout_.location;
    if (location.components > 1) {  // tuples of components, or of steps
      location.component = layout_.components > 1 ? component : step;
    } else {
      location.volume = component * layout_.steps + step;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(
        std::unique_ptr<VolumeSource> source,
        MakeFileSource(layout_.geometry, location, path_, layout_.patient_frame));
    if (layout_.wide.has_value()) {
      return MakeWideSource(std::move(source), *layout_.wide);
    }
    return source;
  }

 private:
  const std::string path_;
  const FileLayout layout_;
  std::vector<SourceField> fields_;
  std::vector<double> times_;
};

absl::StatusOr<std::optional<FileLayout>> NiftiFileLayout(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const NiftiLayout nifti, ReadNiftiLayout(path));
  if (nifti.steps == 1 && nifti.components == 1) {
    return std::nullopt;
  }
  FileLayout layout{.steps = nifti.steps,
                    .components = nifti.components,
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
  if (layout->steps > kMaxFileSteps) {
    return absl::InvalidArgumentError(absl::StrFormat("%s: %d steps of time; expected at most %d",
                                                      path, layout->steps, kMaxFileSteps));
  }
  return std::make_unique<SampleSeries>(path, field, *std::move(layout));
}

}  // namespace isoscope::source
