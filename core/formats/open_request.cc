// Open applies the members of a request in this order:
//
// 1. It finds the row of the format, by name and content; a raw file has none.
// 2. The row opens the path, under the grid rules of the request.
// 3. PlaceSeries: --spacing, --origin, --direction.
// 4. AdjustSeries: crop, stride, fill.
// 5. SelectFrom: fields, steps, names.
//
// OpenIdentified also says what the volumes were made of. Its identity is the text of Describe, one
// line a member (`stride 2`), and the stamps of all files. It stamps the files before it opens
// them, and compares whenever an identity is asked for. So a change during the work is an error.

#include "core/formats/open_request.h"

#include <algorithm>
#include <cstddef>
#include <map>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/sha256.h"
#include "core/base/status_macros.h"
#include "core/base/version.h"
#include "core/formats/address_opening.h"
#include "core/formats/address_source.h"
#include "core/formats/find_volume.h"
#include "core/formats/label_names.h"
#include "core/formats/open_volume.h"
#include "core/formats/refused_formats.h"
#include "core/formats/source_labels.h"
#include "core/io/mounted_file.h"
#include "core/source/single_series.h"
#include "core/source/source_stamps.h"

namespace isoscope::source {
namespace {

// Raised when the text itself gets another meaning.
constexpr int kDescriptionVersion = 1;

// ---- The description. Texts are quoted, so that none can pass for a line of its own. ----

std::string ExactText(const std::string& text) {
  return absl::StrCat("\"", absl::CHexEscape(text), "\"");
}
std::string ExactText(bool is_set) { return is_set ? "yes" : "no"; }
std::string ExactText(std::int64_t number) { return absl::StrCat(number); }
std::string ExactText(double number) { return absl::StrFormat("%a", number); }
std::string ExactText(const math::Index3& v) { return absl::StrCat(v.x, ",", v.y, ",", v.z); }
std::string ExactText(const math::Vec3d& v) { return absl::StrFormat("%a,%a,%a", v.x, v.y, v.z); }
std::string ExactText(const math::Mat3d& m) {
  return absl::StrCat(ExactText(m.columns[0]), ";", ExactText(m.columns[1]), ";",
                      ExactText(m.columns[2]));
}
std::string ExactText(const SampleBox& box) {
  const auto& [begin, end] = box;
  return absl::StrCat(ExactText(begin), ":", ExactText(end));
}
std::string ExactText(const StepRange& range) {
  const auto& [first, last, stride] = range;
  return absl::StrCat(first, ":", last, ":", stride);
}
std::string ExactText(const std::vector<std::string>& names) {
  return absl::StrJoin(names, ",", [](std::string* out, const std::string& name) {
    absl::StrAppend(out, ExactText(name));
  });
}
std::string ExactText(const RawFormat& raw) {
  const auto& [dims, type, is_big_endian, header_bytes] = raw;
  return absl::StrCat(ExactText(dims), " ", volume::NameOf(type), " ", ExactText(is_big_endian),
                      " ", ExactText(header_bytes));
}
template <typename T>
std::string ExactText(const std::optional<T>& value) {
  return value.has_value() ? ExactText(*value) : "none";
}
std::string ExactText(const GridOverride& grid) {
  const auto& [spacing, origin, direction] = grid;
  return absl::StrCat(ExactText(spacing), " ", ExactText(origin), " ", ExactText(direction));
}

// ---- Opening. ----------------------------------------------------------------------------------

std::string NameOfRawField(const std::string& path) {
  std::string name = path.substr(path.rfind('/') + 1);
  if (const std::size_t dot = name.rfind('.'); dot != std::string::npos && dot > 0) {
    name.resize(dot);
  }
  return name;
}

// Finds a raw file that is at an address.
absl::Status FindRaw(const std::string& path) {
  if (!io::IsAddressText(path)) {
    return absl::OkStatus();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const AddressSource found, FindAtAddress(path));
  return found.file == path && !found.is_store
             ? absl::OkStatus()
             : absl::InvalidArgumentError(
                   absl::StrCat(path, ": ", found.file,
                                " is there, which is no raw file: leave --dims and --type out"));
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenRaw(const OpenRequest& request) {
  if (!request.axes.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(request.path, ": --axes ", request.axes,
                     ": is for HDF5, netCDF and TIFF files; the samples of a raw file lie as ZYX"));
  }
  ISOSCOPE_RETURN_IF_ERROR(FindRaw(request.path));
  // Nothing takes the place of a grid that the file has: no note.
  const auto open = [path = request.path, raw = *request.raw,
                     grid = request.grid]() -> absl::StatusOr<std::unique_ptr<VolumeSource>> {
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> volume, OpenRawFile(path, raw));
    ISOSCOPE_ASSIGN_OR_RETURN(const volume::GridGeometry placed,
                              PlacedGrid(volume->info().geometry, grid, path));
    return MoveSource(std::move(volume), placed);
  };
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> volume, open());
  return MakeSingleSeries({.path = request.path,
                           .field = NameOfRawField(request.path),
                           .volume = std::move(volume),
                           .open = open});
}

