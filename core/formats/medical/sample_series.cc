#include "core/formats/medical/sample_series.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"

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

absl::StatusOr<std::optional<FileLayout>> NrrdFileLayout(const std::string& path) {
  ISOSCOPE_ASSIGN_OR_RETURN(const HeaderFields fields, ReadNrrdFields(path));
  const std::vector<std::int64_t> sizes =
      fields.GetIntegers("sizes").value_or(std::vector<std::int64_t>());
  const std::optional<NrrdSampleType> type = NrrdTypeFromName(fields.Get("type"));
  FileLayout layout;
  if (sizes.size() == 4 && sizes[3] != 1) {
    ISOSCOPE_ASSIGN_OR_RETURN(NrrdLayout nrrd, ReadNrrdLayout(path));
    TakeGrid(std::move(nrrd.grid), &layout);
    const std::int64_t others = nrrd.tuples * nrrd.volumes;
    (nrrd.is_time ? layout.steps : layout.components) = others;
    layout.location.volume_count = nrrd.volumes;
    layout.location.components = nrrd.tuples;
    layout.interval = nrrd.interval;
    layout.time_unit = nrrd.time_unit;
    layout.sample_unit = nrrd.sample_unit;
  } else {
    const bool has_volume = (sizes.size() == 3 || sizes.size() == 4) && type.has_value() &&
                            *std::min_element(sizes.begin(), sizes.begin() + 3) > 1;
    if (!has_volume) {
      return std::nullopt;  // whatever it is, whoever opens it alone says why not
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const NrrdAxisLists lists, ReadNrrdLists(fields, path));
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (!IsNrrdAxisOfSpace(lists, axis)) {
        return std::nullopt;
      }
    }
    ISOSCOPE_ASSIGN_OR_RETURN(NrrdGrid grid, ReadNrrdGrid(fields, lists, 0, path));
    grid.length_unit.clear();  // as of all files of one volume
    TakeGrid(std::move(grid), &layout);
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

// By our own reader alone: MetaIO reads no numbers that are none.
absl::StatusOr<ImageLayout> MetaImageLayoutByFields(const std::string& path,
                                                    const volume::GridGeometry& grid) {
  ISOSCOPE_ASSIGN_OR_RETURN(const HeaderFields fields, ReadMetaImageFields(path));
  ImageLayout image;
  image.geometry = grid;
  image.type = MetaImageType(fields.Get("elementtype"));
  ISOSCOPE_ASSIGN_OR_RETURN(image.dims, fields.GetIntegers("dimsize"));
  ISOSCOPE_ASSIGN_OR_RETURN(image.components, fields.GetInteger("elementnumberofchannels", 1));
  if (!image.type.has_value() || image.components < 1 ||
      *std::min_element(image.dims.begin(), image.dims.end()) < 1) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: DimSize = %s, ElementType = %s, ElementNumberOfChannels = %d; expected 1 or more, and "
        "MET_CHAR, MET_UCHAR, MET_SHORT, MET_USHORT, MET_INT, MET_UINT, MET_FLOAT or MET_DOUBLE",
        path, fields.Get("dimsize"), fields.Get("elementtype"), image.components));
  }
  return image;
}

absl::StatusOr<std::optional<FileLayout>> MetaImageFileLayout(const std::string& path,
                                                              const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(SampleLocation location, LocateMetaImageSamples(path));
  const auto by_rules = ReadMetaImageGrid(path, rules);
  const bool is_replaced = by_rules.ok() && !ReadMetaImageGrid(path, {}).ok();
  ISOSCOPE_ASSIGN_OR_RETURN(const ImageLayout image,
                            is_replaced ? MetaImageLayoutByFields(path, *by_rules)
                                        : ReadImageLayout(FileFormat::kMetaImage, path));
  const bool has_steps = image.dims.size() == 4 && image.dims[3] > 1;
  const bool is_of_itk = image.components <= 1 && !has_steps && !is_replaced;
  if (is_of_itk || image.dims.size() != (has_steps ? 4 : 3) || !image.type.has_value() ||
      (has_steps && image.components > 1)) {
    return std::nullopt;
  }
  FileLayout layout{.geometry = image.geometry, .components = image.components};
  if (has_steps) {  // numbered: nothing says that the fourth axis is time
    layout.steps = image.dims[3];
    location.volume_count = layout.steps;
  }
  location.stored_type = *image.type;
  location.components = image.components;
  layout.location = std::move(location);
  return layout;
}

absl::StatusOr<std::optional<FileLayout>> LayoutOfFile(FileFormat format, const std::string& path,
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
  ISOSCOPE_ASSIGN_OR_RETURN(std::optional<FileLayout> layout,
                            LayoutOfFile(format, header_path, rules));
  if (!layout.has_value()) {
    return nullptr;
  }
  return MakeLayoutSeries(path, field, *std::move(layout), rules);
}

}  // namespace isoscope::source
