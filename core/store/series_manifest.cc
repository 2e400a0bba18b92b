// Encoding writes the members in a fixed order and one line for each scalar volume, then seals the
// text. Decoding trusts nothing, as that of manifest.cc:
//
//   1. VerifySeal: the CRC-32C of the whole text.
//   2. ParseJsonFile: valid JSON of this format, of version 2, or of 3 and a series.
//   3. Each member by name: its type and range. Unknown members are ignored.
//   4. CheckSeries: fields and components have names that tell them apart, times ascend, the
//      grid makes blocks for all shards, and the lines of volumes ascend and name what is there.
//
// Invariant: decoding an encoded manifest gives the same manifest, bit for bit, if its strings are
// UTF-8. WriteSeriesManifest refuses what could not be decoded.
//
// Example: tests/unit/core/store/series_manifest_test.cc has the whole text of a small manifest.
// Members: docs/format/dataset.md, "Series".

#include "core/store/series_manifest.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <set>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include <nlohmann/json.hpp>

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/store/json_fields.h"
#include "core/store/manifest.h"
#include "core/store/manifest_members.h"
#include "core/store/sealed_json.h"
#include "core/store/shard_format.h"
#include "core/volume/block_layout.h"

namespace isoscope::store {
namespace {

// Members that may be empty are left out then.
void AddText(const char* name, const std::string& text, Json* json) {
  if (!text.empty()) {
    (*json)[name] = text;
  }
}

void ReadOptionalText(const char* name, JsonFields* fields, std::string* text) {
  if (fields->Has(name)) {
    fields->Read(name, text);
  }
}

// The other members than the volumes.
Json HeadOf(const SeriesManifest& manifest) {
  Json fields = Json::array();
  for (const Field& field : manifest.fields) {
    Json json;
    json["name"] = field.name;
    AddText("long_name", field.long_name, &json);
    AddText("unit", field.unit, &json);
    Json components = Json::array();
    for (const FieldComponent& component : field.components) {
      components.push_back(
          Json{{"name", component.name},
               {"scalar_type", std::string(volume::NameOf(component.scalar_type))}});
    }
    json["components"] = std::move(components);
    fields.push_back(std::move(json));
  }
  const volume::GridGeometry& geometry = manifest.geometry;
  Json json;
  json["format"] = std::string(kManifestFormat);
  const bool has_levels = manifest.highest_level() > 0;
  json["format_version"] = has_levels ? kExtendedFormatVersion : kSeriesFormatVersion;
  json["crc32c"] = JsonFromCrc32c(0);
  if (has_levels) {
    json["kind"] = std::string(kSeriesKind);
    json["requires"] = Json::array({std::string(kLevelsFeature)});
  }
  json["dataset_id"] = manifest.dataset_id;
  json["name"] = manifest.name;
  json["source"] = manifest.source;
  json["sample_dims"] = JsonFromIndex(geometry.sample_dims);
  json["spacing"] = JsonFromVector(geometry.spacing);
  json["origin"] = JsonFromVector(geometry.origin);
  json["direction"] = JsonFromDirection(geometry.direction);
  if (manifest.patient_frame.has_value()) {
    json["patient_frame"] = manifest.patient_frame->name();
  }
  AddText("length_unit", manifest.length_unit, &json);
  json["block_cells"] = JsonFromIndex(manifest.block_cells);
  json["distribution"] = std::string(NameOf(Distribution::kRandom));
  json["seed"] = manifest.seed;
  json["shard_count"] = manifest.shard_count;
  json["fields"] = std::move(fields);
  if (!manifest.times.empty()) {
    Json times = Json::array();
    for (const double time : manifest.times) {
      times.push_back(JsonFromDouble(time));
    }
    json["times"] = std::move(times);
  }
  AddText("time_unit", manifest.time_unit, &json);
  AddLabels(manifest.labels, &json);
  return json;
}

std::string LineOf(const ScalarVolume& volume) {
  Json json;
  json["field"] = volume.key.field;
  json["component"] = volume.key.component;
  json["step"] = volume.key.step;
  json["dataset_id"] = volume.dataset_id;
  json["manifest_crc32c"] = JsonFromCrc32c(volume.manifest_crc32c);
  json["min"] = JsonFromDouble(volume.value_range.min);
  json["max"] = JsonFromDouble(volume.value_range.max);
  if (volume.finite_range.has_value()) {
    json["finite_range"] = JsonFromRange(*volume.finite_range);
  }
  if (volume.max_gradient_magnitude.has_value()) {
    json["max_gradient_magnitude"] = JsonFromDouble(*volume.max_gradient_magnitude);
  }
  if (volume.highest_level > 0) {
    json["highest_level"] = volume.highest_level;
    json["level_filter"] = std::string(volume::NameOf(volume.level_filter));
  }
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

absl::Status CheckSize(const char* name, const Json& json, int max, absl::string_view where) {
  if (json.empty() || json.size() > static_cast<std::size_t>(max)) {
    return absl::DataLossError(
        absl::StrFormat("%s: %d %s, expected 1 to %d", where, json.size(), name, max));
  }
  return absl::OkStatus();
}

absl::StatusOr<FieldComponent> ReadComponent(const Json& json, absl::string_view where) {
  FieldComponent component;
  JsonFields fields(json, where);
  fields.Read("name", &component.name);
  std::string scalar_type;
  fields.Read("scalar_type", &scalar_type);
  ISOSCOPE_RETURN_IF_ERROR(fields.status());
  const auto type = volume::ScalarTypeFromName(scalar_type);
  if (!type.ok()) {
    return WithContext(where, type.status());
  }
  component.scalar_type = *type;
  return component;
}

absl::StatusOr<Field> ReadField(const Json& json, absl::string_view where) {
  Field field;
  JsonFields fields(json, where);
  fields.Read("name", &field.name);
  ReadOptionalText("long_name", &fields, &field.long_name);
  ReadOptionalText("unit", &fields, &field.unit);
  const Json* components = fields.ReadArray("components");
  ISOSCOPE_RETURN_IF_ERROR(fields.status());
  ISOSCOPE_RETURN_IF_ERROR(CheckSize("components", *components, kMaxComponents, where));
  for (const Json& element : *components) {
    ISOSCOPE_ASSIGN_OR_RETURN(FieldComponent component, ReadComponent(element, where));
    field.components.push_back(std::move(component));
  }
  return field;
}

absl::Status ReadSeriesFields(const Json& json, absl::string_view where,
                              std::vector<Field>* series_fields) {
  ISOSCOPE_RETURN_IF_ERROR(CheckSize("fields", json, kMaxFields, where));
  for (const Json& element : json) {
    ISOSCOPE_ASSIGN_OR_RETURN(Field field, ReadField(element, where));
    series_fields->push_back(std::move(field));
  }
  return absl::OkStatus();
}

absl::Status ReadTimes(const Json& json, absl::string_view where, JsonFields* fields,
                       std::vector<double>* times) {
  ISOSCOPE_RETURN_IF_ERROR(CheckSize("times", json, kMaxSteps, where));
  times->resize(json.size());
  fields->ReadDoubles("times", times->size(), times->data());
  return absl::OkStatus();
}

// Leaves the volume without levels if there is no such member.
absl::Status ReadVolumeLevels(absl::string_view where, JsonFields* fields, ScalarVolume* volume) {
  if (!fields->Has("highest_level")) {
    return absl::OkStatus();
  }
  std::int64_t highest_level = 0;
  std::string filter_name;
  fields->Read("highest_level", 1, volume::kMaxLevel, &highest_level);
  fields->Read("level_filter", &filter_name);
  ISOSCOPE_RETURN_IF_ERROR(fields->status());
  const absl::StatusOr<volume::LevelFilter> filter = volume::LevelFilterFromName(filter_name);
  if (!filter.ok()) {
    return WithContext(where, filter.status());
  }
  volume->highest_level = static_cast<int>(highest_level);
  volume->level_filter = *filter;
  return absl::OkStatus();
}

absl::Status ReadVolumes(const Json& json, absl::string_view where,
                         std::vector<ScalarVolume>* volumes) {
  ISOSCOPE_RETURN_IF_ERROR(CheckSize("volumes", json, kMaxScalarVolumes, where));
  volumes->reserve(json.size());
  for (const Json& element : json) {
    ScalarVolume volume;
    JsonFields fields(element, where);
    std::int64_t field = 0;
    std::int64_t component = 0;
    std::int64_t step = 0;
    fields.Read("field", 0, kMaxFields - 1, &field);
    fields.Read("component", 0, kMaxComponents - 1, &component);
    fields.Read("step", 0, kMaxSteps - 1, &step);
    fields.Read("dataset_id", &volume.dataset_id);
    fields.ReadCrc32c("manifest_crc32c", &volume.manifest_crc32c);
    fields.ReadDouble("min", &volume.value_range.min);
    fields.ReadDouble("max", &volume.value_range.max);
    ReadFiniteRange(where, &fields, &volume.finite_range);
    if (fields.Has("max_gradient_magnitude")) {
      fields.ReadDouble("max_gradient_magnitude", &volume.max_gradient_magnitude.emplace());
    }
    ISOSCOPE_RETURN_IF_ERROR(fields.status());
    ISOSCOPE_RETURN_IF_ERROR(ReadVolumeLevels(where, &fields, &volume));
    volume.key = {static_cast<int>(field), static_cast<int>(component), static_cast<int>(step)};
    volumes->push_back(std::move(volume));
  }
  return absl::OkStatus();
}

absl::Status CheckComponents(const Field& field, absl::string_view where) {
  const std::vector<FieldComponent>& components = field.components;
  const auto fails = [&](absl::string_view what) {
    return absl::DataLossError(absl::StrFormat("%s: field \"%s\": %s", where, field.name, what));
  };
  if (components.size() == 1) {
    return components[0].name.empty() ? absl::OkStatus()
                                      : fails("its only component has a name, expected none");
  }
  if (components.size() == 2 || components.back().name != kMagnitudeName) {
    return fails("expected two components or more, and \"magnitude\" behind them");
  }
  std::set<std::string> names;
  for (const FieldComponent& component : components) {
    if (component.name.empty() || !names.insert(component.name).second) {
      return fails(absl::StrCat("component \"", component.name,
                                "\": expected a name that no other component has"));
    }
  }
  return absl::OkStatus();
}

absl::Status CheckFields(const SeriesManifest& manifest, absl::string_view where) {
  std::set<std::string> names;
  for (const Field& field : manifest.fields) {
    if (field.name.empty() || !names.insert(field.name).second) {
      return absl::DataLossError(absl::StrFormat(
          "%s: field \"%s\": expected a name that no other field has", where, field.name));
    }
    ISOSCOPE_RETURN_IF_ERROR(CheckComponents(field, where));
  }
  for (std::size_t step = 0; step < manifest.times.size(); ++step) {
    const double time = manifest.times[step];
    if (!std::isfinite(time) || (step > 0 && !(manifest.times[step - 1] < time))) {
      return absl::DataLossError(
          absl::StrFormat("%s: time %g of step %d: expected a finite one, later than the step "
                          "before",
                          where, time, step));
    }
  }
  return absl::OkStatus();
}

absl::Status CheckGrid(const SeriesManifest& manifest, absl::string_view where) {
  if (const absl::Status status = volume::Validate(manifest.geometry); !status.ok()) {
    return WithContext(where, status);
  }
  const auto layout =
      volume::BlockLayout::Make(manifest.geometry.sample_dims, manifest.block_cells);
  if (!layout.ok()) {
    return WithContext(where, layout.status());
  }
  if (manifest.shard_count > layout->block_count()) {
    return absl::DataLossError(absl::StrFormat("%s: %d shards for %d blocks", where,
                                               manifest.shard_count, layout->block_count()));
  }
  return absl::OkStatus();
}

absl::Status CheckVolumes(const SeriesManifest& manifest, absl::string_view where) {
  const ScalarVolume* before = nullptr;
  for (const ScalarVolume& volume : manifest.volumes) {
    const ScalarVolumeKey& key = volume.key;
    const auto fails = [&](absl::string_view what) {
      return absl::DataLossError(
          absl::StrFormat("%s: volume of field %d, component %d, step %d: %s", where, key.field,
                          key.component, key.step, what));
    };
    if (static_cast<std::size_t>(key.field) >= manifest.fields.size() ||
        static_cast<std::size_t>(key.component) >=
            manifest.fields[static_cast<std::size_t>(key.field)].components.size() ||
        key.step >= manifest.step_count()) {
      return fails("the manifest has no such field, component or step");
    }
    if (before != nullptr && !(before->key < key)) {
      return fails("expected ascending by step, field and component, each once");
    }
    if (!IsDigest(volume.dataset_id)) {
      return fails("member \"dataset_id\": expected 32 lower-case hex digits");
    }
    if (const double bound = volume.max_gradient_magnitude.value_or(0);
        !(bound >= 0 && std::isfinite(bound))) {
      return fails(absl::StrCat("member \"max_gradient_magnitude\" is ", bound,
                                ": expected a finite number >= 0"));
    }
    if (const absl::Status status = CheckFiniteRange(volume.value_range, volume.finite_range);
        !status.ok()) {
      return fails(status.message());
    }
    if (volume.highest_level > volume::HighestLevel(manifest.geometry.sample_dims)) {
      return fails(absl::StrCat("member \"highest_level\" is ", volume.highest_level,
                                ": expected at most ",
                                volume::HighestLevel(manifest.geometry.sample_dims)));
    }
    before = &volume;
  }
  return absl::OkStatus();
}

// Checks what involves several members.
absl::Status CheckSeries(const SeriesManifest& manifest, absl::string_view where) {
  if (!IsDigest(manifest.dataset_id)) {
    return absl::DataLossError(
        absl::StrCat(where, ": member \"dataset_id\": expected 32 lower-case hex digits"));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckGrid(manifest, where));
  ISOSCOPE_RETURN_IF_ERROR(CheckFields(manifest, where));
  return CheckVolumes(manifest, where);
}

absl::StatusOr<std::shared_ptr<const Json>> ParseSeries(absl::string_view bytes,
                                                        absl::string_view where) {
  ISOSCOPE_RETURN_IF_ERROR(VerifySeal(bytes, where).status());
  ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<const Json> json,
                            ParseJsonFile(bytes, where, kManifestFormat, kExtendedFormatVersion));
  ISOSCOPE_RETURN_IF_ERROR(ReadVersion(*json, where, kSeriesKind).status());
  return json;
}

}  // namespace

std::string ScalarVolumeDirectoryName(const ScalarVolumeKey& key) {
  return absl::StrFormat("field-%03d-component-%d-step-%05d", key.field, key.component, key.step);
}

const ScalarVolume* SeriesManifest::Find(const ScalarVolumeKey& key) const {
  const auto found =
      std::lower_bound(volumes.begin(), volumes.end(), key,
                       [](const ScalarVolume& volume, const ScalarVolumeKey& sought) {
                         return volume.key < sought;
                       });
  return found != volumes.end() && found->key == key ? &*found : nullptr;
}

int SeriesManifest::highest_level() const {
  int highest = 0;
  for (const ScalarVolume& volume : volumes) {
    highest = std::max(highest, volume.highest_level);
  }
  return highest;
}

std::string EncodeSeriesManifest(const SeriesManifest& manifest) {
  std::string text = DumpJson(HeadOf(manifest));
  constexpr absl::string_view kEnd = "\n}\n";
  ISOSCOPE_CHECK(absl::EndsWith(text, kEnd));
  text.resize(text.size() - kEnd.size());
  absl::StrAppend(&text, ",\n  \"volumes\": [");
  const char* separator = "\n    ";
  for (const ScalarVolume& volume : manifest.volumes) {
    absl::StrAppend(&text, separator, LineOf(volume));
    separator = ",\n    ";
  }
  absl::StrAppend(&text, "\n  ]", kEnd);
  return SealJson(std::move(text));
}

absl::StatusOr<SeriesManifest> DecodeSeriesManifest(absl::string_view bytes,
                                                    absl::string_view where) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const Json> json, ParseSeries(bytes, where));
  SeriesManifest manifest;
  JsonFields fields(*json, where);
  fields.Read("dataset_id", &manifest.dataset_id);
  fields.Read("name", &manifest.name);
  fields.Read("source", &manifest.source);
  ReadIndex("sample_dims", 2, std::numeric_limits<std::int64_t>::max(), &fields,
            &manifest.geometry.sample_dims);
  ReadVector("spacing", &fields, &manifest.geometry.spacing);
  ReadVector("origin", &fields, &manifest.geometry.origin);
  if (const Json* direction = fields.ReadObject("direction")) {
    fields.Fail(ReadDirection(*direction, where, &manifest.geometry.direction));
  }
  ReadPatientFrame(where, &fields, &manifest.patient_frame);
  ReadOptionalText("length_unit", &fields, &manifest.length_unit);
  ReadIndex("block_cells", 1, volume::BlockLayout::kMaxBlockCells, &fields, &manifest.block_cells);
  std::string distribution;
  fields.Read("distribution", &distribution);
  fields.Read("seed", &manifest.seed);
  std::int64_t shard_count = 0;
  fields.Read("shard_count", 1, kMaxShardCount, &shard_count);
  if (const Json* series_fields = fields.ReadArray("fields")) {
    fields.Fail(ReadSeriesFields(*series_fields, where, &manifest.fields));
  }
  if (fields.Has("times")) {
    if (const Json* times = fields.ReadArray("times")) {
      fields.Fail(ReadTimes(*times, where, &fields, &manifest.times));
    }
  }
  ReadOptionalText("time_unit", &fields, &manifest.time_unit);
  ReadLabels(where, &fields, &manifest.labels);
  if (const Json* volumes = fields.ReadArray("volumes")) {
    fields.Fail(ReadVolumes(*volumes, where, &manifest.volumes));
  }
  ISOSCOPE_RETURN_IF_ERROR(fields.status());
  if (absl::string_view(distribution) != NameOf(Distribution::kRandom)) {
    return absl::DataLossError(
        absl::StrCat(where, ": distribution \"", distribution, "\": expected random"));
  }
  manifest.shard_count = static_cast<int>(shard_count);
  ISOSCOPE_RETURN_IF_ERROR(CheckSeries(manifest, where));
  return manifest;
}

}  // namespace isoscope::store
