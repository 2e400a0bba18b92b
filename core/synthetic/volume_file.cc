// Writes a volume in this order:
//
// 1. Check the kind of file, the geometry, and the free space.
// 2. Write the header: in front of the samples, or into a .nhdr beside the .raw.
// 3. WriteSamples, as a TBB pipeline: take the next rows, fill them in parallel, append in order.
// 4. Rename the samples' file, then the header's, so that no header names missing samples.
//
// Example, 64 x 64 x 93 int16 as NRRD: "NRRD0004\ntype: int16\n...\n\n", then 761 856 bytes.

#include "core/synthetic/volume_file.h"

#include <array>
#include <memory>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"

#include "core/base/status_macros.h"
#include "core/io/atomic_file.h"
#include "core/synthetic/generated_file.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/label.h"

namespace isoscope::source {
namespace {

struct Ending {
  const char* text;
  VolumeFileKind kind;
};
constexpr std::array<Ending, 4> kEndings{{{".nrrd", VolumeFileKind::kNrrd},
                                          {".nhdr", VolumeFileKind::kDetachedNrrd},
                                          {".mha", VolumeFileKind::kMetaImage},
                                          {".raw", VolumeFileKind::kRaw}}};

std::string BaseName(const std::string& path) { return path.substr(path.rfind('/') + 1); }

const char* MetaImageTypeOf(volume::ScalarType type) {
  switch (type) {
    case volume::ScalarType::kUint8:
      return "MET_UCHAR";
    case volume::ScalarType::kInt8:
      return "MET_CHAR";
    case volume::ScalarType::kUint16:
      return "MET_USHORT";
    case volume::ScalarType::kInt16:
      return "MET_SHORT";
    case volume::ScalarType::kUint32:
      return "MET_UINT";
    case volume::ScalarType::kInt32:
      return "MET_INT";
    case volume::ScalarType::kFloat32:
      return "MET_FLOAT";
    case volume::ScalarType::kFloat64:
      return "MET_DOUBLE";
  }
  return "";
}

std::string NrrdTypeOf(volume::ScalarType type) {
  switch (type) {
    case volume::ScalarType::kFloat32:
      return "float";
    case volume::ScalarType::kFloat64:
      return "double";
    default:
      return std::string(volume::NameOf(type));
  }
}

// The labels as 3D Slicer has them in a .seg.nrrd: keys and values after the fields.
std::string SegmentsOf(const VolumeGenerator& generator) {
  constexpr double kMaxByte = 255;
  std::string text;
  for (const volume::Label& label : generator.labels()) {
    const std::string key =
        absl::StrFormat("Segment%d_", static_cast<int>(label.value) - 1);  // from 0
    const volume::LabelColor color = label.color.value_or(volume::DefaultLabelColor(label.value));
    absl::StrAppendFormat(
        &text, "%sID:=%s%d\n%sName:=%s\n%sColor:=%.6g %.6g %.6g\n%sLabelValue:=%g\n%sLayer:=0\n",
        key, "Segment_", static_cast<int>(label.value), key, label.name, key, color.red / kMaxByte,
        color.green / kMaxByte, color.blue / kMaxByte, key, label.value, key);
  }
  return text;
}

// NRRD: http://teem.sourceforge.net/nrrd/format.html. `data_file`: "" if the samples follow.
std::string NrrdHeader(const VolumeGenerator& generator, const VolumeFileOptions& options,
                       const std::string& data_file) {
  const math::Index3& dims = generator.dims();
  const math::Vec3d& s = options.spacing;
  const math::Vec3d& o = options.origin;
  return absl::StrFormat(
      "NRRD0004\ntype: %s\ndimension: 3\nspace dimension: 3\nsizes: %d %d %d\n"
      "space directions: (%.17g,0,0) (0,%.17g,0) (0,0,%.17g)\nspace origin: (%.17g,%.17g,%.17g)\n"
      "kinds: domain domain domain\nendian: little\nencoding: raw\n%s%s\n",
      NrrdTypeOf(generator.type()), dims.x, dims.y, dims.z, s.x, s.y, s.z, o.x, o.y, o.z,
      data_file.empty() ? "" : absl::StrCat("data file: ", data_file, "\n"), SegmentsOf(generator));
}

// MetaImage: https://itk.org/Wiki/ITK/MetaIO/Documentation.
std::string MetaImageHeader(const VolumeGenerator& generator, const VolumeFileOptions& options) {
  const math::Index3& dims = generator.dims();
  const math::Vec3d& s = options.spacing;
  const math::Vec3d& o = options.origin;
  return absl::StrFormat(
      "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
      "CompressedData = False\nTransformMatrix = 1 0 0 0 1 0 0 0 1\n"
      "Offset = %.17g %.17g %.17g\nElementSpacing = %.17g %.17g %.17g\nDimSize = %d %d %d\n"
      "ElementType = %s\nElementDataFile = LOCAL\n",
      o.x, o.y, o.z, s.x, s.y, s.z, dims.x, dims.y, dims.z, MetaImageTypeOf(generator.type()));
}

absl::StatusOr<std::unique_ptr<io::AtomicFile>> CreateVolumeFile(const std::string& path) {
  ISOSCOPE_RETURN_IF_ERROR(CheckNoFolder(path));
  return io::AtomicFile::Create(path);
}

absl::Status WriteSamples(const VolumeGenerator& generator, const VolumeFileOptions& options,
                          const base::Cancellation& cancellation, io::AtomicFile* file) {
  const RowSource rows{
      .row_count = generator.row_count(),
      .row_bytes = generator.dims().x * static_cast<std::int64_t>(volume::SizeOf(generator.type())),
      .fill = [&generator](std::int64_t begin, std::int64_t end, char* out) {
        generator.FillRows(begin, end, out);
      }};
  std::int64_t done_bytes = 0;
  const auto append = [&](absl::string_view bytes) {
    absl::Status status = file->Append(bytes);
    done_bytes += static_cast<std::int64_t>(bytes.size());
    if (options.progress) {
      options.progress(done_bytes, rows.row_count * rows.row_bytes);
    }
    return status;
  };
  return AppendRows(rows, append, cancellation);
}

}  // namespace

absl::StatusOr<VolumeFileKind> VolumeFileKindOf(const std::string& path) {
  for (const Ending& ending : kEndings) {
    if (absl::EndsWithIgnoreCase(path, ending.text) && BaseName(path) != ending.text) {
      return ending.kind;
    }
  }
  return absl::InvalidArgumentError(absl::StrCat(
      path,
      ": unknown kind of volume file; expected a name that ends in .nrrd, .nhdr (with the "
      "samples in a .raw beside it), .mha or .raw"));
}

absl::StatusOr<std::int64_t> WriteVolumeFile(const VolumeGenerator& generator,
                                             const VolumeFileOptions& options,
                                             const base::Cancellation& cancellation) {
  ISOSCOPE_ASSIGN_OR_RETURN(const VolumeFileKind kind, VolumeFileKindOf(options.path));
  volume::GridGeometry geometry;
  geometry.sample_dims = generator.dims();
  geometry.spacing = options.spacing;
  geometry.origin = options.origin;
  ISOSCOPE_RETURN_IF_ERROR(volume::Validate(geometry));
  const std::int64_t sample_bytes =
      math::Volume(generator.dims()) * static_cast<std::int64_t>(volume::SizeOf(generator.type()));
  ISOSCOPE_RETURN_IF_ERROR(CheckFreeSpace(options.path, sample_bytes,
                                          "free some, or give smaller --dims or a smaller --type"));

  std::string data_path = options.path;
  std::unique_ptr<io::AtomicFile> header;
  if (kind == VolumeFileKind::kDetachedNrrd) {
    data_path = options.path.substr(0, options.path.size() - 5) + ".raw";
    ISOSCOPE_ASSIGN_OR_RETURN(header, CreateVolumeFile(options.path));
    ISOSCOPE_RETURN_IF_ERROR(header->Append(NrrdHeader(generator, options, BaseName(data_path))));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::AtomicFile> data,
                            CreateVolumeFile(data_path));
  if (kind == VolumeFileKind::kNrrd) {
    ISOSCOPE_RETURN_IF_ERROR(data->Append(NrrdHeader(generator, options, "")));
  } else if (kind == VolumeFileKind::kMetaImage) {
    ISOSCOPE_RETURN_IF_ERROR(data->Append(MetaImageHeader(generator, options)));
  }
  ISOSCOPE_RETURN_IF_ERROR(WriteSamples(generator, options, cancellation, data.get()));
  ISOSCOPE_RETURN_IF_ERROR(data->Commit());
  if (header != nullptr) {
    ISOSCOPE_RETURN_IF_ERROR(header->Commit());
  }
  return sample_bytes;
}

}  // namespace isoscope::source
