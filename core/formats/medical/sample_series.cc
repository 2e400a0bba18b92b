// The header of an NRRD or MetaImage file becomes a FileLayout, which MakeLayoutSeries opens.
//
// NRRD, by its axes:
//
//   three, or more of one sample each   one volume
//   a fourth that is not of space       first or last: steps if its kind is time, else components
//   others                              refused
//
// MetaImage: the fourth number of DimSize counts steps, ElementNumberOfChannels counts components.
// A file has one of both. Sources: http://teem.sourceforge.net/nrrd/format.html;
// https://itk.org/Wiki/MetaIO/Documentation.

#include "core/formats/medical/sample_series.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/status_macros.h"
#include "core/formats/medical/meta_image_grid.h"
#include "core/formats/medical/nrrd_grid.h"
#include "core/formats/medical/nrrd_layout.h"
#include "core/source/adapt/wide_source.h"

namespace isoscope::source {
namespace {

void TakeGrid(NrrdGrid grid, FileLayout* layout) {
  layout->geometry = grid.geometry;
  layout->patient_frame = grid.patient_frame;
  layout->length_unit = std::move(grid.length_unit);
  layout->faults = std::move(grid.faults);
}

absl::Status NoVolume(const std::vector<std::int64_t>& sizes, const std::string& path) {
  return absl::InvalidArgumentError(
      absl::StrCat(path, ": ", sizes.size(), "-dimensional, ", absl::StrJoin(sizes, " x "),
                   " samples; expected one three-dimensional volume",
                   sizes.size() < 3 ? ", of 2 samples or more along each of three axes"
                                    : ": extract one (time step, channel)"));
}

// Takes the first three axes as one volume. The header need not say that they are of space, but
// must not say that one of them is a list of values.
absl::Status TakeNrrdVolume(const HeaderFields& fields, const NrrdAxisLists& lists,
                            const std::string& path, FileLayout* layout) {
  for (std::size_t axis = 0; axis < 3 && !lists.kinds.empty(); ++axis) {
    const std::string& kind = lists.kinds[axis];
    if (!IsNrrdKindOfSpace(kind) && !absl::EqualsIgnoreCase(kind, "time")) {
      return NrrdError(path, absl::StrFormat("axis %d of %s samples is of kind \"%s\", not of "
                                             "space; expected three axes of space",
                                             axis, absl::StrJoin(lists.sizes, " x "), kind));
    }
  }
  ISOSCOPE_ASSIGN_OR_RETURN(NrrdGrid grid, ReadNrrdGrid(fields, lists, 0, path));
  grid.length_unit.clear();  // as of all files of one volume
  TakeGrid(std::move(grid), layout);
  return absl::OkStatus();
}

absl::Status TakeNrrdVolumes(const std::string& path, FileLayout* layout) {
  ISOSCOPE_ASSIGN_OR_RETURN(NrrdLayout nrrd, ReadNrrdLayout(path));
  TakeGrid(std::move(nrrd.grid), layout);
  const std::int64_t others = nrrd.tuples * nrrd.volumes;
  (nrrd.is_time ? layout->steps : layout->components) = others;
  layout->location.volume_count = nrrd.volumes;
  layout->location.components = nrrd.tuples;
  layout->first_time = nrrd.first_time;
  layout->interval = nrrd.interval;
  layout->time_unit = nrrd.time_unit;
  layout->sample_unit = nrrd.sample_unit;
  return absl::OkStatus();
}

absl::StatusOr<FileLayout> NrrdFileLayout(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const HeaderFields fields, ReadNrrdFields(path));
  ISOSCOPE_ASSIGN_OR_RETURN(const NrrdAxisLists lists, ReadNrrdLists(fields, path));
  const std::vector<std::int64_t>& sizes = lists.sizes;
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::int64_t dimension,
      fields.GetInteger("dimension", static_cast<std::int64_t>(sizes.size())));
  if (dimension != static_cast<std::int64_t>(sizes.size())) {
    return NrrdError(path, absl::StrFormat("dimension %d with sizes \"%s\"; expected as many sizes",
                                           dimension, fields.Get("sizes")));
  }
  if (sizes.size() < 3 ||
      (sizes.size() > 4 && *std::max_element(sizes.begin() + 3, sizes.end()) > 1)) {
    return NoVolume(sizes, path);
  }
  const std::optional<NrrdSampleType> type = NrrdTypeFromName(fields.Get("type"));
  if (!type.has_value()) {
    return NrrdError(path, absl::StrFormat("samples of type \"%s\"; expected integers of 8 to 64 "
                                           "bits, float or double",
                                           fields.Get("type")));
  }
  FileLayout layout;
  const bool has_others = sizes.size() == 4 && (sizes[3] != 1 || !IsNrrdAxisOfSpace(lists, 0));
  ISOSCOPE_RETURN_IF_ERROR(has_others ? TakeNrrdVolumes(path, &layout)
                                      : TakeNrrdVolume(fields, lists, path, &layout));
  ISOSCOPE_ASSIGN_OR_RETURN(SampleLocation location, LocateNrrdSamples(path));
  location.volume_count = layout.location.volume_count;
  location.components = layout.location.components;
  location.stored_type = type->scalar;
  layout.wide = type->wide;
  if (layout.wide.has_value() && location.encoding == SampleEncoding::kText) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: 64-bit integers as text; expected encoding raw, gzip, bzip2 or hex: "
                        "convert it (unu save -e gzip)",
                        path));
  }
  layout.location = std::move(location);
  return layout;
}

