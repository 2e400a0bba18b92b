#include "client-cli/session/source_flags.h"

#include <limits>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "clients/cpp/request/parse_value.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"
#include "core/io/file.h"
#include "core/source/dicom_folder.h"
#include "core/source/hdf5_source.h"
#include "core/source/label_names.h"
#include "core/source/refused_formats.h"
#include "core/source/series_format.h"
#include "core/source/source_labels.h"
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

absl::StatusOr<std::int64_t> ParseStride(absl::string_view text) {
  constexpr std::int64_t kMaxStride = std::int64_t{1} << 24;
  return client::ParseInteger(text, 1, kMaxStride);
}

absl::StatusOr<std::string> ParseFormatName(absl::string_view text) {
  const std::string name = absl::AsciiStrToLower(text);
  std::vector<std::string> names;
  for (const source::FormatName& known : source::FormatNames()) {
    if (known.is_forceable && known.name == name) {
      return name;
    }
    if (known.is_forceable) {
      names.push_back(known.name);
    }
  }
  return absl::InvalidArgumentError(
      absl::StrCat("'", text, "' is no format; known are ", absl::StrJoin(names, ", ")));
}

}  // namespace

const char* SourceFlags::FirstGiven() const {
  const char* const raw = FirstOfRaw();
  return raw != nullptr  ? raw
         : format        ? "--format"
         : dicom_series  ? "--series"
         : crop          ? "--crop"
         : stride        ? "--stride"
         : fill          ? "--fill"
         : ignores_shear ? "--ignore-shear"
         : resamples     ? "--resample"
         : label_names   ? "--label-names"
                         : nullptr;
}

const char* SourceFlags::FirstOfRaw() const {
  return dims            ? "--dims"
         : type          ? "--type"
         : spacing       ? "--spacing"
         : origin        ? "--origin"
         : is_big_endian ? "--endian"
         : header_bytes  ? "--header-bytes"
                         : nullptr;
}

void AddSourceFlags(FlagSet* set, SourceFlags* flags, const std::string& format_flag) {
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
  const auto of_any = [](Flag flag) { flag.Group("Parts of a source"); };
  of_any(AddFlag(set, "--crop", "X0:X1,Y0:Y1,Z0:Z1", &flags->crop, source::ParseSampleBox,
                 "samples X0 to X1 - 1 of each axis, in place of all; they keep their positions"));
  of_any(AddFlag(set, "--stride", "N", &flags->stride, ParseStride,
                 "every Nth sample on each axis; values are picked, not averaged"));
  of_any(AddFlag(set, "--fill", "VALUE", &flags->fill, client::ParseNumber,
                 "samples of this value become NaN: holes in the surface"));
  of_any(set->AddSwitch("--ignore-shear", &flags->ignores_shear,
                        "take the nearest right angles where the axes of the source have none"));
  of_any(set->AddSwitch("--resample", &flags->resamples,
                        "interpolate samples at uneven distances onto even ones"));
  of_any(AddFlag(set, "--series", "N|UID", &flags->dicom_series, ParseText,
                 "which DICOM series of the folder, by number or UID ('isoscope info FOLDER' lists "
                 "them)"));
  of_any(
      AddFlag(set, format_flag, "NAME", &flags->format, ParseFormatName,
              "read the file as this format ('isoscope info --list-formats' lists them; default: "
              "as the name says, else the content)"));
  of_any(AddFlag(set, "--label-names", "FILE", &flags->label_names, ParseText,
                 "names and colours of sample values, in place of those of the file: lines of a "
                 "FreeSurfer colour table, of an ITK-SNAP label description, or "
                 "VALUE,NAME[,#rrggbb]"));
}

bool HasSelfDescribingName(const std::string& path) {
  source::Hdf5Path hdf5;
  source::PartPath vti;
  if (source::SplitHdf5Path(path, &hdf5) || source::SplitVtiPath(path, &vti)) {
    return true;
  }
  if (source::FindSeriesFileByName(path).has_value()) {
    return true;
  }
  const std::string name = absl::AsciiStrToLower(path);
  for (const char* ending : {".nii", ".nii.gz", ".hdr", ".hdr.gz", ".img", ".img.gz", ".nrrd",
                             ".nhdr", ".mha", ".mhd", ".vti", ".dcm", ".tif", ".tiff"}) {
    if (absl::EndsWith(name, ending)) {
      return true;
    }
  }
  return false;
}

