#include "web-gateway/api/mesh_answer.h"

#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::gateway {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

// Meshes of one surface, whose files are in a folder of the test.
class MeshAnswerTest : public ::testing::Test {
 protected:
  MeshAnswerTest() { setenv("TMPDIR", folder_.path().c_str(), /*replace=*/1); }
  ~MeshAnswerTest() override { unsetenv("TMPDIR"); }

  absl::StatusOr<std::unique_ptr<MeshAnswer>> Begin(
      std::int64_t max_disk_bytes = 1 << 20, client::MeshFormat format = client::MeshFormat::kGlb) {
    return MeshAnswer::Begin(format, {client::MeshSurface()}, std::nullopt, "me", max_disk_bytes,
                             &budget_);
  }
  // A chunk of one triangle.
  static isoscope::v1::ExportIsosurfaceResponse Triangle() {
    const std::vector<float> positions = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    const std::vector<float> normals = {0, 0, 1, 0, 0, 1, 0, 0, 1};
    const std::vector<std::uint64_t> corners = {0, 1, 2};
    const auto bytes = [](const auto& values) {
      return std::string(reinterpret_cast<const char*>(values.data()),  // NOLINT: little-endian
                         sizeof(values[0]) * values.size());
    };
    isoscope::v1::ExportIsosurfaceResponse chunk;
    chunk.set_positions(bytes(positions));
    chunk.set_normals(bytes(normals));
    chunk.set_triangles(bytes(corners));
    return chunk;
  }
  [[nodiscard]] bool HasFiles() const { return !std::filesystem::is_empty(folder_.path()); }

  testing::TempDir folder_;
  MeshBudget budget_{/*max_per_caller=*/1, /*max_bytes=*/1 << 20};
};

TEST_F(MeshAnswerTest, ChunksBecomeAFileThatOutlivesThem) {
  HttpResponse response;
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<MeshAnswer> mesh, Begin());
    ISOSCOPE_ASSERT_OK(mesh->Add(Triangle()));
    ISOSCOPE_ASSERT_OK(mesh->Add(Triangle()));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(response, mesh->Finish());
  }
  EXPECT_EQ(response.content_type, "model/gltf-binary");
  std::ifstream file(response.file_path, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  EXPECT_EQ(bytes.substr(0, 4), "glTF");
  EXPECT_FALSE(Begin().ok()) << "the answer holds the caller's place";
  response.hold.reset();
  ISOSCOPE_EXPECT_OK(Begin());
  RemoveTemporaryFile(response.file_path);
  EXPECT_FALSE(HasFiles());
}

TEST_F(MeshAnswerTest, AMeshThatIsDroppedLeavesNothing) {
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<MeshAnswer> mesh, Begin());
    ISOSCOPE_ASSERT_OK(mesh->Add(Triangle()));
    EXPECT_TRUE(HasFiles());
  }
  EXPECT_FALSE(HasFiles());
  ISOSCOPE_EXPECT_OK(Begin()) << "nor does it hold the place";
}

// A triangle: 36 bytes each of positions and normals, 12 of indices. While the file is
// assembled, 36 bytes more.
TEST_F(MeshAnswerTest, AMeshMayTakeItsShareOfTheDiskAndNoMore) {
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<MeshAnswer> mesh, Begin(120));
    ISOSCOPE_EXPECT_OK(mesh->Add(Triangle()));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<MeshAnswer> mesh, Begin(119));
  EXPECT_THAT(mesh->Add(Triangle()),
              StatusIs(absl::StatusCode::kResourceExhausted,
                       HasSubstr("84 bytes or more, and the gateway's limit is")));
}

TEST_F(MeshAnswerTest, EachFormatIsAFileOfItsOwnThatTakesItsShare) {
  struct Case {
    client::MeshFormat format;
    const char* begins;
    const char* media_type;
    // Of two triangles: the positions, normals and indices, with what a format repeats.
    std::int64_t peak_bytes;
  };
  for (const Case& c :
       {Case{client::MeshFormat::kPly, "ply\n", "application/octet-stream",
             6 * 24 + 2 * 13 + 2 * 13},
        // The positions stay beside the file, for later triangles.
        Case{client::MeshFormat::kStl, "isoscope, binary STL", "model/stl", 2 * 50 + 6 * 12},
        Case{client::MeshFormat::kGlb, "glTF", "model/gltf-binary", 6 * 24 + 2 * 12 + 6 * 12},
        // Offsets of triangles come last.
        Case{client::MeshFormat::kVtp, "<?xml", "application/octet-stream",
             6 * 24 + 2 * 12 + 2 * 8 + 6 * 12}}) {
    {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<MeshAnswer> small,
                                    Begin(c.peak_bytes - 1, c.format));
      ISOSCOPE_EXPECT_OK(small->Add(Triangle()));
      EXPECT_THAT(small->Add(Triangle()), StatusIs(absl::StatusCode::kResourceExhausted))
          << c.begins;
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<MeshAnswer> mesh,
                                  Begin(c.peak_bytes, c.format));
    ISOSCOPE_EXPECT_OK(mesh->Add(Triangle()));
    ISOSCOPE_EXPECT_OK(mesh->Add(Triangle()));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const HttpResponse response, mesh->Finish());
    EXPECT_EQ(response.content_type, c.media_type);
    std::ifstream file(response.file_path, std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
    EXPECT_EQ(bytes.substr(0, std::string(c.begins).size()), c.begins);
    RemoveTemporaryFile(response.file_path);
    EXPECT_FALSE(HasFiles());
  }
}

TEST_F(MeshAnswerTest, AnObjIsCountedByItsText) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<MeshAnswer> mesh,
                                Begin(1 << 10, client::MeshFormat::kObj));
  absl::Status status;
  int count = 0;
  while (status.ok() && count < 100) {
    status = mesh->Add(Triangle());
    ++count;
  }
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kResourceExhausted));
  EXPECT_GT(count, 5) << "a triangle of this mesh takes some 100 bytes of text";
}

TEST_F(MeshAnswerTest, WithoutAFolderForTemporaryFilesItSaysSo) {
  setenv("TMPDIR", (folder_.path() + "/none").c_str(), /*replace=*/1);
  EXPECT_THAT(Begin(), StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("TMPDIR")));
}

TEST_F(MeshAnswerTest, ADamagedChunkIsRefused) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::unique_ptr<MeshAnswer> mesh, Begin());
  isoscope::v1::ExportIsosurfaceResponse chunk = Triangle();
  chunk.mutable_triangles()->resize(23);
  EXPECT_FALSE(mesh->Add(chunk).ok());
}

}  // namespace
}  // namespace isoscope::gateway
