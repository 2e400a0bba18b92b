// The flags that say how a file is read. They are declared in three groups (raw files, world
// positions, parts of a source), become an OpenRequest (RequestOf), and are typed again in advice
// (AsTyped). A new flag must stand in all of AddSourceFlags, FirstGiven, RequestOf and AsTyped.
//
// CheckUsage knows only names and flags. Errors that need the content come from the reader.

#include "client-cli/session/source_flags.h"

#include <cstddef>
#include <limits>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"

#include "clients/cpp/request/parse_value.h"
#include "core/base/printable.h"
#include "core/base/shell_word.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/format.h"
#include "core/cli/usage.h"
#include "core/formats/address_source.h"
#include "core/formats/find_volume.h"
#include "core/formats/format_table.h"
#include "core/formats/label_names.h"
#include "core/formats/refused_formats.h"
#include "core/formats/source_labels.h"
#include "core/io/file.h"
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

// Letters, each once, or -, those of TIFF's pages with counts; the reader checks what its file can
// have.
absl::StatusOr<std::string> ParseAxes(absl::string_view text) {
  std::string letters;
  bool is_good = !text.empty();
  for (const char c : text) {
    const bool is_digit = absl::ascii_isdigit(static_cast<unsigned char>(c));
    is_good =
        is_good &&
        (is_digit ? !letters.empty()
                  : c == '-' || (absl::string_view("TCZYX").find(c) != absl::string_view::npos &&
                                 letters.find(c) == std::string::npos));
    if (!is_digit) {
      letters += c;
    }
  }
  if (!is_good) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", text,
                     "' is no list of axes, slowest first, such as ZYX, TZYX or TCZYX, or TC3Z20 "
                     "for the pages of a TIFF stack"));
  }
  return std::string(text);
}

// Rows; the matrix has columns.
absl::StatusOr<math::Mat3d> ParseDirection(absl::string_view text) {
  const std::vector<absl::string_view> parts = absl::StrSplit(text, ',');
  math::Mat3d matrix;
  bool is_good = parts.size() == 9;
  for (std::size_t i = 0; is_good && i < parts.size(); ++i) {
    const absl::StatusOr<double> number = client::ParseNumber(parts[i]);
    is_good = number.ok();
    matrix.columns[i % 3][static_cast<int>(i / 3)] = number.value_or(0);
  }
  if (!is_good) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", text,
                     "' is not nine numbers, the rows of a matrix whose columns are the directions "
                     "of the axes x, y and z: as they are, 1,0,0,0,1,0,0,0,1"));
  }
  const absl::Status valid = source::Validate(source::GridOverride{.direction = matrix});
  if (!valid.ok()) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", text, "': ", absl::StripPrefix(valid.message(), "--direction: ")));
  }
  return matrix;
}

// In as few digits as tell it.
std::string Typed(double number) {
  std::string text = absl::StrFormat("%.15g", number);
  double read = 0;
  return absl::SimpleAtod(text, &read) && read == number ? text : absl::StrFormat("%.17g", number);
}

std::string Typed(const math::Vec3d& v) {
  return absl::StrCat(Typed(v.x), ",", Typed(v.y), ",", Typed(v.z));
}

std::string Typed(const source::SampleBox& box) {
  std::vector<std::string> axes;
  for (int axis = 0; axis < 3; ++axis) {
    const bool is_open = box.end[axis] == std::numeric_limits<std::int64_t>::max();
    axes.push_back(absl::StrCat(box.begin[axis], ":", is_open ? "" : absl::StrCat(box.end[axis])));
  }
  return absl::StrJoin(axes, ",");
}

}  // namespace

const char* SourceFlags::FirstGiven() const {
  const char* const raw = FirstOfRaw();
  return raw != nullptr  ? raw
         : format        ? names.format.c_str()
         : dicom_series  ? "--series"
         : axes          ? names.axes.c_str()
         : spacing       ? "--spacing"
         : origin        ? "--origin"
         : direction     ? "--direction"
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
         : is_big_endian ? "--endian"
         : header_bytes  ? "--header-bytes"
                         : nullptr;
}

