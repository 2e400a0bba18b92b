// JSON is made first, from messages, sources or folders; the text for users is made from the JSON.
// So both agree, and every member that the text needs is available to scripts, too.
//
//   Dataset, source or folder -> DatasetToJson, VolumeToJson, ... -> Json -> Describe... -> text

#include "client-cli/output/dataset_json.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"
#include <nlohmann/json.hpp>

#include "client-cli/output/info_lines.h"
#include "client-cli/output/label_json.h"
#include "client-cli/output/level_json.h"
#include "client-cli/output/series_json.h"
#include "core/cli/format.h"
#include "core/cli/table.h"
#include "core/volume/label.h"
#include "wire/proto_convert.h"

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;

Json ToJson(const v1::Dimensions& dims) { return Json::array({dims.x(), dims.y(), dims.z()}); }
// Adding 0 turns -0 into 0.
Json ToJson(const v1::Vec3& v) { return Json::array({v.x() + 0.0, v.y() + 0.0, v.z() + 0.0}); }

// "SAMPLE_TYPE_UINT8" becomes "uint8".
std::string WithoutPrefix(absl::string_view name, absl::string_view prefix) {
  return absl::AsciiStrToLower(absl::StripPrefix(name, prefix));
}

// Adds "sample_dims", "spacing", "origin", "direction".
void AddGeometry(const v1::GridGeometry& geometry, Json* json) {
  (*json)["sample_dims"] = ToJson(geometry.sample_dims());
  (*json)["spacing"] = ToJson(geometry.spacing());
  (*json)["origin"] = ToJson(geometry.origin());
  Json& direction = (*json)["direction"];
  direction = Json::array({{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}});
  if (geometry.direction_columns_size() == 3) {
    for (int column = 0; column < 3; ++column) {
      direction[static_cast<std::size_t>(column)] = ToJson(geometry.direction_columns(column));
    }
  }
}

// Adds "sample_type", "value_range".
void AddSamples(v1::SampleType type, bool has_range, double min, double max, Json* json) {
  (*json)["sample_type"] = WithoutPrefix(v1::SampleType_Name(type), "SAMPLE_TYPE_");
  (*json)["value_range"] = has_range ? Json::array({min, max}) : Json(nullptr);
}

// Adds "finite_range" if a Dataset or a FieldComponent has one.
template <typename Message>
void AddFiniteRange(const Message& message, Json* json) {
  if (message.has_finite_range()) {
    (*json)["finite_range"] =
        Json::array({message.finite_range().min(), message.finite_range().max()});
  }
}

// Adds "length_unit", "time_unit", "fields", "time_steps", as SeriesDirectoryToJson.
void AddFields(const v1::Dataset& dataset, Json* json) {
  (*json)["length_unit"] = TextOrNull(dataset.length_unit());
  (*json)["fields"] = Json::array();
  for (const v1::Field& field : dataset.fields()) {
    Json field_json{{"name", field.name()},
                    {"long_name", TextOrNull(field.long_name())},
                    {"unit", TextOrNull(field.unit())}};
    field_json["components"] = Json::array();
    for (const v1::FieldComponent& component : field.components()) {
      Json component_json{{"name", component.name()}};
      AddSamples(component.sample_type(), component.has_value_range(),
                 component.value_range().min(), component.value_range().max(), &component_json);
      AddFiniteRange(component, &component_json);
      component_json["max_gradient_magnitude"] = component.has_max_gradient_magnitude()
                                                     ? Json(component.max_gradient_magnitude())
                                                     : Json(nullptr);
      field_json["components"].push_back(std::move(component_json));
    }
    field_json["time_steps"] = Json::array();
    for (const int index : field.time_steps()) {
      if (index >= 0 && index < dataset.time_steps_size()) {
        field_json["time_steps"].push_back(dataset.time_steps(index).number());
      }
    }
    (*json)["fields"].push_back(std::move(field_json));
  }
  (*json)["time_steps"] = Json::array();
  for (const v1::TimeStep& step : dataset.time_steps()) {
    (*json)["time_steps"].push_back({{"number", step.number()}, {"value", step.value()}});
  }
  (*json)["time_unit"] = TextOrNull(dataset.time_unit());
}

