#include "core/ingest/volume_source.h"

#include <algorithm>
#include <array>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/file.h"
#include "core/base/status_macros.h"
#include "core/ingest/file_source.h"
#include "core/ingest/itk_header.h"
#include "core/ingest/sample_location.h"

namespace isoscope::ingest {
namespace {

struct Suffix {
  const char* text;
  FileFormat format;
};
constexpr std::array<Suffix, 9> kSuffixes{{{".nii", FileFormat::kNifti},
                                           {".nii.gz", FileFormat::kNifti},
                                           {".hdr", FileFormat::kNifti},
                                           {".img", FileFormat::kNifti},
                                           {".img.gz", FileFormat::kNifti},
                                           {".nrrd", FileFormat::kNrrd},
                                           {".nhdr", FileFormat::kNrrd},
                                           {".mha", FileFormat::kMetaImage},
                                           {".mhd", FileFormat::kMetaImage}}};

class MemorySource final : public VolumeSource {
 public:
  MemorySource(const volume::GridGeometry& geometry, volume::ScalarType type, std::string samples,
               std::string name)
      : geometry_(geometry), type_(type), samples_(std::move(samples)), name_(std::move(name)) {
    ISOSCOPE_CHECK_EQ(
        samples_.size(),
        static_cast<std::size_t>(math::Volume(geometry.sample_dims)) * volume::SizeOf(type));
  }

  [[nodiscard]] const volume::GridGeometry& geometry() const override { return geometry_; }
  [[nodiscard]] volume::ScalarType scalar_type() const override { return type_; }
  [[nodiscard]] const std::string& name() const override { return name_; }

  absl::Status ReadSlab(std::int64_t begin_z, std::int64_t end_z, char* out) override {
    const math::Index3& dims = geometry_.sample_dims;
    ISOSCOPE_CHECK(begin_z >= 0 && begin_z < end_z && end_z <= dims.z);
    const std::size_t plane_bytes =
        static_cast<std::size_t>(dims.x * dims.y) * volume::SizeOf(type_);
    std::copy_n(samples_.data() + static_cast<std::size_t>(begin_z) * plane_bytes,
                static_cast<std::size_t>(end_z - begin_z) * plane_bytes, out);
    return absl::OkStatus();
  }

 private:
  const volume::GridGeometry geometry_;
  const volume::ScalarType type_;
  const std::string samples_;
  const std::string name_;
};

absl::Status CheckIsFile(const std::string& path) {
  if (!base::PathExists(path)) {
    return absl::NotFoundError(absl::StrCat(path, ": no such file"));
  }
  if (base::IsDirectory(path)) {
    return absl::InvalidArgumentError(absl::StrCat(
        path,
        ": a folder; expected one volume file (a DICOM series is not read: convert it to "
        "NIfTI, for example with dcm2niix)"));
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenVolumeFile(const std::string& path) {
  ISOSCOPE_RETURN_IF_ERROR(CheckIsFile(path));
  const auto* suffix = std::find_if(kSuffixes.begin(), kSuffixes.end(), [&](const Suffix& known) {
    return absl::EndsWithIgnoreCase(path, known.text);
  });
  if (suffix == kSuffixes.end()) {
    return absl::InvalidArgumentError(absl::StrCat(
        path,
        ": unknown kind of file; known are NIfTI (.nii .nii.gz .hdr .img .img.gz), NRRD (.nrrd "
        ".nhdr) and MetaImage (.mha .mhd); anything else is read as raw samples with --dims X,Y,Z "
        "--type T [--spacing X,Y,Z] [--origin X,Y,Z] [--endian little|big] [--header-bytes N]"));
  }
  std::string header_path = path;
  if (suffix->format == FileFormat::kNifti) {
    header_path = NiftiHeaderPath(path);
    if (!base::PathExists(header_path)) {
      return absl::NotFoundError(
          absl::StrFormat("%s: its NIfTI header %s does not exist; to read it as raw samples give "
                          "--dims and --type",
                          path, header_path));
    }
  }
  ISOSCOPE_ASSIGN_OR_RETURN(SampleLocation location, LocateSamples(suffix->format, header_path));
  ISOSCOPE_ASSIGN_OR_RETURN(const ImageHeader header, ReadImageHeader(suffix->format, header_path));
  if (suffix->format != FileFormat::kNifti) {
    location.stored_type = header.type;
  }
  return MakeFileSource(header.geometry, location, path);
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenRawFile(const std::string& path,
                                                          const RawFormat& format) {
  ISOSCOPE_RETURN_IF_ERROR(CheckIsFile(path));
  if (format.header_bytes < 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: --header-bytes %d: expected 0 or more", path, format.header_bytes));
  }
  const volume::GridGeometry geometry{.sample_dims = format.dims,
                                      .spacing = format.spacing,
                                      .origin = format.origin,
                                      .direction = {}};
  return MakeFileSource(geometry,
                        {.path = path,
                         .offset = format.header_bytes,
                         .is_big_endian = format.is_big_endian,
                         .stored_type = format.type},
                        path);
}

std::unique_ptr<VolumeSource> MakeMemorySource(const volume::GridGeometry& geometry,
                                               volume::ScalarType type, std::string samples,
                                               std::string name) {
  return std::make_unique<MemorySource>(geometry, type, std::move(samples), std::move(name));
}

}  // namespace isoscope::ingest
