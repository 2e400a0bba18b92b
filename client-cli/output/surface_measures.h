// The measures of surfaces as text and JSON.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_SURFACE_MEASURES_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_SURFACE_MEASURES_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include <nlohmann/json.hpp>

#include "clients/cpp/mesh_file/mesh_measures.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::cli {

// What a frame of the surface alone costs, drawn from a level.
struct LevelCost {
  std::int64_t level = 0;
  double max_spacing_px = 0;  // as isoscope.v1.DrawnLevel
  std::int64_t active_block_count = 0;
  std::int64_t visible_block_count = 0;  // extracted and drawn
  std::int64_t triangle_count = 0;       // of these
};

struct MeasuredSurface {
  isoscope::v1::Surface surface;
  std::string name;  // of labels; may be empty
  client::SurfaceMeasures measures;
  std::vector<LevelCost> levels = {};  // from level 0 on; empty: the dataset has no others
};

// The surfaces of an export request with their measures. `names`: of labels, by surface, the last
// ones; may be fewer.
//
// REQUIRES: `measures` has one element for each surface of the request
std::vector<MeasuredSurface> MeasuredSurfaces(const isoscope::v1::ExportIsosurfaceRequest& request,
                                              const std::vector<std::string>& names,
                                              const std::vector<client::SurfaceMeasures>& measures);

// Returns "isovalue 60: area 12.5 mm^2, volume 3.25 mm^3", or "liver: area 12.5, open at 12 edges".
//
// unit: of lengths; empty: unknown
std::string DescribeMeasures(const MeasuredSurface& surface, absl::string_view unit);

// Returns {"length_unit", "surfaces": [{"isovalue" or "labels", "name", "area", "volume",
// "is_closed", "open_edge_count", "triangle_count"}]}. "length_unit" is null if it is unknown,
// "volume" of an open surface. "name" is there if it is not empty, and so is "levels": [{"level",
// "max_spacing_px", "active_block_count", "visible_block_count", "triangle_count"}].
nlohmann::ordered_json MeasuresToJson(const std::vector<MeasuredSurface>& surfaces,
                                      const std::string& unit);

// A table of the surfaces, the first 100 of them. max_width: as Table::ToString.
std::string MeasuresTable(const std::vector<MeasuredSurface>& surfaces, absl::string_view unit,
                          int max_width = 0);

// A table of the costs of levels, of the first 100 surfaces; "" if there are none. max_width: as
// Table::ToString.
std::string LevelCostsTable(const std::vector<MeasuredSurface>& surfaces, int max_width = 0);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_SURFACE_MEASURES_H_