// Adds "levels" if there are any beside level 0.
void AddServedLevels(const v1::Dataset& dataset, Json* json) {
  for (const v1::DatasetLevel& level : dataset.levels()) {
    (*json)["levels"].push_back(
        {{"level", level.level()},
         {"sample_dims", ToJson(level.geometry().sample_dims())},
         {"spacing", ToJson(level.geometry().spacing())},
         {"block_count", level.block_count()},
         {"filter", WithoutPrefix(v1::DatasetLevel::Filter_Name(level.filter()), "FILTER_")}});
  }
}

// Adds a line for each level that a server has.
void AddServedLevelLines(const Json& levels, std::string* text) {
  for (const Json& level : levels) {
    AddLine(absl::StrCat("level ", level.at("level").dump()),
            absl::StrCat(Joined(level.at("sample_dims"), " x "), " samples, ",
                         FormatCount(level.at("block_count").get<std::int64_t>()), " blocks, ",
                         TextOf(level, "filter")),
            text);
  }
}

// Adds the lines for the members of AddGeometry and AddSamples.
void AddGridLines(const Json& json, const std::string& unit, std::string* text) {
  const std::string type =
      json.contains("sample_type") ? absl::StrCat(" of ", TextOf(json, "sample_type")) : "";
  AddLine("samples", absl::StrCat(Joined(json.at("sample_dims"), " x "), type), text);
  AddLine("spacing", absl::StrCat(Joined(json.at("spacing"), ", "), unit.empty() ? "" : " ", unit),
          text);
  AddLine("origin", Joined(json.at("origin"), ", "), text);
  AddLine("direction",
          absl::StrJoin(json.at("direction"), "; ",
                        [](std::string* out, const Json& column) {
                          absl::StrAppend(out, Joined(column, ", "));
                        }),
          text);
}

// The shards of a folder, which counts the blocks of each, or the volumes of a series.
std::string DescribeShards(const Json& shards, bool is_series) {
  Table table({"shard", is_series ? "volumes" : "blocks", "size"});
  for (const Json& shard : shards) {
    const Json& count = shard.at(is_series ? "volume_count" : "block_count");
    const Json& bytes = shard.at(is_series ? "file_bytes" : "block_bytes");
    table.AddRow({shard.at("shard").dump(), FormatCount(count.get<std::int64_t>()),
                  FormatMebibytes(bytes.get<std::int64_t>())});
  }
  return table.ToString();
}

}  // namespace

std::string DescribeInfinite(std::int64_t count) {
  return count == 0   ? ""
         : count == 1 ? ", and 1 infinite sample"
                      : absl::StrCat(", and ", FormatCount(count), " infinite samples");
}

std::string DescribeValueRange(const Json& json) {
  std::string text;
  const auto range = json.find("value_range");
  AddLine("values",
          absl::StrCat(range == json.end() ? "not read: --values reads them all"
                       : range->is_null()  ? "none that is finite"
                                           : Joined(*range, " to "),
                       DescribeInfinite(json.value("infinite_count", std::int64_t{0}))),
          &text);
  return text;
}

Json DatasetToJson(const v1::Dataset& dataset) {
  Json json;
  json["name"] = dataset.name();
  json["dataset_id"] = dataset.dataset_id();
  if (!dataset.samples_digest().empty()) {
    json["samples_digest"] = dataset.samples_digest();
  }
  json["source"] = dataset.source();
  AddGeometry(dataset.geometry(), &json);
  AddSamples(dataset.sample_type(), dataset.has_value_range(), dataset.value_range().min(),
             dataset.value_range().max(), &json);
  AddFiniteRange(dataset, &json);
  json["max_gradient_magnitude"] =
      dataset.has_max_gradient_magnitude() ? Json(dataset.max_gradient_magnitude()) : Json(nullptr);
  json["block_cells"] = ToJson(dataset.block_cells());
  json["block_count"] = dataset.block_count();
  json["shard_count"] = dataset.shard_count();
  json["patient_frame"] =
      dataset.patient_frame().empty() ? Json(nullptr) : Json(dataset.patient_frame());
  json["missing_shards"] = Json::array();
  for (const int shard : dataset.missing_shards()) {
    json["missing_shards"].push_back(shard);
  }
  AddServedLevels(dataset, &json);
  if (!dataset.fields().empty()) {
    AddFields(dataset, &json);
  }
  // If the labels of a server are damaged, the rest is told all the same.
  AddLabels(
      wire::LabelsFromProto(dataset.labels(), "labels").value_or(std::vector<volume::Label>()),
      &json);
  return json;
}

