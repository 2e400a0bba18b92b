// Compares with the surfaces that VTK's flying edges extract from real volumes. The volumes are not
// part of the repository: ISOSCOPE_DATA_DIR or ../shared/data; skipped where they are absent.

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "nlohmann/json.hpp"

#include "core/io/file.h"
#include "tests/support/block_cutter.h"
#include "tests/support/mesh_metrics.h"
#include "tests/support/nrrd_file.h"
#include "tests/support/skips.h"

namespace isoscope::extract {
namespace {

std::string DataDir() {
  // NOLINTNEXTLINE(concurrency-mt-unsafe): no thread sets the environment
  const char* dir = std::getenv("ISOSCOPE_DATA_DIR");
  return dir != nullptr ? dir : ISOSCOPE_DEFAULT_DATA_DIR;
}

class VtkReferenceTest : public ::testing::TestWithParam<const char*> {};

TEST_P(VtkReferenceTest, VertexAndTriangleCountsAreEqualAndAreaIsClose) {
  const std::string volume_path = DataDir() + "/" + GetParam() + ".nrrd";
  const std::string reference_path = DataDir() + "/../reference/vtk_isosurfaces.json";
  if (!io::PathExists(volume_path) || !io::PathExists(reference_path)) {
    ISOSCOPE_SKIP("data", "no " + volume_path + " or " + reference_path +
                              "; set ISOSCOPE_DATA_DIR to compare with real volumes");
  }
  const std::optional<testing::NrrdFile> file = testing::ReadNrrd(volume_path);
  ASSERT_TRUE(file.has_value()) << volume_path;
  const nlohmann::json reference =
      nlohmann::json::parse(io::ReadWholeFile(reference_path, std::int64_t{1} << 24).value());
  const nlohmann::json& entry = reference.at("volumes").at(GetParam());

  volume::GridGeometry geometry;
  geometry.sample_dims = file->dims;
  geometry.spacing = {entry["spacing"][0], entry["spacing"][1], entry["spacing"][2]};
  const volume::BlockLayout layout = volume::BlockLayout::Make(file->dims, {16, 16, 16}).value();
  for (const nlohmann::json& surface : entry.at("surfaces")) {
    const double isovalue = surface.at("isovalue");
    SCOPED_TRACE(isovalue);
    const std::vector<mesh::BlockMesh> blocks =
        testing::ExtractAllBlocks(geometry, layout, file->type, file->bytes, isovalue);
    std::int64_t owned = 0;
    for (const mesh::BlockMesh& block : blocks) {
      owned += block.owned_vertex_count;
    }
    const testing::MeshMetrics metrics = testing::Measure(testing::Weld(layout, blocks), geometry);
    const auto vertices = surface.at("vertices").get<std::int64_t>();
    const auto triangles = surface.at("triangles").get<std::int64_t>();
    const double area = surface.value("area", 0.0);
    EXPECT_EQ(owned, vertices);
    EXPECT_EQ(metrics.vertex_count, vertices);
    EXPECT_EQ(metrics.triangle_count, triangles);
    EXPECT_NEAR(metrics.area, area, 0.001 * area);
    EXPECT_EQ(metrics.non_manifold_edge_count, 0);
    EXPECT_EQ(metrics.inconsistent_edge_count, 0);
  }
}

INSTANTIATE_TEST_SUITE_P(ReferenceVolumes, VtkReferenceTest,
                         ::testing::Values("ironprot", "carotid", "headsq_quarter", "headsq_half",
                                           "ct_pitch", "stroke_t1", "stent_small", "vh_head_ct"),
                         [](const auto& param) { return std::string(param.param); });

}  // namespace
}  // namespace isoscope::extract