void AddSourceFlags(FlagSet* set, SourceFlags* flags, const SourceFlagNames& names) {
  flags->names = names;
  const auto add = [](Flag flag) { flag.Group("Raw files"); };
  add(AddFlag(set, "--dims", "X,Y,Z", &flags->dims, client::ParseDims,
              "samples on each axis, x fastest"));
  add(AddFlag(set, "--type", "TYPE", &flags->type, volume::ScalarTypeFromName,
              "uint8, int8, uint16, int16, uint32, int32, float32 or float64"));
  add(AddFlag(set, "--endian", "little|big", &flags->is_big_endian, ParseIsBigEndian,
              "byte order (default: little)"));
  add(AddFlag(set, "--header-bytes", "N", &flags->header_bytes, ParseHeaderBytes,
              "bytes before the first sample (default: 0)"));
  const auto in_grid_group = [](Flag flag) {
    flag.Group("World positions, in place of the file's");
  };
  in_grid_group(
      AddFlag(set, "--spacing", "X,Y,Z", &flags->spacing, client::ParsePositiveVector,
              "world units between samples of the file, before --crop and --stride (default: "
              "as the file says; of a raw file 1,1,1)"));
  in_grid_group(
      AddFlag(set, "--origin", "X,Y,Z", &flags->origin, client::ParseVector,
              "world position of the first sample of the file (default: as the file says; of a "
              "raw file 0,0,0)"));
  in_grid_group(
      AddFlag(set, "--direction", "XX,XY,XZ,YX,...", &flags->direction, ParseDirection,
              "world directions of the axes: nine numbers, row by row, as ITK and VTK have "
              "them; each column is an axis, of length 1 (default: as the file says)"));
  const auto in_source_group = [](Flag flag) { flag.Group("Parts of a source"); };
  in_source_group(
      AddFlag(set, "--crop", "X0:X1,Y0:Y1,Z0:Z1", &flags->crop, source::ParseSampleBox,
              "samples X0 to X1 - 1 of each axis, in place of all; they keep their positions"));
  in_source_group(AddFlag(set, "--stride", "N", &flags->stride, ParseStride,
                          "every Nth sample on each axis; values are picked, not averaged"));
  in_source_group(AddFlag(set, "--fill", "VALUE", &flags->fill, client::ParseNumber,
                          "samples of this value become NaN: holes in the surface"));
  in_source_group(
      set->AddSwitch("--ignore-shear", &flags->ignores_shear,
                     "take the nearest right angles where the axes of the source have none"));
  in_source_group(set->AddSwitch("--resample", &flags->resamples,
                                 "interpolate samples at uneven distances onto even ones"));
  in_source_group(
      AddFlag(set, "--series", "N|UID", &flags->dicom_series, ParseText,
              "which DICOM series of the folder, by number or UID ('isoscope info FOLDER' lists "
              "them)"));
  in_source_group(
      AddFlag(set, names.axes, "AXES", &flags->axes, ParseAxes,
              "the axes of an HDF5 dataset or a netCDF variable, slowest first, of the letters "
              "T (time), C (component), Z, Y, X, and - for one of 1 element; for the pages of a "
              "TIFF stack T, C and Z with counts, as TC3Z20 (default: as the file says)"));
  in_source_group(
      AddFlag(set, names.format, "NAME", &flags->format, ParseFormatName,
              "read the file as this format ('isoscope info --list-formats' lists them; default: "
              "as the name says, else the content)"));
  in_source_group(
      AddFlag(set, "--label-names", "FILE", &flags->label_names, ParseText,
              "names and colours of sample values, in place of those of the file: lines of a "
              "FreeSurfer colour table, of an ITK-SNAP label description, of a list of MRIcron, or "
              "VALUE,NAME[,#rrggbb]"));
}

absl::StatusOr<std::string> ParseSource(absl::string_view text) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string given, ParseText(text));
  return source::PathOfSource(given);
}