absl::Status CheckUsage(const SourceFlags& flags, const std::string& path) {
  const char* given = flags.FirstOfRaw();
  if (given == nullptr) {
    return absl::OkStatus();
  }
  if (flags.format || flags.dicom_series) {
    return UsageError(absl::StrCat(given, " is for raw files only; it can't be used with ",
                                   flags.format ? "--format" : "--series"));
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

absl::Status CheckUsageWithDataset(const SourceFlags& flags, const std::string& directory) {
  const char* const given = flags.FirstGiven();
  return given == nullptr
             ? absl::OkStatus()
             : UsageError(absl::StrCat(
                   given, " is for a volume; '", directory, "' is a dataset, which has the ",
                   absl::string_view(given) == "--label-names" ? "names" : "samples",
                   " it was made with: partition the volume anew with this flag"));
}

absl::StatusOr<std::string> PathOfSource(const SourceFlags& flags, const std::string& path) {
  // Rules name the series of a path that is DICOM. Else the folder may hold one beside other files.
  return flags.dicom_series && !source::NamesDicomSeries(path)
             ? source::FindDicomSeriesFile(path, *flags.dicom_series)
             : absl::StatusOr<std::string>(path);
}

absl::StatusOr<std::unique_ptr<source::VolumeSource>> OpenSource(const SourceFlags& flags,
                                                                 const std::string& path) {
  if (!flags.dims) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string file, PathOfSource(flags, path));
    ISOSCOPE_ASSIGN_OR_RETURN(
        std::unique_ptr<source::VolumeSource> volume,
        source::OpenVolumeFile(file, flags.format.value_or(""), flags.rules()));
    return source::AdjustSource(std::move(volume), flags.adjustment());
  }
  ISOSCOPE_ASSIGN_OR_RETURN(
      std::unique_ptr<source::VolumeSource> volume,
      source::OpenRawFile(path,
                          source::RawFormat{.dims = *flags.dims,
                                            .type = flags.type.value_or(volume::ScalarType::kUint8),
                                            .is_big_endian = flags.is_big_endian.value_or(false),
                                            .header_bytes = flags.header_bytes.value_or(0),
                                            .spacing = flags.spacing.value_or(math::Vec3d{1, 1, 1}),
                                            .origin = flags.origin.value_or(math::Vec3d{})}));
  return source::AdjustSource(std::move(volume), flags.adjustment());
}

absl::StatusOr<std::vector<std::string>> SourceFiles(const SourceFlags& flags,
                                                     const std::string& path) {
  std::vector<std::string> names;
  if (flags.label_names) {
    names.push_back(*flags.label_names);
  }
  if (flags.dims) {
    names.insert(names.begin(), path);
    return names;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string file, PathOfSource(flags, path));
  absl::StatusOr<std::vector<std::string>> files =
      source::FilesOfVolume(file, flags.format.value_or(""), flags.rules());
  if (files.ok()) {
    files->insert(files->end(), names.begin(), names.end());
  }
  if (!files.ok() && io::IsDirectory(path) && !source::WhyRefused(path).has_value()) {
    return absl::NotFoundError(
        absl::StrCat("'", path, "' holds no finished dataset, no slices and no DICOM series",
                     store::IsShardDirectory(path) ? "; it is one shard: isoscope-agent serves it"
                                                   : "; 'isoscope partition' makes a dataset"));
  }
  return files;
}

absl::StatusOr<std::vector<volume::Label>> LabelsOfSource(const SourceFlags& flags,
                                                          const std::string& path,
                                                          std::ostream* err) {
  if (flags.label_names) {
    return source::ReadLabelNames(*flags.label_names);
  }
  if (flags.dims) {
    return std::vector<volume::Label>();
  }
  std::string file = path;
  if (flags.dicom_series) {
    ISOSCOPE_ASSIGN_OR_RETURN(file, source::FindDicomSeriesFile(path, *flags.dicom_series));
  }
  absl::StatusOr<std::vector<volume::Label>> labels = source::ReadSourceLabels(file);
  if (labels.ok()) {
    return labels;
  }
  if (err != nullptr) {
    *err << "isoscope: the names of labels are not used: " << labels.status().message()
         << std::endl;
  }
  return std::vector<volume::Label>();
}

std::string ListFormats() {
  std::string text;
  for (const source::FormatName& format : source::FormatNames()) {
    absl::StrAppend(&text, absl::StrFormat("%-14s %s%s\n", format.name, format.files,
                                           format.is_forceable ? "" : " (by name only)"));
  }
  return absl::StrCat(text,
                      absl::StrFormat("%-14s %s\n", "raw", "any file, with --dims and --type"));
}

std::string DescribeForKey(const SourceFlags& flags) {
  std::string parts;  // keys of volumes without these flags stay as they were
  if (flags.crop) {
    absl::StrAppend(&parts, " crop ", flags.crop->begin.x, ":", flags.crop->end.x, ",",
                    flags.crop->begin.y, ":", flags.crop->end.y, ",", flags.crop->begin.z, ":",
                    flags.crop->end.z);
  }
  if (flags.stride) {
    absl::StrAppend(&parts, " stride ", *flags.stride);
  }
  if (flags.fill) {
    absl::StrAppend(&parts, absl::StrFormat(" fill %a", *flags.fill));
  }
  if (flags.label_names) {
    absl::StrAppend(&parts, " label-names");  // the file is among SourceFiles
  }
  absl::StrAppend(&parts, flags.ignores_shear ? " ignore-shear" : "",
                  flags.resamples ? " resample" : "");
  if (flags.format || flags.dicom_series) {
    absl::StrAppend(&parts, " format ", flags.format.value_or(""), " series ",
                    flags.dicom_series.value_or(""));
  }
  if (!flags.dims) {
    return absl::StrCat("self-describing", parts);
  }
  const math::Vec3d spacing = flags.spacing.value_or(math::Vec3d{1, 1, 1});
  const math::Vec3d origin = flags.origin.value_or(math::Vec3d{});
  return absl::StrFormat(
      "raw %d,%d,%d %s %a,%a,%a %a,%a,%a %d %d%s", flags.dims->x, flags.dims->y, flags.dims->z,
      volume::NameOf(flags.type.value_or(volume::ScalarType::kUint8)), spacing.x, spacing.y,
      spacing.z, origin.x, origin.y, origin.z, flags.is_big_endian.value_or(false) ? 1 : 0,
      flags.header_bytes.value_or(0), parts);
}

}  // namespace isoscope::cli
