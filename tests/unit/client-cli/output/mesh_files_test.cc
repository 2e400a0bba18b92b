#include "client-cli/output/mesh_files.h"

#include <filesystem>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::cli {
namespace {

using ::isoscope::testing::TempDir;
using ::testing::HasSubstr;

client::MeshPiece Triangle(std::uint32_t first_vertex, int surface_index) {
  return {.positions = {0, 0, 0, 1, 0, 0, 0, 1, static_cast<float>(surface_index)},
          .normals = std::vector<float>(9, 0),
          .triangles = {first_vertex, first_vertex + 1, first_vertex + 2},
          .surface_index = surface_index};
}

client::MeshFileOptions Obj(const TempDir& folder, const std::string& name) {
  return {.path = folder.Sub(name), .format = client::MeshFormat::kObj};
}

TEST(MeshFilesTest, OneFileHasAllSurfaces) {
  const TempDir folder;
  client::MeshFileOptions options = Obj(folder, "all.obj");
  options.surfaces = {{.isovalue = 1}, {.isovalue = 2}};
  MeshFiles files({options});
  EXPECT_FALSE(files.has_file_for_each());
  ISOSCOPE_ASSERT_OK(files.Add(Triangle(0, 0)));
  EXPECT_EQ(files.VertexCountBefore(1), 3);
  ISOSCOPE_ASSERT_OK(files.Add(Triangle(3, 1)));
  ISOSCOPE_ASSERT_OK(files.Finish());
  ASSERT_EQ(files.reports().size(), 1U);
  EXPECT_EQ(files.reports()[0].vertex_count, 6);
  EXPECT_EQ(files.reports()[0].triangle_count, 2);
  EXPECT_THAT(io::ReadWholeFile(options.path, 10'000).value(), HasSubstr("f 4//4 5//5 6//6\n"));
}

// Each counts its own vertices from 1; a surface without pieces is an empty mesh.
TEST(MeshFilesTest, EachSurfaceHasItsFile) {
  const TempDir folder;
  MeshFiles files(
      {Obj(folder, "0.obj"), Obj(folder, "1.obj"), Obj(folder, "2.obj"), Obj(folder, "3.obj")});
  EXPECT_TRUE(files.has_file_for_each());
  ISOSCOPE_ASSERT_OK(files.Add(Triangle(0, 0)));
  EXPECT_EQ(files.VertexCountBefore(2), 0);
  ISOSCOPE_ASSERT_OK(files.Add(Triangle(0, 2)));
  EXPECT_TRUE(std::filesystem::exists(folder.Sub("0.obj"))) << "finished when the next one begins";
  EXPECT_FALSE(std::filesystem::exists(folder.Sub("2.obj")));
  ISOSCOPE_ASSERT_OK(files.Finish());
  ASSERT_EQ(files.reports().size(), 4U);
  for (std::size_t i = 0; i < 4; ++i) {
    const MeshFileReport& report = files.reports()[i];
    EXPECT_EQ(report.path, folder.Sub(std::to_string(i) + ".obj"));
    EXPECT_EQ(report.triangle_count, i % 2 == 0 ? 1 : 0);
    EXPECT_EQ(report.size_bytes,
              static_cast<std::int64_t>(std::filesystem::file_size(report.path)));
  }
  const std::string third = io::ReadWholeFile(folder.Sub("2.obj"), 10'000).value();
  EXPECT_THAT(third, HasSubstr("v 0 1 2\n"));
  EXPECT_THAT(third, HasSubstr("f 1//1 2//2 3//3\n"));
}

TEST(MeshFilesTest, TheOriginOfPiecesIsKept) {
  const TempDir folder;
  MeshFiles files({Obj(folder, "a.obj")});
  EXPECT_FALSE(files.origin().has_value());
  client::MeshPiece far = Triangle(0, 0);
  far.origin = math::Vec3d{500000, 0, 0};
  ISOSCOPE_ASSERT_OK(files.Add(far));
  EXPECT_EQ(files.origin(), (math::Vec3d{500000, 0, 0}));
}

TEST(MeshFilesTest, AnEndWithoutFinishLeavesNoFile) {
  const TempDir folder;
  {
    MeshFiles files({Obj(folder, "a.obj"), Obj(folder, "b.obj")});
    ISOSCOPE_ASSERT_OK(files.Add(Triangle(0, 0)));
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

}  // namespace
}  // namespace isoscope::cli