absl::Status CheckUsage(const SourceFlags& flags, const std::string& path) {
  const char* given = flags.FirstOfRaw();
  if (given == nullptr) {
    return absl::OkStatus();
  }
  if (flags.format || flags.dicom_series || flags.axes) {
    return UsageError(absl::StrCat(given, " is for raw files only; it can't be used with ",
                                   flags.format         ? flags.names.format
                                   : flags.dicom_series ? "--series"
                                                        : flags.names.axes));
  }
  if (source::NamesFormat(path)) {
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

source::OpenRequest RequestOf(const SourceFlags& flags, const std::string& path) {
  source::OpenRequest request{
      .path = path,
      .format = flags.format.value_or(""),
      .dicom_series = flags.dicom_series.value_or(""),
      .axes = flags.axes.value_or(""),
      .ignores_shear = flags.ignores_shear,
      .resamples = flags.resamples,
      .grid = {.spacing = flags.spacing, .origin = flags.origin, .direction = flags.direction},
      .crop = flags.crop,
      .stride = flags.stride.value_or(1),
      .fill = flags.fill,
      .label_names = flags.label_names.value_or("")};
  if (flags.dims) {
    request.raw = source::RawFormat{.dims = *flags.dims,
                                    .type = flags.type.value_or(volume::ScalarType::kUint8),
                                    .is_big_endian = flags.is_big_endian.value_or(false),
                                    .header_bytes = flags.header_bytes.value_or(0)};
  }
  return request;
}

std::string AsTyped(const SourceFlags& flags, const SourceFlagNames& names) {
  std::string text;
  const auto add = [&text](absl::string_view flag, const std::string& value) {
    absl::StrAppend(&text, " ", flag, value.empty() ? "" : " ", value);
  };
  if (flags.dims) {
    add("--dims", absl::StrCat(flags.dims->x, ",", flags.dims->y, ",", flags.dims->z));
  }
  if (flags.type) {
    add("--type", std::string(volume::NameOf(*flags.type)));
  }
  if (flags.is_big_endian) {
    add("--endian", *flags.is_big_endian ? "big" : "little");
  }
  if (flags.header_bytes) {
    add("--header-bytes", absl::StrCat(*flags.header_bytes));
  }
  if (flags.format) {
    add(names.format, *flags.format);
  }
  if (flags.dicom_series) {
    add("--series", base::ShellWord(*flags.dicom_series));
  }
  if (flags.axes) {
    add(names.axes, *flags.axes);
  }
  if (flags.spacing) {
    add("--spacing", Typed(*flags.spacing));
  }
  if (flags.origin) {
    add("--origin", Typed(*flags.origin));
  }
  if (flags.direction) {
    const math::Mat3d rows = math::Transposed(*flags.direction);
    add("--direction", absl::StrCat(Typed(rows.columns[0]), ",", Typed(rows.columns[1]), ",",
                                    Typed(rows.columns[2])));
  }
  if (flags.crop) {
    add("--crop", Typed(*flags.crop));
  }
  if (flags.stride) {
    add("--stride", absl::StrCat(*flags.stride));
  }
  if (flags.fill) {
    add("--fill", Typed(*flags.fill));
  }
  if (flags.ignores_shear) {
    add("--ignore-shear", "");
  }
  if (flags.resamples) {
    add("--resample", "");
  }
  if (flags.label_names) {
    add("--label-names", base::ShellWord(*flags.label_names));
  }
  return text;
}

absl::StatusOr<std::vector<std::string>> SourceFiles(const source::OpenRequest& request) {
  absl::StatusOr<std::vector<std::string>> files = source::FilesOf(request);
  const std::string& path = request.path;
  if (absl::IsNotFound(files.status()) && io::IsDirectory(path) && request.dicom_series.empty()) {
    const std::string volumes = source::ListVolumesIn(path);
    return absl::NotFoundError(absl::StrCat(
        "'", path, "' holds no finished dataset, no slices and no DICOM series",
        store::IsShardDirectory(path) ? "; it is one shard: isoscope-agent serves it"
        : volumes.empty()             ? "; 'isoscope partition' makes a dataset"
                          : absl::StrCat("; it holds ", volumes, ": give such a file")));
  }
  return files;
}

absl::StatusOr<std::vector<volume::Label>> LabelsOfSource(const source::OpenRequest& request,
                                                          std::ostream* err) {
  if (!request.label_names.empty()) {
    return source::ReadLabelNames(request.label_names);
  }
  if (request.raw.has_value()) {
    return std::vector<volume::Label>();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string file, source::PathOfLabels(request));
  absl::StatusOr<std::vector<volume::Label>> labels = source::ReadSourceLabels(file);
  const std::optional<std::string> beside = source::LabelNamesBeside(file);
  if (labels.ok() && labels->empty() && beside.has_value()) {
    labels = source::ReadLabelNames(*beside);
    if (labels.ok() && err != nullptr) {
      *err << "isoscope: labels have the names of " << base::Printable(*beside) << std::endl;
    }
  }
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

}  // namespace isoscope::cli