Json VolumeToJson(const source::VolumeSource& source,
                  const std::optional<source::ValueRange>& values) {
  Json json;
  json["name"] = source.info().name;
  AddGeometry(wire::ToProto(source.info().geometry), &json);
  const source::ValueRange known = values.value_or(source::ValueRange());
  const volume::ScalarSpan& range = known.span;
  AddSamples(wire::ToProto(source.info().type), range.min <= range.max, range.min, range.max,
             &json);
  if (values.has_value()) {
    json["infinite_count"] = known.infinite_count;
  } else {
    json.erase("value_range");
  }
  if (const std::string& note = source.info().note; !note.empty()) {
    json["note"] = note;
  }
  return json;
}

Json AgentToJson(const v1::AgentStatus& agent) {
  Json json;
  json["address"] = agent.address();
  json["state"] = agent.state() == v1::AgentStatus::STATE_REACHABLE     ? "reachable"
                  : agent.state() == v1::AgentStatus::STATE_UNREACHABLE ? "unreachable"
                  : agent.state() == v1::AgentStatus::STATE_OPENING     ? "opening"
                                                                        : "unknown";
  json["message"] = agent.message();
  json["version"] = agent.version();
  json["renderer"] = agent.renderer();
  json["picture_revision"] = agent.picture_revision();
  json["shards"] = Json::array();
  for (const v1::ServedShard& shard : agent.shards()) {
    json["shards"].push_back({{"dataset", shard.dataset()},
                              {"shard", shard.shard_index()},
                              {"block_count", shard.block_count()}});
  }
  if (agent.has_opening()) {
    json["opening"] = {{"shard_count", agent.opening().shard_count()},
                       {"open_shard_count", agent.opening().open_shard_count()},
                       {"table_bytes", agent.opening().table_bytes()},
                       {"read_bytes", agent.opening().read_bytes()}};
  }
  for (const v1::DamagedShard& damaged : agent.damaged_shards()) {
    json["damaged_shards"].push_back({{"dataset", damaged.dataset()},
                                      {"shard", damaged.shard_index()},
                                      {"message", damaged.message()}});
  }
  return json;
}

Json DatasetDirectoryToJson(const store::DatasetDescription& description) {
  const store::Manifest& manifest = description.manifest;
  v1::Dataset dataset = wire::ToProto(manifest);
  for (std::size_t i = 0; i < description.shard_directories.size(); ++i) {
    if (description.shard_directories[i].empty()) {
      dataset.add_missing_shards(static_cast<std::int32_t>(i));
    }
  }
  Json json = DatasetToJson(dataset);
  json["distribution"] = absl::StrCat(store::NameOf(manifest.distribution));
  json["seed"] = manifest.seed;
  json["shards"] = Json::array();
  for (std::size_t i = 0; i < manifest.shards.size(); ++i) {
    json["shards"].push_back({{"shard", i},
                              {"block_count", manifest.shards[i].block_count},
                              {"block_bytes", manifest.shards[i].block_bytes}});
  }
  if (manifest.in_source.has_value()) {
    const math::Index3& unit = manifest.in_source->unit_dims;
    json["in_source"] = {{"path", manifest.in_source->request.at("path")},
                         {"unit_dims", {unit.x, unit.y, unit.z}}};
  }
  if (manifest.highest_level() > 0) {
    json["levels"] = LevelsToJson(manifest, description.shard_directories);
  }
  return json;
}

std::string DescribeVolume(const Json& volume) {
  std::string text;
  AddLine("volume", TextOf(volume, "name"), &text);
  AddGridLines(volume, /*unit=*/"", &text);
  if (volume.contains("note")) {
    AddLine("note", TextOf(volume, "note"), &text);
  }
  return text;
}

