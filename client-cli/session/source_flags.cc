#include "client-cli/session/source_flags.h"

#include <limits>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "clients/cpp/request/parse_value.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"
#include "core/io/file.h"
#include "core/source/hdf5_source.h"
#include "core/source/vti_source.h"
#include "core/store/shard_reader.h"

namespace isoscope::cli {
namespace {

absl::StatusOr<bool> ParseIsBigEndian(absl::string_view text) {
  return client::ParseChoice<bool>(text, {{"little", false}, {"big", true}});
}

absl::StatusOr<std::int64_t> ParseHeaderBytes(absl::string_view text) {
  return client::ParseInteger(text, 0, std::numeric_limits<std::int64_t>::max());
}

}  // namespace

const char* SourceFlags::FirstGiven() const {
  return dims            ? "--dims"
         : type          ? "--type"
         : spacing       ? "--spacing"
         : origin        ? "--origin"
         : is_big_endian ? "--endian"
         : header_bytes  ? "--header-bytes"
                         : nullptr;
}

void AddSourceFlags(FlagSet* set, SourceFlags* flags) {
  const auto add = [](Flag flag) { flag.Group("Raw files"); };
  add(AddFlag(set, "--dims", "X,Y,Z", &flags->dims, client::ParseDims,
              "samples on each axis, x fastest"));
  add(AddFlag(set, "--type", "TYPE", &flags->type, volume::ScalarTypeFromName,
              "uint8, int8, uint16, int16, uint32, int32, float32 or float64"));
  add(AddFlag(set, "--spacing", "X,Y,Z", &flags->spacing, client::ParsePositiveVector,
              "world units between samples (default: 1,1,1)"));
  add(AddFlag(set, "--origin", "X,Y,Z", &flags->origin, client::ParseVector,
              "world position of the first sample (default: 0,0,0)"));
  add(AddFlag(set, "--endian", "little|big", &flags->is_big_endian, ParseIsBigEndian,
              "byte order (default: little)"));
  add(AddFlag(set, "--header-bytes", "N", &flags->header_bytes, ParseHeaderBytes,
              "bytes before the first sample (default: 0)"));
}

bool HasSelfDescribingName(const std::string& path) {
  source::Hdf5Path hdf5;
  source::PartPath vti;
  if (source::SplitHdf5Path(path, &hdf5) || source::SplitVtiPath(path, &vti)) {
    return true;
  }
  const std::string name = absl::AsciiStrToLower(path);
  for (const char* ending : {".nii", ".nii.gz", ".hdr", ".img", ".img.gz", ".nrrd", ".nhdr", ".mha",
                             ".mhd", ".vti", ".dcm", ".tif", ".tiff"}) {
    if (absl::EndsWith(name, ending)) {
      return true;
    }
  }
  return false;
}

absl::Status CheckUsage(const SourceFlags& flags, const std::string& path) {
  const char* given = flags.FirstGiven();
  if (given == nullptr) {
    return absl::OkStatus();
  }
  if (HasSelfDescribingName(path)) {
    return UsageError(absl::StrCat(given, " is for raw files only; '", path,
                                   "' carries its own dimensions and type"));
  }
  if (io::IsDirectory(path)) {
    return UsageError(absl::StrCat(given, " is for raw files only; '", path, "' is a folder"));
  }
  if (!flags.dims || !flags.type) {
    return UsageError(absl::StrCat("a raw file needs both --dims X,Y,Z and --type TYPE; ",
                                   flags.dims ? "--type" : "--dims", " is missing"));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<source::VolumeSource>> OpenSource(const SourceFlags& flags,
                                                                 const std::string& path) {
  if (!flags.dims) {
    return source::OpenVolumeFile(path);
  }
  return source::OpenRawFile(
      path, source::RawFormat{.dims = *flags.dims,
                              .type = flags.type.value_or(volume::ScalarType::kUint8),
                              .is_big_endian = flags.is_big_endian.value_or(false),
                              .header_bytes = flags.header_bytes.value_or(0),
                              .spacing = flags.spacing.value_or(math::Vec3d{1, 1, 1}),
                              .origin = flags.origin.value_or(math::Vec3d{})});
}

absl::StatusOr<std::vector<std::string>> SourceFiles(const SourceFlags& flags,
                                                     const std::string& path) {
  if (flags.dims) {
    return std::vector<std::string>{path};
  }
  absl::StatusOr<std::vector<std::string>> files = source::FilesOfVolume(path);
  if (!files.ok() && io::IsDirectory(path)) {
    return absl::NotFoundError(
        absl::StrCat("'", path, "' holds no finished dataset, no TIFF slices and no DICOM series",
                     store::IsShardDirectory(path) ? "; it is one shard: isoscope-agent serves it"
                                                   : "; 'isoscope partition' makes a dataset"));
  }
  return files;
}

std::string DescribeForKey(const SourceFlags& flags) {
  if (!flags.dims) {
    return "self-describing";
  }
  const math::Vec3d spacing = flags.spacing.value_or(math::Vec3d{1, 1, 1});
  const math::Vec3d origin = flags.origin.value_or(math::Vec3d{});
  return absl::StrFormat(
      "raw %d,%d,%d %s %a,%a,%a %a,%a,%a %d %d", flags.dims->x, flags.dims->y, flags.dims->z,
      volume::NameOf(flags.type.value_or(volume::ScalarType::kUint8)), spacing.x, spacing.y,
      spacing.z, origin.x, origin.y, origin.z, flags.is_big_endian.value_or(false) ? 1 : 0,
      flags.header_bytes.value_or(0));
}

}  // namespace isoscope::cli
