#include "core/formats/zarr/cf_arrays.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"

#include "core/base/cancellation.h"
#include "core/base/coding.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/formats/zarr/zarr_packing.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxCoordinates = std::int64_t{1} << 24;
constexpr std::size_t kMaxAuxiliary = 64;
constexpr std::int64_t kExpectedBytes = 64 * base::kKiB;  // of coordinates in one chunk

std::string InZarrGroup(const std::string& group, const std::string& name) {
  return group.empty() ? name : absl::StrCat(group, "/", name);
}

// All elements of an array of one axis, scaled, NaN where they are missing.
absl::StatusOr<std::vector<double>> ReadCoordinates(const ZarrStore& store,
                                                    const ZarrArray& array) {
  const std::string name = store.NameOf(array.path);
  if (array.dims[0] < 1 || array.dims[0] > kMaxCoordinates) {
    return absl::InvalidArgumentError(absl::StrFormat("%s: %d coordinates; expected 1 to %d", name,
                                                      array.dims[0], kMaxCoordinates));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<ChunkedArray> chunks,
                            OpenStoredArray(store.objects(), array.SpecOf(name)));
  auto packing = ZarrPackingOf(array);
  if (!packing.ok()) {
    return absl::Status(packing.status().code(),
                        absl::StrCat(name, ": ", packing.status().message()));
  }
  if (array.type == NumberType::kFloat16) {
    return absl::InvalidArgumentError(absl::StrCat(name, ": coordinates of float16"));
  }
  const auto count = static_cast<std::size_t>(array.dims[0]);
  std::string bytes(count * SizeOf(array.type), '\0');
  ISOSCOPE_RETURN_IF_ERROR(
      chunks->ReadBox(BoxOf(array.dims), bytes.data(), nullptr, base::Cancellation()));
  std::vector<double> values(count);
  if (array.time.has_value()) {
    for (std::size_t i = 0; i < count; ++i) {
      const auto stored =
          base::LoadLittleEndian<std::int64_t>(bytes.data() + i * sizeof(std::int64_t));
      values[i] = stored == std::numeric_limits<std::int64_t>::min()
                      ? std::numeric_limits<double>::quiet_NaN()
                      : static_cast<double>(stored) * array.time->multiple / array.time->divisor;
    }
    return values;
  }
  VisitNumberType(array.type, [&]<typename T>() {
    for (std::size_t i = 0; i < count; ++i) {
      const auto stored =
          static_cast<double>(base::LoadLittleEndian<T>(bytes.data() + i * sizeof(T)));
      const bool is_missing = std::find(packing->missing.begin(), packing->missing.end(), stored) !=
                              packing->missing.end();
      values[i] = is_missing ? std::numeric_limits<double>::quiet_NaN()
                             : stored * packing->slope + packing->intercept;
    }
  });
  return values;
}

// Tells that the arrays of the axes' names are asked for, and then their samples.
void ExpectCoordinates(ZarrStore* store, const std::string& group, const ZarrArray& array) {
  std::set<std::string> paths;
  for (const std::string& name : array.dimension_names) {
    if (const std::string path = InZarrGroup(group, name); !name.empty() && path != array.path) {
      paths.insert(path);
    }
  }
  store->Expect(paths);
  std::vector<ObjectRead> reads;
  for (const std::string& path : paths) {
    const auto node = store->Node(path);
    if (node.ok() && node->array.ok() && node->array->dims.size() == 1 &&
        node->array->dims[0] <= node->array->chunk_dims[0]) {
      reads.push_back({.key = node->array->KeyOf({0}), .max_size = kExpectedBytes});
    }
  }
  store->objects()->Expect(reads);
}

void TakeMeaning(const ZarrJson& attributes, CfAxis* axis) {
  axis->axis = TextOf(attributes, "axis");
  axis->positive = TextOf(attributes, "positive");
  axis->standard_name = TextOf(attributes, "standard_name");
  axis->units = TextOf(attributes, "units");
}

