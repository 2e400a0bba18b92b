// Members that the manifests of volumes and of series share. Each has a function that makes the
// JSON and one that reads it. Readers record the first error in the JsonFields that they are given,
// and name the file in it; they leave the result as it was then.
//
//   "spacing"        [x, y, z]
//   "direction"      {"x": [x, y, z], "y": ..., "z": ...}   the columns
//   "value_range"    {"min": 0, "max": 255}
//   "finite_range"   as value_range; only beside one with an infinite end
//   "labels"         [{"value": 3, "name": "lung", "color": "#80c0ff"}]; only the value must be there

#include "core/store/manifest_members.h"

#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include <nlohmann/json.hpp>

#include "core/base/status_macros.h"
#include "core/store/shard_format.h"

namespace isoscope::store {
namespace {

absl::Status CheckRequired(const Json& required, absl::string_view where, absl::string_view kind) {
  const auto is_known = [kind](absl::string_view feature) {
    return feature == kLevelsFeature || (feature == kIndexOnlyFeature && kind == kVolumeKind);
  };
  for (const Json& feature : required) {
    if (!feature.is_string() || !is_known(feature.get_ref<const std::string&>())) {
      return absl::FailedPreconditionError(
          absl::StrCat(where, ": requires ", feature.dump(-1, ' ', true),
                       ", which this program does not know; use a newer program"));
    }
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<int> ReadVersion(const Json& json, absl::string_view where, absl::string_view kind) {
  JsonFields fields(json, where);
  std::int64_t version = 0;
  fields.Read("format_version", 1, kExtendedFormatVersion, &version);
  std::string stated_kind(version == kSeriesFormatVersion ? kSeriesKind : kVolumeKind);
  if (version == kExtendedFormatVersion) {
    fields.Read("kind", &stated_kind);
    if (const Json* required = fields.ReadArray("requires")) {
      fields.Fail(CheckRequired(*required, where, stated_kind));
    }
  }
  ISOSCOPE_RETURN_IF_ERROR(fields.status());
  const absl::string_view stated = stated_kind;
  if (stated != kVolumeKind && stated != kSeriesKind) {
    return absl::FailedPreconditionError(
        absl::StrCat(where, ": a dataset of kind \"", stated,
                     "\", which this program does not know; use a newer program"));
  }
  if (stated != kind) {
    return absl::FailedPreconditionError(
        absl::StrCat(where, ": format version ", version, ", ",
                     kind == kSeriesKind ? "a dataset of one field and step, no series"
                                         : "a series, expected a dataset of one field and step"));
  }
  return static_cast<int>(version);
}

Json JsonFromIndex(const math::Index3& index) { return Json::array({index.x, index.y, index.z}); }

Json JsonFromVector(const math::Vec3d& vector) {
  return Json::array(
      {JsonFromDouble(vector.x), JsonFromDouble(vector.y), JsonFromDouble(vector.z)});
}

Json JsonFromDirection(const math::Mat3d& direction) {
  return Json{{"x", JsonFromVector(direction.columns[0])},
              {"y", JsonFromVector(direction.columns[1])},
              {"z", JsonFromVector(direction.columns[2])}};
}

Json JsonFromRange(const volume::ScalarSpan& range) {
  return Json{{"min", JsonFromDouble(range.min)}, {"max", JsonFromDouble(range.max)}};
}

void ReadIndex(const char* name, std::int64_t min, std::int64_t max, JsonFields* fields,
               math::Index3* index) {
  std::int64_t values[3] = {};
  fields->ReadIntegers(name, 3, min, max, values);
  *index = {values[0], values[1], values[2]};
}

void ReadVector(const char* name, JsonFields* fields, math::Vec3d* vector) {
  double values[3] = {};
  fields->ReadDoubles(name, 3, values);
  *vector = {values[0], values[1], values[2]};
}

void ReadPatientFrame(absl::string_view where, JsonFields* fields,
                      std::optional<volume::PatientFrame>* frame) {
  if (!fields->Has("patient_frame")) {
    return;
  }
  std::string name;
  fields->Read("patient_frame", &name);
  if (name.empty()) {  // an error was recorded, or there is no frame to set
    return;
  }
  const auto known = volume::PatientFrame::FromName(name);
  if (!known.ok()) {
    return fields->Fail(WithContext(where, known.status()));
  }
  *frame = *known;
}

void AddLabels(const std::vector<volume::Label>& labels, Json* json) {
  if (labels.empty()) {
    return;
  }
  Json array = Json::array();
  for (const volume::Label& label : labels) {
    Json element{{"value", JsonFromDouble(label.value)}};
    if (!label.name.empty()) {
      element["name"] = label.name;
    }
    if (label.color.has_value()) {
      element["color"] = volume::ToHex(*label.color);
    }
    array.push_back(std::move(element));
  }
  (*json)["labels"] = std::move(array);
}

void ReadLabels(absl::string_view where, JsonFields* fields, std::vector<volume::Label>* labels) {
  const Json* const array = fields->Has("labels") ? fields->ReadArray("labels") : nullptr;
  if (array == nullptr) {
    return;
  }
  std::vector<volume::Label> read;
  for (const Json& element : *array) {
    JsonFields members(element, where);
    volume::Label& label = read.emplace_back();
    members.ReadDouble("value", &label.value);
    if (members.Has("name")) {
      members.Read("name", &label.name);
    }
    if (members.Has("color")) {
      std::string color;
      members.Read("color", &color);
      label.color = volume::LabelColorFromHex(color);
      if (!label.color.has_value()) {
        members.Fail(absl::DataLossError(
            absl::StrCat(where, ": member \"color\" of a label: expected #rrggbb")));
      }
    }
    if (!members.status().ok()) {
      return fields->Fail(members.status());
    }
  }
  const absl::Status valid = volume::ValidateLabels(read);
  if (!valid.ok()) {
    return fields->Fail(WithContext(where, valid));
  }
  *labels = std::move(read);
}

absl::Status ReadDirection(const Json& json, absl::string_view where, math::Mat3d* direction) {
  JsonFields fields(json, where);
  ReadVector("x", &fields, &direction->columns[0]);
  ReadVector("y", &fields, &direction->columns[1]);
  ReadVector("z", &fields, &direction->columns[2]);
  return fields.status();
}

absl::Status ReadRange(const Json& json, absl::string_view where, volume::ScalarSpan* range) {
  JsonFields fields(json, where);
  fields.ReadDouble("min", &range->min);
  fields.ReadDouble("max", &range->max);
  return fields.status();
}

void ReadFiniteRange(absl::string_view where, JsonFields* fields,
                     std::optional<volume::ScalarSpan>* range) {
  const Json* const json =
      fields->Has("finite_range") ? fields->ReadObject("finite_range") : nullptr;
  if (json != nullptr) {
    fields->Fail(ReadRange(*json, where, &range->emplace()));
  }
}

absl::Status CheckFiniteRange(const volume::ScalarSpan& value_range,
                              const std::optional<volume::ScalarSpan>& finite_range) {
  if (!finite_range.has_value() || *finite_range == volume::ScalarSpan()) {
    return absl::OkStatus();
  }
  if (!volume::IsFinite(value_range) && volume::IsFinite(*finite_range) &&
      value_range.min <= finite_range->min && finite_range->min <= finite_range->max &&
      finite_range->max <= value_range.max) {
    return absl::OkStatus();
  }
  return absl::DataLossError(absl::StrFormat(
      "member \"finite_range\" is %g to %g: expected finite numbers in the range of all samples, "
      "%g to %g, which has an infinite end",
      finite_range->min, finite_range->max, value_range.min, value_range.max));
}

bool IsDigest(const std::string& id) {
  return id.size() == 32 && id.find_first_not_of("0123456789abcdef") == std::string::npos;
}

absl::Status WithContext(absl::string_view where, const absl::Status& status) {
  return absl::DataLossError(absl::StrCat(where, ": ", status.message()));
}

}  // namespace isoscope::store
