// AddSource adds these to the JSON of `info`, from which DescribeSource makes the text:
//
// 1. Fields, each with the ranges of its components if values were read; paths of other grids.
// 2. Steps and units.
// 3. The needs of `partition`. A field has a volume for each component, and one for the magnitude
//    if it has several components; all that times the steps.
// 4. The commands to draw it: `render` for a single volume, else `partition` and `render`.
//
// Blocks overlap: an axis of 17 samples has two blocks of 8 cells. Each stores 9 samples and one
// more on its inner side for gradients, so both store 20 (StoredSamples).

#include "client-cli/output/source_json.h"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include <nlohmann/json.hpp>

#include "client-cli/output/info_lines.h"
#include "client-cli/output/round_value.h"
#include "core/base/printable.h"
#include "core/base/shell_word.h"
#include "core/base/units.h"
#include "core/cli/format.h"
#include "core/cli/table.h"
#include "core/source/series_parts.h"
#include "core/volume/block_layout.h"
#include "core/volume/scalar_span.h"

namespace isoscope::cli {
namespace {

// Samples of all blocks along an axis: each has its cells, one sample more, and one on either side
// for gradients, as far as the volume goes.
double StoredSamples(std::int64_t size, std::int64_t cells) {
  const std::int64_t blocks = (size - 2) / cells + 1;
  return static_cast<double>(size - 1 + 3 * blocks - 2);
}

std::string FieldsText(const Json& fields) {
  std::vector<source::SourceField> described;
  for (const Json& field : fields) {
    described.push_back({.name = field.at("name").get<std::string>(),
                         .unit = field.at("unit").get<std::string>(),
                         .components = field.at("components").get<std::vector<std::string>>()});
  }
  return base::Printable(source::DescribeFields(described));
}

std::string StepsText(const Json& volume) {
  return base::Printable(source::DescribeSteps(volume.at("time_steps").get<std::vector<double>>(),
                                               volume.at("time_unit").get<std::string>()));
}

// "-1.0 to 4.0, and 3 infinite samples".
std::string RangeText(const Json& range, std::int64_t infinite_count) {
  return absl::StrCat(range.is_null()
                          ? "none that is finite"
                          : absl::StrCat(range.at(0).dump(), " to ", range.at(1).dump()),
                      DescribeInfinite(infinite_count));
}

// A line for each component of each field.
void AddRangeLines(const Json& volume, std::string* text) {
  constexpr int kMaxLines = 50;
  const auto steps = volume.at("value_range_steps").get<std::size_t>();
  if (steps == 0) {
    AddLine("values", "not read: --values reads them all", text);
    return;
  }
  const char* label = "values";
  if (steps < volume.at("time_steps").size()) {
    AddLine(label, "of the first step; --values reads all steps", text);
    label = "";
  }
  int lines = 0;
  for (const Json& field : volume.at("fields")) {
    const Json& components = field.at("components");
    for (std::size_t i = 0; i < components.size(); ++i) {
      if (++lines > kMaxLines) {
        AddLine("", "and more: --json tells all", text);
        return;
      }
      const auto component = components.at(i).get<std::string>();
      AddLine(
          label,
          base::Printable(absl::StrCat(
              field.at("name").get<std::string>(), component.empty() ? "" : ":", component, "  ",
              RangeText(field.at("value_ranges").at(i), field.at("infinite_counts").at(i)))),
          text);
      label = "";
    }
  }
}

// "ome.zarr:1, ome.zarr:labels/cells": each can be given in place of the path.
std::string ElsewhereText(const Json& paths) {
  constexpr std::size_t kMaxPaths = 10;
  std::string text;
  for (std::size_t i = 0; i < std::min(paths.size(), kMaxPaths); ++i) {
    absl::StrAppend(&text, i == 0 ? "" : ", ", base::ShellWord(paths.at(i).get<std::string>()));
  }
  if (paths.size() > kMaxPaths) {
    absl::StrAppend(&text, ", and ", paths.size() - kMaxPaths, " more: --json tells all");
  }
  return base::Printable(text);
}

// The volume to draw among several: the first component with an isovalue that has a surface.
struct DrawnField {
  std::string flag{};      // " --field u:x"; "" if there is no choice
  std::string isovalue{};  // "VALUE" if no values were read; "" if none has a surface
};

// An isovalue in the middle that has a surface, with few digits; "": there is none.
std::string MiddleIsovalueOf(const volume::ScalarSpan& span) {
  std::string text = source::MiddleIsovalue(span);
  double middle = 0;
  if (!absl::SimpleAtod(text, &middle)) {
    return text;
  }
  const double rounded = RoundedValue(middle, span.min, span.max);
  return volume::IsActive(span, rounded) ? FormatValue(rounded) : text;
}

DrawnField DrawnFieldOf(const source::VolumeSeries& series, const SourceRanges& ranges) {
  const std::vector<source::SourceField>& fields = series.info().fields;
  if (ranges.steps == 0) {
    return {
        .flag = fields.size() > 1 ? absl::StrCat(" --field ", base::ShellWord(fields[0].name)) : "",
        .isovalue = "VALUE"};
  }
  for (std::size_t i = 0; i < fields.size(); ++i) {
    const std::vector<std::string>& components = fields[i].components;
    for (std::size_t k = 0; k < components.size(); ++k) {
      std::string isovalue = MiddleIsovalueOf(ranges.ranges[i][k].span);
      if (isovalue.empty()) {
        continue;
      }
      const std::string name =
          components.size() > 1 ? absl::StrCat(fields[i].name, ":", components[k]) : fields[i].name;
      const bool is_only = fields.size() == 1 && components.size() == 1;
      return {.flag = is_only ? "" : absl::StrCat(" --field ", base::ShellWord(name)),
              .isovalue = std::move(isovalue)};
    }
  }
  return {};
}

}  // namespace

PartitionNeeds EstimatePartition(const math::Index3& dims, volume::ScalarType type,
                                 std::int64_t volume_count) {
  constexpr double kProcessBytes = 52.0 * base::kMiB;
  constexpr double kMemoryLimitBytes = 1.0 * base::kGiB;  // of partition, by default
  constexpr double kIndexBytes = 40;                      // of a block
  constexpr double kBytesPerSecond = 100.0 * base::kMiB;
  const math::Index3 cells = volume::DefaultBlockCells(dims);
  const auto sample_bytes = static_cast<double>(volume::SizeOf(type));
  double stored = sample_bytes;
  double blocks = 1;
  for (int axis = 0; axis < 3; ++axis) {
    stored *= StoredSamples(dims[axis], cells[axis]);
    blocks *= static_cast<double>((dims[axis] - 2) / cells[axis] + 1);
  }
  const double source_bytes = static_cast<double>(math::Volume(dims)) * sample_bytes;
  const auto volumes = static_cast<double>(volume_count);
  constexpr double kMaxBytes = 0x1p62;
  return {
      .disk_bytes =
          static_cast<std::int64_t>(std::min((stored + kIndexBytes * blocks) * volumes, kMaxBytes)),
      .memory_bytes =
          static_cast<std::int64_t>(std::min(kProcessBytes + source_bytes / 4, kMemoryLimitBytes)),
      .seconds = source_bytes * volumes / kBytesPerSecond};
}

void AddSource(const source::VolumeSeries& series, const source::VolumeSource& first,
               const SourceRanges& ranges, const std::string& input, const std::string& drawn_input,
               Json* volume) {
  (*volume)["fields"] = Json::array();
  std::int64_t volumes = 0;
  for (std::size_t i = 0; i < series.info().fields.size(); ++i) {
    const source::SourceField& field = series.info().fields[i];
    Json described = {{"name", field.name}, {"unit", field.unit}, {"components", field.components}};
    if (ranges.steps > 0) {
      described["value_ranges"] = Json::array();
      described["infinite_counts"] = Json::array();
      for (const auto& [span, infinite_count] : ranges.ranges[i]) {
        described["value_ranges"].push_back(span.min <= span.max ? Json::array({span.min, span.max})
                                                                 : Json(nullptr));
        described["infinite_counts"].push_back(infinite_count);
      }
    }
    (*volume)["fields"].push_back(std::move(described));
    volumes += static_cast<std::int64_t>(field.components.size()) +
               (field.components.size() > 1 ? 1 : 0);  // and the magnitude
  }
  for (const std::string& name : series.info().fields_elsewhere) {
    (*volume)["elsewhere"].push_back(absl::StrCat(series.info().name, ":", name));
  }
  volumes *= series.info().step_count();
  (*volume)["time_steps"] = series.info().times;
  (*volume)["time_unit"] = series.info().time_unit;
  (*volume)["length_unit"] = series.info().length_unit;
  const PartitionNeeds needs =
      EstimatePartition(first.info().geometry.sample_dims, first.info().type, volumes);
  (*volume)["partition"] = {{"disk_bytes", needs.disk_bytes},
                            {"memory_bytes", needs.memory_bytes},
                            {"seconds", needs.seconds}};
  if (volumes != 1) {
    (*volume)["value_range_steps"] = ranges.steps;
  }
  Json commands = Json::array();
  if (volumes == 1) {
    const auto range = volume->find("value_range");
    const std::string isovalue = range == volume->end() ? "VALUE"
                                 : range->is_null()
                                     ? ""
                                     : MiddleIsovalueOf({range->at(0), range->at(1)});
    if (!isovalue.empty()) {
      commands.push_back(absl::StrCat("isoscope render ", drawn_input, " --isovalue ", isovalue));
    }
  } else {
    const DrawnField drawn = DrawnFieldOf(series, ranges);
    commands.push_back(absl::StrCat("isoscope partition ", input, " --output DIR"));
    if (!drawn.isovalue.empty()) {
      commands.push_back(
          absl::StrCat("isoscope render DIR", drawn.flag, " --isovalue ", drawn.isovalue));
    }
  }
  (*volume)["commands"] = std::move(commands);
}

std::string DescribeSource(const Json& volume) {
  std::string text;
  AddLine("fields", FieldsText(volume.at("fields")), &text);
  if (volume.contains("elsewhere")) {
    AddLine("elsewhere", ElsewhereText(volume.at("elsewhere")), &text);
  }
  AddLine("steps", StepsText(volume), &text);
  if (volume.contains("value_range_steps")) {
    AddRangeLines(volume, &text);
  }
  const std::string unit = base::Printable(volume.at("length_unit").get<std::string>());
  if (!unit.empty()) {
    AddLine("unit", absl::StrCat(unit, " of spacing and origin"), &text);
  }
  const Json& needs = volume.at("partition");
  const double seconds = needs.at("seconds").get<double>();
  AddLine("partition",
          absl::StrFormat("about %s on disk, %s of memory at most, %s",
                          FormatMebibytes(needs.at("disk_bytes").get<std::int64_t>()),
                          FormatMebibytes(needs.at("memory_bytes").get<std::int64_t>()),
                          seconds < 1 ? "a second" : absl::StrFormat("%.0f s", seconds)),
          &text);
  const char* name = "draw";
  if (volume.at("commands").empty()) {
    AddLine(name, "nothing: no two finite samples differ, so no isovalue has a surface", &text);
  }
  for (const Json& command : volume.at("commands")) {
    AddLine(name, base::Printable(command.get<std::string>()), &text);
    name = "";
  }
  return text;
}

Json SeriesEntriesToJson(const std::vector<source::SeriesEntry>& entries) {
  Json json;
  json["series"] = Json::array();
  for (const source::SeriesEntry& entry : entries) {
    json["series"].push_back({{"number", entry.number},
                              {"description", entry.description},
                              {"uid", entry.uid},
                              {"width", entry.width},
                              {"height", entry.height},
                              {"images", entry.images},
                              {"folder", entry.folder},
                              {"first_file", entry.first_file}});
  }
  return json;
}

std::string DescribeSeriesEntries(const Json& json, const std::string& input) {
  const Json& all = json.at("series");
  const bool has_folders = std::any_of(all.begin(), all.end(), [](const Json& series) {
    return !series.at("folder").get<std::string>().empty();
  });
  std::vector<std::string> head{"series", "description", "images", "width", "height", "UID"};
  if (has_folders) {
    head.push_back("folder");
  }
  Table table(head);
  for (const Json& series : all) {
    std::vector<std::string> row{
        series.at("number").dump(), base::Printable(series.at("description").get<std::string>()),
        series.at("images").dump(), series.at("width").dump(),
        series.at("height").dump(), series.at("uid").get<std::string>()};
    if (has_folders) {
      row.push_back(base::Printable(series.at("folder").get<std::string>()));
    }
    table.AddRow(std::move(row));
  }
  // The number, if no other series has it.
  const Json& first = all.front();
  const auto same = std::count_if(all.begin(), all.end(), [&first](const Json& series) {
    return series.at("number") == first.at("number");
  });
  return absl::StrCat(table.ToString(), "\nchoose one, as in: isoscope info ", input, " --series ",
                      same == 1 ? first.at("number").dump() : first.at("uid").get<std::string>(),
                      "\n");
}

}  // namespace isoscope::cli
