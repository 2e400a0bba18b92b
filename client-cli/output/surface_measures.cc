#include "client-cli/output/surface_measures.h"

#include <algorithm>
#include <cstddef>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "clients/cpp/request/render_request.h"
#include "core/base/printable.h"
#include "core/cli/format.h"
#include "core/cli/table.h"

namespace isoscope::cli {
namespace {

constexpr std::size_t kMaxTableRows = 100;

std::string Rounded(double value) { return absl::StrFormat("%.7g", value); }

std::string WithUnit(absl::string_view text, absl::string_view unit, absl::string_view power) {
  return absl::StrCat(text, unit.empty() ? "" : absl::StrCat(" ", base::Printable(unit), power));
}

std::string TitleOf(const MeasuredSurface& of) {
  if (!of.name.empty()) {
    return base::Printable(of.name);
  }
  if (of.surface.labels().empty()) {
    return absl::StrCat("isovalue ", FormatValue(of.surface.isovalue()));
  }
  return absl::StrCat(of.surface.labels_size() == 1 ? "label " : "labels ",
                      absl::StrJoin(of.surface.labels(), ",", [](std::string* out, double value) {
                        out->append(FormatValue(value));
                      }));
}

std::string Openness(const client::SurfaceMeasures& measures) {
  return absl::StrCat("open at ", FormatCount(measures.open_edge_count),
                      measures.open_edge_count == 1 ? " edge" : " edges");
}

nlohmann::ordered_json SurfaceToJson(const MeasuredSurface& of) {
  nlohmann::ordered_json json;
  if (of.surface.labels().empty()) {
    json["isovalue"] = of.surface.isovalue();
  } else {
    json["labels"] = nlohmann::ordered_json::array();
    for (const double label : of.surface.labels()) {
      json["labels"].push_back(label);
    }
  }
  if (!of.name.empty()) {
    json["name"] = of.name;
  }
  const client::SurfaceMeasures& measures = of.measures;
  json["area"] = measures.area;
  json["volume"] = measures.volume.has_value() ? nlohmann::ordered_json(*measures.volume)
                                               : nlohmann::ordered_json(nullptr);
  json["is_closed"] = measures.volume.has_value();
  json["open_edge_count"] = measures.open_edge_count;
  json["triangle_count"] = measures.triangle_count;
  for (const LevelCost& cost : of.levels) {
    json["levels"].push_back({{"level", cost.level},
                              {"max_spacing_px", cost.max_spacing_px},
                              {"active_block_count", cost.active_block_count},
                              {"visible_block_count", cost.visible_block_count},
                              {"triangle_count", cost.triangle_count}});
  }
  return json;
}

// Says that the table has the first rows alone; "" if it has all.
std::string MoreRows(std::size_t surface_count) {
  return surface_count <= kMaxTableRows
             ? ""
             : absl::StrCat("... and ",
                            FormatCount(static_cast<std::int64_t>(surface_count - kMaxTableRows)),
                            " more; JSON lists all\n");
}

}  // namespace

std::vector<MeasuredSurface> MeasuredSurfaces(
    const isoscope::v1::ExportIsosurfaceRequest& request, const std::vector<std::string>& names,
    const std::vector<client::SurfaceMeasures>& measures) {
  isoscope::v1::ExportIsosurfaceRequest whole = request;
  client::PromoteIsovalue(&whole);
  std::vector<MeasuredSurface> list(measures.size());
  for (std::size_t i = 0; i < list.size(); ++i) {
    list[i].surface = whole.surfaces(static_cast<int>(i));
    list[i].measures = measures[i];
  }
  const std::size_t count = std::min(names.size(), list.size());
  for (std::size_t i = 0; i < count; ++i) {
    list[list.size() - count + i].name = names[names.size() - count + i];
  }
  return list;
}

std::string DescribeMeasures(const MeasuredSurface& surface, absl::string_view unit) {
  const client::SurfaceMeasures& measures = surface.measures;
  return absl::StrCat(TitleOf(surface), ": area ", WithUnit(Rounded(measures.area), unit, "^2"),
                      ", ",
                      measures.volume.has_value()
                          ? absl::StrCat("volume ", WithUnit(Rounded(*measures.volume), unit, "^3"))
                          : Openness(measures));
}

nlohmann::ordered_json MeasuresToJson(const std::vector<MeasuredSurface>& surfaces,
                                      const std::string& unit) {
  nlohmann::ordered_json json;
  json["length_unit"] = nullptr;
  if (!unit.empty()) {
    json["length_unit"] = unit;
  }
  json["surfaces"] = nlohmann::ordered_json::array();
  for (const MeasuredSurface& surface : surfaces) {
    json["surfaces"].push_back(SurfaceToJson(surface));
  }
  return json;
}

std::string MeasuresTable(const std::vector<MeasuredSurface>& surfaces, absl::string_view unit,
                          int max_width) {
  Table table(
      {"surface", WithUnit("area", unit, "^2"), WithUnit("volume", unit, "^3"), "triangles"});
  for (std::size_t i = 0; i < std::min(surfaces.size(), kMaxTableRows); ++i) {
    const client::SurfaceMeasures& measures = surfaces[i].measures;
    table.AddRow({TitleOf(surfaces[i]), Rounded(measures.area),
                  measures.volume.has_value() ? Rounded(*measures.volume) : Openness(measures),
                  FormatCount(measures.triangle_count)});
  }
  return absl::StrCat(table.ToString(max_width), MoreRows(surfaces.size()));
}

std::string LevelCostsTable(const std::vector<MeasuredSurface>& surfaces, int max_width) {
  Table table({"surface", "level", "1 sample, px", "active blocks", "drawn", "triangles"});
  bool has_rows = false;
  for (std::size_t i = 0; i < std::min(surfaces.size(), kMaxTableRows); ++i) {
    for (const LevelCost& cost : surfaces[i].levels) {
      has_rows = true;
      table.AddRow({TitleOf(surfaces[i]), absl::StrCat(cost.level),
                    absl::StrFormat("%.2g", cost.max_spacing_px),
                    FormatCount(cost.active_block_count), FormatCount(cost.visible_block_count),
                    FormatCount(cost.triangle_count)});
    }
  }
  return has_rows ? absl::StrCat(table.ToString(max_width), MoreRows(surfaces.size())) : "";
}

}  // namespace isoscope::cli
