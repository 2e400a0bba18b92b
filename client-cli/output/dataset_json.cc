// JSON is made first, from messages, sources or folders; the text for users is made from the JSON.
// So both agree, and every member that the text needs is available to scripts, too.
//
//   Dataset, source or folder -> DatasetToJson, VolumeToJson, ... -> Json -> Describe... -> text
//
// Names and messages come from servers and files, so text passes through base::Printable.

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

#include "client-cli/output/json_lines.h"
#include "client-cli/output/label_json.h"
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

// Adds the lines for the members of AddGeometry and AddSamples.
void AddGridLines(const Json& json, std::string* text) {
  AddLine("samples",
          absl::StrCat(Joined(json.at("sample_dims"), " x "), " of ", Text(json, "sample_type")),
          text);
  AddLine("spacing", Joined(json.at("spacing"), ", "), text);
  AddLine("origin", Joined(json.at("origin"), ", "), text);
  AddLine("direction",
          absl::StrJoin(json.at("direction"), "; ",
                        [](std::string* out, const Json& column) {
                          absl::StrAppend(out, Joined(column, ", "));
                        }),
          text);
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
  if (!dataset.fields().empty()) {
    AddFields(dataset, &json);
  }
  // Of a server whose labels are damaged, the rest is told all the same.
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
  return json;
}

std::string DescribeVolume(const Json& volume) {
  std::string text;
  AddLine("volume", Text(volume, "name"), &text);
  AddGridLines(volume, &text);
  if (volume.contains("note")) {
    AddLine("note", Text(volume, "note"), &text);
  }
  return text;
}

std::string DescribeDataset(const Json& dataset) {
  std::string text;
  const auto line = [&text](absl::string_view name, const std::string& value) {
    AddLine(name, value, &text);
  };
  line("dataset", Text(dataset, "name"));
  line("id", Text(dataset, "dataset_id"));
  line("source", Text(dataset, "source"));
  AddGridLines(dataset, &text);
  absl::StrAppend(&text, DescribeValueRange(dataset));
  if (dataset.at("max_gradient_magnitude").is_number()) {
    line("gradient", absl::StrCat("at most ", dataset.at("max_gradient_magnitude").get<double>(),
                                  " per world unit"));
  }
  if (dataset.at("patient_frame").is_string()) {
    line("patient", absl::StrCat(Text(dataset, "patient_frame"), " are world +x, +y, +z"));
  }
  line("blocks", absl::StrCat(FormatCount(dataset.at("block_count").get<std::int64_t>()), " of ",
                              Joined(dataset.at("block_cells"), " x "), " cells"));
  const Json& missing = dataset.at("missing_shards");
  line("shards",
       absl::StrCat(
           dataset.at("shard_count").dump(),
           missing.empty() ? std::string() : absl::StrCat(", missing: ", Joined(missing, ", "))));
  if (dataset.contains("shards")) {
    line("distribution",
         absl::StrCat(Text(dataset, "distribution"), ", seed ", dataset.at("seed").dump()));
    Table table({"shard", "blocks", "size"});
    for (const Json& shard : dataset.at("shards")) {
      table.AddRow({shard.at("shard").dump(),
                    FormatCount(shard.at("block_count").get<std::int64_t>()),
                    FormatMebibytes(shard.at("block_bytes").get<std::int64_t>())});
    }
    absl::StrAppend(&text, "\n", table.ToString());
  }
  return text;
}

std::string DescribeAgents(const Json& agents, int max_width) {
  // The number of agents with the same message.
  std::map<std::string, int> agents_of;
  for (const Json& agent : agents) {
    ++agents_of[Text(agent, "message")];
  }
  const auto is_shared = [&](const std::string& message) {
    return max_width > 0 && !message.empty() && agents_of[message] > 1;
  };
  std::vector<std::string> shared;
  Table table({"agent", "state", "version", "shards", "renderer", "message"});
  for (const Json& agent : agents) {
    const std::string shards =
        absl::StrJoin(agent.at("shards"), ",", [](std::string* out, const Json& shard) {
          absl::StrAppend(out, Text(shard, "dataset"), "/", shard.at("shard").dump());
        });
    std::string message = Text(agent, "message");
    if (is_shared(message)) {
      const auto known = std::find(shared.begin(), shared.end(), message);
      const std::ptrdiff_t index = known - shared.begin();
      if (known == shared.end()) {
        shared.push_back(message);
      }
      message = absl::StrCat("[", index + 1, "]");
    }
    table.AddRow({Text(agent, "address"), Text(agent, "state"), Text(agent, "version"), shards,
                  Text(agent, "renderer"), message});
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