// The coordinates of an array of one axis, or why they are not known.
absl::Status TakeCoordinatesOf(const ZarrStore& store, const ZarrNode& node, CfAxis* axis) {
  if (!node.array.ok()) {
    axis->fault = absl::StrCat("its coordinates can't be read: ", node.array.status().message());
    return absl::OkStatus();
  }
  TakeMeaning(node.attributes, axis);
  auto values = ReadCoordinates(store, *node.array);
  if (absl::IsInvalidArgument(values.status())) {
    axis->fault = absl::StrCat("its coordinates can't be read: ", values.status().message());
    return absl::OkStatus();
  }
  ISOSCOPE_RETURN_IF_ERROR(values.status());
  if (node.array->time.has_value()) {
    axis->units = node.array->time->units;
    axis->axis = axis->axis.empty() ? "T" : axis->axis;
  }
  axis->values = *std::move(values);
  axis->is_single = node.array->type == NumberType::kFloat32;
  return absl::OkStatus();
}

// Coordinates that the attribute "coordinates" names: those of one axis without any of its own; and
// those of several axes, which are the fault of each of them.
absl::Status TakeAuxiliary(ZarrStore* store, const std::string& group, CfArray* described) {
  const std::string list = TextOf(described->array.attributes, "coordinates");
  const std::vector<std::string> names =
      absl::StrSplit(list, absl::ByAnyChar(" \t\n"), absl::SkipEmpty());
  const std::vector<std::string>& dimensions = described->array.dimension_names;
  for (std::size_t i = 0; i < names.size() && i < kMaxAuxiliary; ++i) {
    const auto node = store->Node(InZarrGroup(group, names[i]));
    if (!node.ok() || !node->array.ok() || node->array->dimension_names.empty()) {
      continue;
    }
    std::vector<std::size_t> places;
    for (const std::string& dimension : node->array->dimension_names) {
      const auto found = std::find(dimensions.begin(), dimensions.end(), dimension);
      if (found != dimensions.end() && !dimension.empty()) {
        places.push_back(static_cast<std::size_t>(found - dimensions.begin()));
      }
    }
    if (places.size() != node->array->dims.size()) {
      continue;
    }
    CfAxis meaning{.name = names[i]};
    TakeMeaning(node->attributes, &meaning);
    const char letter = CfLetterOf(meaning);
    if (places.size() == 1) {
      CfAxis& axis = described->axes[places[0]];
      if (axis.values.empty() && axis.fault.empty() && axis.size == node->array->dims[0] &&
          letter != '?') {
        ISOSCOPE_RETURN_IF_ERROR(TakeCoordinatesOf(*store, *node, &axis));
        axis.name = names[i];
        described->coordinates.push_back(node->path);
      }
      continue;
    }
    for (const std::size_t place : places) {
      CfAxis& axis = described->axes[place];
      if (letter >= 'X' && letter <= 'Z' && axis.values.empty() && axis.size > 1) {
        axis.fault = absl::StrFormat(
            "its coordinates \"%s\" depend on %d axes, among them \"%s\", which has none of its "
            "own: the grid is curved; expected coordinates of one axis each: regrid it, or take it "
            "by its indices, which --spacing X,Y,Z and --origin X,Y,Z place",
            base::Printable(names[i]), places.size(), base::Printable(axis.name));
      }
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<CfArray> DescribeCfArray(ZarrStore* store, const std::string& group,
                                        ZarrArray array) {
  CfArray described{.array = std::move(array)};
  ExpectCoordinates(store, group, described.array);
  for (std::size_t i = 0; i < described.array.dims.size(); ++i) {
    const std::vector<std::string>& names = described.array.dimension_names;
    CfAxis axis{.name = names.empty() ? "" : names[i], .size = described.array.dims[i]};
    const std::string path = InZarrGroup(group, axis.name);
    if (!axis.name.empty() && path != described.array.path &&
        axis.name.find('/') == std::string::npos) {
      const auto node = store->Node(path);
      const bool is_coordinate = node.ok() && node->is_array &&
                                 (!node->array.ok() || (node->array->dims.size() == 1 &&
                                                        node->array->dims[0] == axis.size));
      if (!node.ok() && !absl::IsNotFound(node.status()) &&
          !absl::IsInvalidArgument(node.status())) {
        return node.status();
      }
      if (is_coordinate) {
        ISOSCOPE_RETURN_IF_ERROR(TakeCoordinatesOf(*store, *node, &axis));
        described.coordinates.push_back(path);
      }
    }
    described.axes.push_back(std::move(axis));
  }
  ISOSCOPE_RETURN_IF_ERROR(TakeAuxiliary(store, group, &described));
  return described;
}

}  // namespace isoscope::source