// The request with the path of PathOfSource.
absl::StatusOr<OpenRequest> WithPath(const OpenRequest& request) {
  OpenRequest named = request;
  ISOSCOPE_ASSIGN_OR_RETURN(named.path, PathOfSource(request.path));
  return named;
}

// The path to open: that of the request, or that of a file of the series that dicom_series chooses
// beside files of other formats.
absl::StatusOr<std::string> PathOf(const OpenRequest& request, absl::Span<const Format> formats) {
  if (request.dicom_series.empty()) {
    return request.path;
  }
  const auto found = FindVolume(request.path, "", formats);
  const bool is_of_series = found.ok() && found->format->find_series_file != nullptr;
  return is_of_series ? absl::StatusOr<std::string>(request.path)  // its rules choose
                      : FindSeriesFile(request.path, request.dicom_series, formats);
}

SeriesOptions OptionsOf(const OpenRequest& request) {
  return {.axes = request.axes,
          .format = request.format,
          .rules = {.ignores_shear = request.ignores_shear || request.grid.direction.has_value(),
                    .resamples = request.resamples,
                    .fill = request.fill,
                    .has_spacing = request.grid.spacing.has_value(),
                    .has_origin = request.grid.origin.has_value(),
                    .has_direction = request.grid.direction.has_value(),
                    .dicom_series = request.dicom_series}};
}

// The series that knows its request. It keeps digests of the stamps of its files: at first of all
// files together. Where steps have files of their own, each step gets a digest when it is opened.
class IdentifiedSeries final : public VolumeSeries {
 public:
  // `files`: all, which had the `stamps` before the series was opened.
  IdentifiedSeries(std::unique_ptr<VolumeSeries> series, std::string description,
                   std::vector<std::string> files, absl::string_view stamps)
      : VolumeSeries(series->info()),
        series_(std::move(series)),
        description_(std::move(description)),
        all_files_(std::move(files)),
        stamps_of_all_(base::Sha256Hex(stamps)) {}
  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    if (!stamps_of_steps_.contains(step)) {
      ISOSCOPE_RETURN_IF_ERROR(IdentityOfStep(step).status());
    }
    return series_->Open(field, component, step);
  }
  absl::StatusOr<std::optional<std::vector<std::string>>> FilesOfStep(int step) override {
    return series_->FilesOfStep(step);
  }
  absl::StatusOr<std::string> IdentityOfStep(int step) override {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::optional<std::vector<std::string>> own, FilesOfStep(step));
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string stamps, StampsOf(own.value_or(all_files_)));
    const std::string& before =
        stamps_of_steps_
            .try_emplace(step, own.has_value() ? base::Sha256Hex(stamps) : stamps_of_all_)
            .first->second;
    if (base::Sha256Hex(stamps) != before) {
      return absl::AbortedError(
          absl::StrCat(info().name,
                       ": a file of it has changed since it was opened; run it again, once nobody "
                       "writes there"));
    }
    return absl::StrCat(description_, stamps);
  }

 private:
  const std::unique_ptr<VolumeSeries> series_;
  const std::string description_;
  const std::vector<std::string> all_files_;
  const std::string stamps_of_all_;             // digest
  std::map<int, std::string> stamps_of_steps_;  // digests
};

}  // namespace

