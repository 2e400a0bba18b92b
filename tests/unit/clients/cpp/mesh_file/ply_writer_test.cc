#include "clients/cpp/mesh_file/ply_writer.h"

#include <cstdint>
#include <filesystem>
#include <string>

#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::client {
namespace {

using ::isoscope::testing::TempDir;

// Two pieces: a triangle, then a vertex more and a triangle with it.
absl::Status WriteTwoPieces(const MeshFileOptions& options) {
  absl::StatusOr<std::unique_ptr<MeshWriter>> writer = CreatePly(options);
  if (!writer.ok()) {
    return writer.status();
  }
  ISOSCOPE_EXPECT_OK((*writer)->Add({.positions = {0, 0, 0, 1, 0, 0, 0, 1, 0},
                                     .normals = {0, 0, 1, 0, 0, 1, 0, 0, 1},
                                     .triangles = {0, 1, 2}}));
  ISOSCOPE_EXPECT_OK(
      (*writer)->Add({.positions = {1, 1, 0}, .normals = {0, 1, 0}, .triangles = {1, 3, 2}}));
  const absl::Status finished = (*writer)->Finish();
  EXPECT_EQ((*writer)->vertex_count(), 4);
  EXPECT_EQ((*writer)->triangle_count(), 2);
  EXPECT_EQ((*writer)->size_bytes(),
            static_cast<std::int64_t>(std::filesystem::file_size(options.path)));
  return finished;
}

// 1.0F is 00 00 80 3f.
const std::string& Zero() {
  static const std::string* const bytes = new std::string(4, '\0');
  return *bytes;
}
const std::string& One() {
  static const std::string* const bytes = new std::string("\x00\x00\x80\x3f", 4);
  return *bytes;
}

TEST(PlyWriterTest, TwoPiecesGiveExactlyTheseBytes) {
  const TempDir folder;
  const std::string path = folder.Sub("mesh.ply");
  ISOSCOPE_ASSERT_OK(WriteTwoPieces({.path = path}));
  std::string expected =
      "ply\n"
      "format binary_little_endian 1.0\n"
      "comment isoscope ...........................\n"
      "element vertex 4\n"
      "property float x\nproperty float y\nproperty float z\n"
      "property float nx\nproperty float ny\nproperty float nz\n"
      "element face 2\n"
      "property list uchar int vertex_indices\n"
      "end_header\n";
  expected += Zero() + Zero() + Zero() + Zero() + Zero() + One();
  expected += One() + Zero() + Zero() + Zero() + Zero() + One();
  expected += Zero() + One() + Zero() + Zero() + Zero() + One();
  expected += One() + One() + Zero() + Zero() + One() + Zero();
  expected += std::string("\x03\x00\x00\x00\x00\x01\x00\x00\x00\x02\x00\x00\x00", 13);
  expected += std::string("\x03\x01\x00\x00\x00\x03\x00\x00\x00\x02\x00\x00\x00", 13);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string content, io::ReadWholeFile(path, 10'000));
  EXPECT_EQ(content, expected);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()),
                          std::filesystem::directory_iterator()),
            1);
}