std::optional<volume::ScalarType> MetaImageType(const std::string& name) {
  using volume::ScalarType;
  constexpr std::array<std::pair<const char*, ScalarType>, 8> kTypes{
      {{"MET_UCHAR", ScalarType::kUint8},
       {"MET_CHAR", ScalarType::kInt8},
       {"MET_USHORT", ScalarType::kUint16},
       {"MET_SHORT", ScalarType::kInt16},
       {"MET_UINT", ScalarType::kUint32},
       {"MET_INT", ScalarType::kInt32},
       {"MET_FLOAT", ScalarType::kFloat32},
       {"MET_DOUBLE", ScalarType::kFloat64}}};
  for (const auto& [known, type] : kTypes) {
    if (name == known) {
      return type;
    }
  }
  return std::nullopt;
}

absl::StatusOr<FileLayout> MetaImageFileLayout(const std::string& path, const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(SampleLocation location, LocateMetaImageSamples(path));
  FileLayout layout;
  ISOSCOPE_ASSIGN_OR_RETURN(layout.geometry, ReadMetaImageGrid(path, rules));
  ISOSCOPE_ASSIGN_OR_RETURN(const HeaderFields fields, ReadMetaImageFields(path));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<std::int64_t> sizes, fields.GetIntegers("dimsize"));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::int64_t components,
                            fields.GetInteger("elementnumberofchannels", 1));
  const std::optional<volume::ScalarType> type = MetaImageType(fields.Get("elementtype"));
  if (!type.has_value() || components < 1 || *std::min_element(sizes.begin(), sizes.end()) < 1) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: DimSize = %s, ElementType = %s, ElementNumberOfChannels = %d; expected 1 or more, and "
        "MET_CHAR, MET_UCHAR, MET_SHORT, MET_USHORT, MET_INT, MET_UINT, MET_FLOAT or MET_DOUBLE: "
        "convert the file",
        path, fields.Get("dimsize"), fields.Get("elementtype"), components));
  }
  const bool has_steps = sizes.size() == 4 && sizes[3] > 1;
  const bool has_more = sizes.size() > 4 && *std::max_element(sizes.begin() + 3, sizes.end()) > 1;
  if (has_more || (has_steps && components > 1)) {
    return NoVolume(sizes, path);
  }
  if (has_steps) {  // numbered: nothing says that the fourth axis is time
    layout.steps = sizes[3];
    location.volume_count = layout.steps;
  }
  layout.components = components;
  location.stored_type = *type;
  location.components = components;
  layout.location = std::move(location);
  return layout;
}

absl::StatusOr<FileLayout> LayoutOfFile(FileFormat format, const std::string& path,
                                        const GridRules& rules) {
  switch (format) {
    case FileFormat::kNrrd:
      return NrrdFileLayout(path);
    case FileFormat::kMetaImage:
      return MetaImageFileLayout(path, rules);
  }
  return absl::InternalError("file format out of range");
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenSampleSeries(FileFormat format,
                                                               const std::string& header_path,
                                                               const std::string& path,
                                                               const std::string& field,
                                                               const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(FileLayout layout, LayoutOfFile(format, header_path, rules));
  return MakeLayoutSeries(path, field, std::move(layout), rules);
}

}  // namespace isoscope::source