absl::StatusOr<std::string> Describe(const OpenRequest& request) {
  // A new member does not compile here until it is named. Then it gets its line.
  const auto& [path, raw, format, dicom_series, axes, ignores_shear, resamples, grid, crop, stride,
               fill, fields, steps, time, label_names] = request;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string source_path, PathOfSource(path));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string resolved, ResolvedPath(source_path));
  std::string labels;
  if (!label_names.empty()) {
    ISOSCOPE_ASSIGN_OR_RETURN(labels, ResolvedPath(label_names));
  }
  std::string text =
      absl::StrCat("isoscope source ", kDescriptionVersion, "\nprogram ", base::Version(), "\n");
  const auto add = [&text](absl::string_view member, const std::string& value) {
    absl::StrAppend(&text, member, " ", value, "\n");
  };
  add("path", ExactText(resolved));
  add("raw", ExactText(raw));
  add("format", ExactText(format));
  add("dicom_series", ExactText(dicom_series));
  add("axes", ExactText(axes));
  add("ignores_shear", ExactText(ignores_shear));
  add("resamples", ExactText(resamples));
  add("grid", ExactText(grid));
  add("crop", ExactText(crop));
  add("stride", ExactText(stride));
  add("fill", ExactText(fill));
  add("fields", ExactText(fields));
  add("steps", ExactText(steps));
  add("time", ExactText(time));
  add("label_names", ExactText(labels));
  return text;
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> Open(const OpenRequest& asked,
                                                   absl::Span<const Format> formats) {
  const AddressOpening opening;
  ISOSCOPE_ASSIGN_OR_RETURN(const OpenRequest request, WithPath(asked));
  std::unique_ptr<VolumeSeries> series;
  bool has_field_names = false;
  if (request.raw.has_value()) {
    ISOSCOPE_ASSIGN_OR_RETURN(series, OpenRaw(request));
  } else {
    // 1. The row.
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string path, PathOf(request, formats));
    const SeriesOptions options = OptionsOf(request);
    auto found = FindVolume(path, options.format, formats);
    if (!found.ok()) {
      return ExplainByContent(path, found.status(), formats);
    }
    // 2. The path, and 3. its place.
    has_field_names = found->format->has_field_names;
    ISOSCOPE_ASSIGN_OR_RETURN(series, OpenFoundVolume(*std::move(found), options, formats));
    series = PlaceSeries(std::move(series), request.grid);
  }
  // 4. The samples.
  series = AdjustSeries(std::move(series), {.crop = request.crop,
                                            .stride = request.stride,
                                            .fill = request.fill,
                                            .ignores_shear = request.ignores_shear});
  // 5. The volumes.
  return SelectFrom(std::move(series), {.fields = request.fields,
                                        .names_field = !has_field_names,
                                        .steps = request.steps,
                                        .time = request.time});
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenIdentified(const OpenRequest& request,
                                                             absl::Span<const Format> formats) {
  const AddressOpening opening;
  ISOSCOPE_ASSIGN_OR_RETURN(std::string description, Describe(request));
  ISOSCOPE_ASSIGN_OR_RETURN(std::vector<std::string> files, FilesOf(request, formats));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string stamps, StampsOf(files));
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSeries> series, Open(request, formats));
  return std::make_unique<IdentifiedSeries>(std::move(series), std::move(description),
                                            std::move(files), stamps);
}

absl::StatusOr<std::vector<std::string>> FilesOf(const OpenRequest& asked,
                                                 absl::Span<const Format> formats) {
  const AddressOpening opening;
  ISOSCOPE_ASSIGN_OR_RETURN(const OpenRequest request, WithPath(asked));
  std::vector<std::string> files;
  if (request.raw.has_value()) {
    ISOSCOPE_RETURN_IF_ERROR(FindRaw(request.path));
    files = {request.path};
  } else {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string path, PathOf(request, formats));
    ISOSCOPE_ASSIGN_OR_RETURN(files, FilesOfVolume(path, OptionsOf(request), formats));
    if (std::optional<std::string> labels = FileOfSourceLabels(path, formats);
        labels.has_value() && std::find(files.begin(), files.end(), *labels) == files.end()) {
      files.push_back(*std::move(labels));
    }
    if (std::optional<std::string> names = LabelNamesBeside(path);
        names.has_value() && request.label_names.empty()) {
      files.push_back(*std::move(names));
    }
  }
  if (!request.label_names.empty()) {
    files.push_back(request.label_names);
  }
  return files;
}

absl::StatusOr<std::string> PathOfLabels(const OpenRequest& asked,
                                         absl::Span<const Format> formats) {
  ISOSCOPE_ASSIGN_OR_RETURN(const OpenRequest request, WithPath(asked));
  ISOSCOPE_ASSIGN_OR_RETURN(std::string path, PathOf(request, formats));
  return request.dicom_series.empty() ? path : FindSeriesFile(path, request.dicom_series, formats);
}

}  // namespace isoscope::source