std::string DescribeDataset(const Json& dataset, int max_width) {
  std::string text;
  const auto line = [&](absl::string_view name, const std::string& value) {
    AddLine(name, value, &text);
  };
  // Only a series in a folder tells which volumes it lacks.
  const bool is_series_folder = dataset.contains("missing_volumes");
  line("dataset", TextOf(dataset, "name"));
  line("id", TextOf(dataset, "dataset_id"));
  line("source", TextOf(dataset, "source"));
  AddGridLines(dataset, is_series_folder ? TextOf(dataset, "length_unit") : "", &text);
  if (!is_series_folder) {
    absl::StrAppend(&text, DescribeValueRange(dataset));
    if (dataset.at("max_gradient_magnitude").is_number()) {
      line("gradient", absl::StrCat("at most ", dataset.at("max_gradient_magnitude").get<double>(),
                                    " per world unit"));
    }
  }
  if (dataset.at("patient_frame").is_string()) {
    line("patient", absl::StrCat(TextOf(dataset, "patient_frame"), " are world +x, +y, +z"));
  }
  if (is_series_folder) {
    absl::StrAppend(&text, DescribeSteps(dataset), DescribeMissing(dataset));
  }
  line("blocks", absl::StrCat(FormatCount(dataset.at("block_count").get<std::int64_t>()), " of ",
                              Joined(dataset.at("block_cells"), " x "), " cells"));
  const Json& missing = dataset.at("missing_shards");
  line("shards",
       absl::StrCat(
           dataset.at("shard_count").dump(),
           missing.empty() ? std::string() : absl::StrCat(", missing: ", Joined(missing, ", "))));
  const bool is_folder = dataset.contains("shards");
  if (!is_folder && dataset.contains("levels")) {
    AddServedLevelLines(dataset.at("levels"), &text);
  }
  if (is_folder) {
    line("distribution",
         absl::StrCat(TextOf(dataset, "distribution"), ", seed ", dataset.at("seed").dump()));
    if (dataset.contains("in_source")) {
      const Json& in_source = dataset.at("in_source");
      line("samples", absl::StrCat("in ", TextOf(in_source, "path"), ", read in chunks of ",
                                   Joined(in_source.at("unit_dims"), " x ")));
    }
    absl::StrAppend(&text, DescribeLevels(dataset));
  }
  if (dataset.contains("fields")) {
    absl::StrAppend(&text, is_series_folder ? "" : DescribeSteps(dataset), "\n",
                    DescribeFields(dataset, max_width));
  }
  if (is_folder && !(is_series_folder && dataset.at("shards").empty())) {
    absl::StrAppend(&text, "\n", DescribeShards(dataset.at("shards"), is_series_folder));
  }
  return absl::StrCat(text, DescribeLabels(dataset));
}

std::string DescribeAgents(const Json& agents, int max_width) {
  // The number of agents with the same message.
  std::map<std::string, int> agents_of;
  for (const Json& agent : agents) {
    ++agents_of[TextOf(agent, "message")];
  }
  const auto is_shared = [&](const std::string& message) {
    return max_width > 0 && !message.empty() && agents_of[message] > 1;
  };
  std::vector<std::string> shared;
  Table table({"agent", "state", "version", "shards", "renderer", "message"});
  for (const Json& agent : agents) {
    const std::string shards =
        absl::StrJoin(agent.at("shards"), ",", [](std::string* out, const Json& shard) {
          absl::StrAppend(out, TextOf(shard, "dataset"), "/", shard.at("shard").dump());
        });
    std::string message = TextOf(agent, "message");
    if (is_shared(message)) {
      const auto known = std::find(shared.begin(), shared.end(), message);
      const std::ptrdiff_t index = known - shared.begin();
      if (known == shared.end()) {
        shared.push_back(message);
      }
      message = absl::StrCat("[", index + 1, "]");
    }
    table.AddRow({TextOf(agent, "address"), TextOf(agent, "state"), TextOf(agent, "version"),
                  shards, TextOf(agent, "renderer"), message});
  }
  std::string text = table.ToString(max_width);
  for (std::size_t i = 0; i < shared.size(); ++i) {
    const std::string number = absl::StrCat("[", i + 1, "] ");
    const auto width = static_cast<std::size_t>(std::max(max_width, 24));
    absl::StrAppend(&text, "\n", number,
                    absl::StrJoin(WrapText(shared[i], width - number.size()),
                                  "\n" + std::string(number.size(), ' ')),
                    "\n");
  }
  return text;
}

}  // namespace isoscope::cli