TEST(PlyWriterTest, ColorsFollowEachNormal) {
  const TempDir folder;
  const std::string path = folder.Sub("mesh.ply");
  ISOSCOPE_ASSERT_OK(WriteTwoPieces(
      {.path = path, .surfaces = {{.color = frame::Color{.red = 1, .green = 0.5F, .blue = 0}}}}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string content, io::ReadWholeFile(path, 10'000));
  const std::string header = MakePlyHeader(4, 2, {.has_colors = true});
  EXPECT_NE(header.find("property uchar red\nproperty uchar green\nproperty uchar blue\n"),
            std::string::npos);
  ASSERT_EQ(content.substr(0, header.size()), header);
  EXPECT_EQ(content.size(), header.size() + 4 * 27 + 2 * 13);
  EXPECT_EQ(content.substr(header.size() + 24, 3), std::string("\xff\x80\x00", 3));
}

TEST(PlyWriterTest, EmptySurfaceIsAValidFile) {
  const TempDir folder;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto writer, CreatePly({.path = folder.Sub("mesh.ply")}));
  ISOSCOPE_ASSERT_OK(writer->Finish());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string content,
                                io::ReadWholeFile(folder.Sub("mesh.ply"), 10'000));
  EXPECT_EQ(content, MakePlyHeader(0, 0));
}

TEST(PlyWriterTest, HeaderLengthDoesNotDependOnTheCounts) {
  const std::size_t size = MakePlyHeader(0, 0).size();
  EXPECT_EQ(MakePlyHeader(kMaxVertexCount, INT64_MAX).size(), size);
  EXPECT_EQ(MakePlyHeader(12, 345).size(), size);
}

// An origin: x, y and z are doubles, and the sums of origin and offset.
TEST(PlyWriterTest, PositionsFarFromTheOriginAreDoubles) {
  const TempDir folder;
  const std::string path = folder.Sub("mesh.ply");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto writer, CreatePly({.path = path}));
  const math::Vec3d origin{500000, 4600000, -0.5};
  ISOSCOPE_ASSERT_OK(writer->Add(
      {.positions = {0.015625F, 0, 0}, .normals = {0, 0, 1}, .triangles = {}, .origin = origin}));
  ISOSCOPE_ASSERT_OK(writer->Add({.positions = {0, 0.25F, 1},
                                  .normals = {0, 0, 1},
                                  .triangles = {0, 1, 0},
                                  .origin = origin}));
  ISOSCOPE_ASSERT_OK(writer->Finish());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, io::ReadWholeFile(path, 10'000));
  const std::string header = MakePlyHeader(2, 1, {.has_doubles = true});
  EXPECT_NE(header.find("property double x\nproperty double y\nproperty double z\n"
                        "property float nx\n"),
            std::string::npos);
  ASSERT_EQ(bytes.size(), header.size() + 2 * 36 + 13);
  EXPECT_EQ(bytes.substr(0, header.size()), header);
  const auto at = [&](std::size_t offset) {
    return base::LoadLittleEndian<double>(bytes.data() + header.size() + offset);
  };
  EXPECT_EQ(at(0), 500000.015625);
  EXPECT_EQ(at(8), 4600000);
  EXPECT_EQ(at(36 + 8), 4600000.25);
  EXPECT_EQ(at(36 + 16), 0.5);
  EXPECT_EQ(writer->size_bytes(), static_cast<std::int64_t>(bytes.size()));
}

TEST(PlyWriterTest, ASurfaceIndexOfMoreThanAByteIsAnInt) {
  const TempDir folder;
  for (const std::size_t count : {std::size_t{256}, std::size_t{257}}) {
    const std::string path = folder.Sub("mesh.ply");
    const bool is_wide = count > 256;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto writer, CreatePly({.path = path, .surfaces = std::vector<MeshSurface>(count)}));
    const int last = static_cast<int>(count) - 1;
    ISOSCOPE_ASSERT_OK(writer->Add(
        {.positions = {0, 0, 0}, .normals = {0, 0, 1}, .triangles = {}, .surface_index = last}));
    ISOSCOPE_ASSERT_OK(writer->Finish());
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, io::ReadWholeFile(path, 10'000));
    const std::string header =
        MakePlyHeader(1, 0, {.has_surface_index = true, .has_wide_index = is_wide});
    EXPECT_EQ(header.find("property int surface_index\n") != std::string::npos, is_wide);
    ASSERT_EQ(bytes.size(), header.size() + (is_wide ? 28 : 25));
    EXPECT_EQ(bytes.substr(header.size() + 24), is_wide ? std::string("\0\1\0\0", 4) : "\xff");
  }
}

TEST(PlyWriterTest, VerticesOfSeveralSurfacesSayWhichIsTheirs) {
  const TempDir folder;
  const std::string path = folder.Sub("mesh.ply");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto writer, CreatePly({.path = path, .surfaces = {{.isovalue = 1}, {.isovalue = 2}}}));
  ISOSCOPE_ASSERT_OK(writer->Add({.positions = {0, 0, 0}, .normals = {0, 0, 1}, .triangles = {}}));
  ISOSCOPE_ASSERT_OK(writer->Add(
      {.positions = {1, 1, 1}, .normals = {0, 0, 1}, .triangles = {}, .surface_index = 1}));
  ISOSCOPE_ASSERT_OK(writer->Finish());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, io::ReadWholeFile(path, 10'000));
  const std::string header = MakePlyHeader(2, 0, {.has_surface_index = true});
  EXPECT_NE(header.find("float nz\nproperty uchar surface_index\nelement face 0"),
            std::string::npos);
  ASSERT_EQ(bytes.size(), header.size() + std::size_t{2 * 25});
  EXPECT_EQ(bytes.substr(0, header.size()), header);
  EXPECT_EQ(bytes[header.size() + 24], 0);
  EXPECT_EQ(bytes[header.size() + 49], 1);
}

}  // namespace
}  // namespace isoscope::client
