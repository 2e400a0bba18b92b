// SeriesDirectoryToJson compares the manifest of a series with the folders of its shards:
//
// 1. GatherOverSteps folds the volumes of the manifest over all steps. Each component gets the
//    union of its ranges, its greatest gradient, and its steps.
// 2. FieldsToJson intersects the steps of a field's components: there the field is complete.
// 3. MissingVolumesToJson looks for the folder of every field, component and step in every shard
//    that is here. A volume that the manifest lacks is missing in all of them.
//
// DescribeMissing joins the steps at which the same shards lack the same component:
// "u x at steps 3, 4 in shards 1".

#include "client-cli/output/series_json.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include <nlohmann/json.hpp>

#include "client-cli/output/info_lines.h"
#include "client-cli/output/label_json.h"
#include "client-cli/output/level_json.h"
#include "core/cli/table.h"
#include "core/io/file.h"
#include "core/store/manifest.h"
#include "core/store/source_volume.h"
#include "core/volume/block_layout.h"
#include "wire/series_convert.h"

namespace isoscope::cli {
namespace {

Json ArrayOf(const math::Index3& v) { return Json::array({v.x, v.y, v.z}); }
// Adding 0 makes -0 the 0 that people expect.
Json ArrayOf(const math::Vec3d& v) { return Json::array({v.x + 0.0, v.y + 0.0, v.z + 0.0}); }

// The range and the greatest gradient of a component over all steps.
struct OverSteps {
  volume::ScalarSpan range{std::numeric_limits<double>::infinity(),
                           -std::numeric_limits<double>::infinity()};
  std::optional<double> gradient;
  std::vector<int> steps;
};

using ByComponent = std::map<std::pair<int, int>, OverSteps>;

ByComponent GatherOverSteps(const store::SeriesManifest& series) {
  ByComponent gathered;
  for (const store::ScalarVolume& volume : series.volumes) {
    OverSteps& component = gathered[{volume.key.field, volume.key.component}];
    component.range.min = std::min(component.range.min, volume.value_range.min);
    component.range.max = std::max(component.range.max, volume.value_range.max);
    if (volume.max_gradient_magnitude.has_value()) {
      component.gradient = std::max(component.gradient.value_or(0), *volume.max_gradient_magnitude);
    }
    component.steps.push_back(volume.key.step);
  }
  return gathered;
}

Json FieldsToJson(const store::SeriesManifest& series) {
  ByComponent gathered = GatherOverSteps(series);
  const isoscope::v1::Dataset served = wire::ToProto(series);
  Json fields = Json::array();
  for (int i = 0; i < static_cast<int>(series.fields.size()); ++i) {
    const store::Field& field = series.fields[static_cast<std::size_t>(i)];
    Json json{{"name", field.name},
              {"long_name", TextOrNull(field.long_name)},
              {"unit", TextOrNull(field.unit)}};
    json["components"] = Json::array();
    std::vector<int> steps = gathered[{i, 0}].steps;
    for (int j = 0; j < static_cast<int>(field.components.size()); ++j) {
      const store::FieldComponent& component = field.components[static_cast<std::size_t>(j)];
      const OverSteps& over = gathered[{i, j}];
      std::vector<int> common;
      std::set_intersection(steps.begin(), steps.end(), over.steps.begin(), over.steps.end(),
                            std::back_inserter(common));
      steps = std::move(common);
      Json component_json{{"name", component.name},
                          {"sample_type", std::string(volume::NameOf(component.scalar_type))},
                          {"value_range", over.range.min <= over.range.max
                                              ? Json::array({over.range.min, over.range.max})
                                              : Json(nullptr)}};
      if (const auto& component_served = served.fields(i).components(j);
          component_served.has_finite_range()) {
        const isoscope::v1::ValueRange& finite = component_served.finite_range();
        component_json["finite_range"] = Json::array({finite.min(), finite.max()});
      }
      component_json["max_gradient_magnitude"] =
          over.gradient.has_value() ? Json(*over.gradient) : Json(nullptr);
      json["components"].push_back(std::move(component_json));
    }
    json["time_steps"] = steps;
    fields.push_back(std::move(json));
  }
  return fields;
}

// By shard: whether its folder holds the volume.
Json MissingVolumesToJson(const store::SeriesDescription& description,
                          std::vector<std::int64_t>* volume_counts) {
  const store::SeriesManifest& series = description.manifest;
  Json missing = Json::array();
  for (int step = 0; step < series.step_count(); ++step) {
    for (int i = 0; i < static_cast<int>(series.fields.size()); ++i) {
      const store::Field& field = series.fields[static_cast<std::size_t>(i)];
      for (int j = 0; j < static_cast<int>(field.components.size()); ++j) {
        const store::ScalarVolumeKey key{.field = i, .component = j, .step = step};
        const bool is_known = series.Find(key) != nullptr;
        Json shards = Json::array();
        for (std::size_t shard = 0; shard < description.shard_directories.size(); ++shard) {
          const std::string& directory = description.shard_directories[shard];
          if (directory.empty()) {
            continue;
          }
          if (is_known && io::IsDirectory(absl::StrCat(directory, "/",
                                                       store::ScalarVolumeDirectoryName(key)))) {
            ++(*volume_counts)[shard];
          } else {
            shards.push_back(shard);
          }
        }
        if (!is_known || !shards.empty()) {
          missing.push_back({{"field", field.name},
                             {"component", field.components[static_cast<std::size_t>(j)].name},
                             {"step", step},
                             {"shards", std::move(shards)}});
        }
      }
    }
  }
  return missing;
}

// "0, 0.1, 0.2, ..., 4.9 s".
std::string DescribeTimes(const Json& series) {
  constexpr std::size_t kMaxTimes = 8;
  const Json& steps = series.at("time_steps");
  std::vector<std::string> times;
  for (std::size_t i = 0; i < steps.size(); ++i) {
    if (steps.size() > kMaxTimes && i == kMaxTimes / 2) {
      times.push_back("...");
      i = steps.size() - 1;
    }
    times.push_back(steps[i].at("value").dump());
  }
  const std::string unit = TextOf(series, "time_unit");
  return absl::StrCat(absl::StrJoin(times, ", "), unit.empty() ? "" : " ", unit);
}

// Adds "in_source" if the samples of the first volume, and so of all, are there.
void AddSource(const store::SeriesDescription& description, Json* json) {
  for (const std::string& directory : description.shard_directories) {
    if (directory.empty() || description.manifest.volumes.empty()) {
      continue;
    }
    const auto samples =
        store::SamplesOfVolume(directory, description.manifest.volumes.front().key);
    if (samples.ok() && samples->has_value()) {
      const math::Index3& unit = (*samples)->unit_dims;
      (*json)["in_source"] = {{"path", (*samples)->request.at("path")},
                              {"unit_dims", {unit.x, unit.y, unit.z}}};
    }
    return;
  }
}

}  // namespace

std::string DescribeSteps(const Json& series) {
  std::string text;
  const std::size_t step_count = series.at("time_steps").size();
  AddLine("steps", step_count == 0 ? "1, without a time" : absl::StrCat(step_count), &text);
  if (step_count > 0) {
    AddLine("times", DescribeTimes(series), &text);
  }
  return text;
}

std::string DescribeMissing(const Json& series) {
  constexpr std::size_t kMaxSteps = 8;
  std::vector<std::pair<std::string, std::vector<std::string>>> groups;
  for (const Json& volume : series.at("missing_volumes")) {
    const std::string component = TextOf(volume, "component");
    const std::string shards = Joined(volume.at("shards"), ", ");
    const std::string what =
        absl::StrCat(TextOf(volume, "field"), component.empty() ? "" : " ", component, "|",
                     shards.empty() ? "" : absl::StrCat(" in shards ", shards));
    auto group = std::find_if(groups.begin(), groups.end(),
                              [&](const auto& known) { return known.first == what; });
    if (group == groups.end()) {
      group = groups.insert(groups.end(), {what, {}});
    }
    group->second.push_back(volume.at("step").dump());
  }
  std::string text;
  for (auto& [what, steps] : groups) {
    const std::size_t count = steps.size();
    if (count > kMaxSteps) {
      steps.resize(kMaxSteps);
      steps.push_back("...");
    }
    const std::size_t bar = what.rfind('|');
    AddLine("missing",
            absl::StrCat(what.substr(0, bar), count == 1 ? " at step " : " at steps ",
                         absl::StrJoin(steps, ", "), what.substr(bar + 1)),
            &text);
  }
  return text;
}

std::string DescribeFields(const Json& series, int max_width) {
  Table table = Table::OfColumns({{.title = "field", .is_left = true, .is_flexible = true},
                                  {.title = "component", .is_left = true},
                                  {.title = "unit", .is_left = true},
                                  {.title = "type", .is_left = true},
                                  {.title = "values", .is_left = true},
                                  {.title = "steps"}});
  for (const Json& field : series.at("fields")) {
    const std::string long_name = TextOf(field, "long_name");
    std::string name = absl::StrCat(TextOf(field, "name"),
                                    long_name.empty() ? "" : absl::StrCat(" (", long_name, ")"));
    std::string steps = absl::StrCat(field.at("time_steps").size());
    for (const Json& component : field.at("components")) {
      const Json& range = component.at("value_range");
      table.AddRow(
          {name, TextOf(component, "name"), TextOf(field, "unit"), TextOf(component, "sample_type"),
           range.is_null() ? "none that is finite"
                           : absl::StrCat(range[0].get<double>(), " to ", range[1].get<double>()),
           steps});
      name.clear();
      steps.clear();
    }
  }
  return table.ToString(max_width);
}

Json SeriesDirectoryToJson(const store::SeriesDescription& description) {
  const store::SeriesManifest& series = description.manifest;
  const volume::GridGeometry& geometry = series.geometry;
  const auto layout = volume::BlockLayout::Make(geometry.sample_dims, series.block_cells);
  Json json;
  json["name"] = series.name;
  json["dataset_id"] = series.dataset_id;
  json["source"] = series.source;
  json["sample_dims"] = ArrayOf(geometry.sample_dims);
  json["spacing"] = ArrayOf(geometry.spacing);
  json["origin"] = ArrayOf(geometry.origin);
  json["direction"] = Json::array();
  for (const math::Vec3d& column : geometry.direction.columns) {
    json["direction"].push_back(ArrayOf(column));
  }
  json["length_unit"] = TextOrNull(series.length_unit);
  json["fields"] = FieldsToJson(series);
  json["time_steps"] = Json::array();
  for (std::size_t step = 0; step < series.times.size(); ++step) {
    json["time_steps"].push_back({{"number", step}, {"value", series.times[step]}});
  }
  json["time_unit"] = TextOrNull(series.time_unit);
  json["block_cells"] = ArrayOf(series.block_cells);
  json["block_count"] = layout.ok() ? layout->block_count() : 0;
  json["shard_count"] = series.shard_count;
  json["patient_frame"] =
      series.patient_frame.has_value() ? Json(series.patient_frame->name()) : Json(nullptr);
  std::vector<std::int64_t> volume_counts(description.shard_directories.size(), 0);
  json["missing_volumes"] = MissingVolumesToJson(description, &volume_counts);
  json["missing_shards"] = Json::array();
  Json shards = Json::array();
  for (std::size_t shard = 0; shard < description.shard_directories.size(); ++shard) {
    const std::string& directory = description.shard_directories[shard];
    if (directory.empty()) {
      json["missing_shards"].push_back(shard);
    } else {
      shards.push_back({{"shard", shard},
                        {"volume_count", volume_counts[shard]},
                        {"file_bytes", io::BytesBelow(directory)}});
    }
  }
  json["distribution"] = std::string(store::NameOf(store::Distribution::kRandom));
  json["seed"] = series.seed;
  json["shards"] = std::move(shards);
  AddSource(description, &json);
  if (series.highest_level() > 0) {
    json["levels"] = LevelsToJson(series);
  }
  AddLabels(series.labels, &json);
  return json;
}

}  // namespace isoscope::cli
