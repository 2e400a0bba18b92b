#include "client-cli/ply_writer.h"

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::cli {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::HasSubstr;

template <typename T>
std::string Bytes(const std::vector<T>& values) {
  std::string bytes;
  for (const T value : values) {
    base::AppendLittleEndian(value, &bytes);
  }
  return bytes;
}

TEST(PlyWriterTest, TwoChunksGiveExactlyTheseBytes) {
  const TempDir folder;
  const std::string path = folder.Sub("mesh.ply");
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto writer, PlyWriter::Create(path));
    ISOSCOPE_ASSERT_OK(writer->AddChunk(Bytes<float>({0, 0, 0, 1, 0, 0, 0, 1, 0}),
                                        Bytes<float>({0, 0, 1, 0, 0, 1, 0, 0, 1}),
                                        Bytes<std::int64_t>({0, 1, 2})));
    ISOSCOPE_ASSERT_OK(writer->AddChunk(Bytes<float>({1, 1, 0}), Bytes<float>({0, 1, 0}),
                                        Bytes<std::int64_t>({1, 3, 2})));
    ISOSCOPE_ASSERT_OK(writer->Finish());
    EXPECT_EQ(writer->vertex_count(), 4);
    EXPECT_EQ(writer->triangle_count(), 2);
  }
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
  // 1.0F is 00 00 80 3f.
  const std::string zero(4, '\0');
  const std::string one("\x00\x00\x80\x3f", 4);
  expected += zero + zero + zero + zero + zero + one;
  expected += one + zero + zero + zero + zero + one;
  expected += zero + one + zero + zero + zero + one;
  expected += one + one + zero + zero + one + zero;
  expected += std::string("\x03\x00\x00\x00\x00\x01\x00\x00\x00\x02\x00\x00\x00", 13);
  expected += std::string("\x03\x01\x00\x00\x00\x03\x00\x00\x00\x02\x00\x00\x00", 13);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string content, io::ReadWholeFile(path, 10'000));
  EXPECT_EQ(content, expected);
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()),
                          std::filesystem::directory_iterator()),
            1);
}

TEST(PlyWriterTest, EmptySurfaceIsAValidFile) {
  const TempDir folder;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto writer, PlyWriter::Create(folder.Sub("mesh.ply")));
  ISOSCOPE_ASSERT_OK(writer->Finish());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string content,
                                io::ReadWholeFile(folder.Sub("mesh.ply"), 10'000));
  EXPECT_EQ(content, MakePlyHeader(0, 0));
}

TEST(PlyWriterTest, HeaderLengthDoesNotDependOnTheCounts) {
  const std::size_t size = MakePlyHeader(0, 0).size();
  EXPECT_EQ(MakePlyHeader(PlyWriter::kMaxVertexCount, INT64_MAX).size(), size);
  EXPECT_EQ(MakePlyHeader(12, 345).size(), size);
}

TEST(PlyWriterTest, MalformedChunksAreRefused) {
  const TempDir folder;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto writer, PlyWriter::Create(folder.Sub("mesh.ply")));
  const std::string vertex = Bytes<float>({0, 0, 0});
  for (std::size_t size = 1; size < vertex.size(); ++size) {
    const std::string cut = vertex.substr(0, size);
    EXPECT_THAT(writer->AddChunk(cut, cut, ""), StatusIs(absl::StatusCode::kDataLoss)) << size;
    EXPECT_THAT(writer->AddChunk(vertex, cut, ""), StatusIs(absl::StatusCode::kDataLoss)) << size;
  }
  EXPECT_THAT(writer->AddChunk("", "", Bytes<std::int64_t>({0, 0})),
              StatusIs(absl::StatusCode::kDataLoss));
  EXPECT_THAT(writer->AddChunk(vertex, vertex, Bytes<std::int64_t>({0, 0, 1})),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("has vertex 1")));
  EXPECT_THAT(writer->AddChunk("", "", Bytes<std::int64_t>({0, -1, 0})),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("has vertex -1")));
}

TEST(PlyWriterTest, AbandonedWriterLeavesNothing) {
  const TempDir folder;
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto writer, PlyWriter::Create(folder.Sub("mesh.ply")));
    const std::string vertex = Bytes<float>({0, 0, 0});
    ISOSCOPE_ASSERT_OK(writer->AddChunk(vertex, vertex, ""));
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

}  // namespace
}  // namespace isoscope::cli
