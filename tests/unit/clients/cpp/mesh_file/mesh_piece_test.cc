#include "clients/cpp/mesh_file/mesh_piece.h"

#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "tests/support/status_matchers.h"

namespace isoscope::client {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

template <typename T>
std::string Bytes(const std::vector<T>& values) {
  std::string bytes;
  for (const T value : values) {
    base::AppendLittleEndian(value, &bytes);
  }
  return bytes;
}

TEST(MeshPieceTest, NumbersComeBackAndTrianglesMayUseEarlierVertices) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const MeshPiece piece,
                                DecodeMeshPiece(Bytes<float>({1, 2, 3}), Bytes<float>({0, 0, 1}),
                                                Bytes<std::int64_t>({7, 0, 3}), 7));
  EXPECT_THAT(piece.positions, ElementsAre(1, 2, 3));
  EXPECT_THAT(piece.normals, ElementsAre(0, 0, 1));
  EXPECT_THAT(piece.triangles, ElementsAre(7, 0, 3));
  EXPECT_EQ(piece.vertex_count(), 1);
  EXPECT_EQ(piece.triangle_count(), 1);
}

TEST(MeshPieceTest, MalformedChunksAreRefused) {
  const std::string vertex = Bytes<float>({0, 0, 0});
  for (std::size_t size = 1; size < vertex.size(); ++size) {
    const std::string cut = vertex.substr(0, size);
    EXPECT_THAT(DecodeMeshPiece(cut, cut, "", 0), StatusIs(absl::StatusCode::kDataLoss)) << size;
    EXPECT_THAT(DecodeMeshPiece(vertex, cut, "", 0), StatusIs(absl::StatusCode::kDataLoss)) << size;
  }
  EXPECT_THAT(DecodeMeshPiece("", "", Bytes<std::int64_t>({0, 0}), 1),
              StatusIs(absl::StatusCode::kDataLoss));
  EXPECT_THAT(DecodeMeshPiece(vertex, vertex, Bytes<std::int64_t>({0, 0, 1}), 0),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("has vertex 1")));
  EXPECT_THAT(DecodeMeshPiece("", "", Bytes<std::int64_t>({0, -1, 0}), 3),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("has vertex -1")));
  EXPECT_THAT(DecodeMeshPiece("", "", Bytes<std::int64_t>({0, std::int64_t{1} << 32, 0}), 3),
              StatusIs(absl::StatusCode::kDataLoss));
}

TEST(MeshDecoderTest, SurfacesFollowOneAnotherAndShareNoVertices) {
  const std::string vertex = Bytes<float>({0, 0, 0});
  MeshDecoder decoder(3);
  ISOSCOPE_ASSERT_OK(decoder.Decode(0, vertex, vertex, Bytes<std::int64_t>({0, 0, 0})).status());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const MeshPiece piece,
                                decoder.Decode(2, vertex, vertex, Bytes<std::int64_t>({1, 1, 1})));
  EXPECT_EQ(piece.surface_index, 2);
  EXPECT_THAT(piece.triangles, ElementsAre(1, 1, 1));
  EXPECT_EQ(decoder.vertex_count(), 2);
  EXPECT_EQ(decoder.triangle_count(), 2);
  EXPECT_THAT(decoder.Decode(2, "", "", Bytes<std::int64_t>({1, 0, 1})),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("has vertex 0")));
  for (const int surface : {1, 3, -1}) {
    EXPECT_THAT(
        decoder.Decode(surface, "", "", ""),
        StatusIs(absl::StatusCode::kDataLoss,
                 HasSubstr(absl::StrCat("of surface ", surface, ", after surface 2 of 3"))));
  }
}

TEST(MeshDecoderTest, AllMessagesHaveTheOriginOfTheFirst) {
  const std::string vertex = Bytes<float>({0, 0, 0});
  const math::Vec3d origin{500000, 4600000, 0.5};
  MeshDecoder far(1);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const MeshPiece piece, far.Decode(0, vertex, vertex, "", origin));
  EXPECT_EQ(piece.origin, origin);
  ISOSCOPE_EXPECT_OK(far.Decode(0, vertex, vertex, "", origin).status());
  EXPECT_THAT(far.Decode(0, vertex, vertex, "", math::Vec3d{500000, 4600000, 1}),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("origin")));
  EXPECT_THAT(far.Decode(0, vertex, vertex, ""),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("origin")));
  MeshDecoder near(1);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const MeshPiece first, near.Decode(0, vertex, vertex, ""));
  EXPECT_FALSE(first.origin.has_value());
  EXPECT_THAT(near.Decode(0, vertex, vertex, "", origin),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("origin")));
  MeshDecoder hostile(1);
  EXPECT_THAT(hostile.Decode(0, vertex, vertex, "",
                             math::Vec3d{std::numeric_limits<double>::infinity(), 0, 0}),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("origin")));
}

TEST(MeshPieceTest, AnOriginIsTextThatReadsBack) {
  EXPECT_EQ(TextOfOrigin({500000, -4600000.1, 0}), "500000 -4600000.1 0");
}

TEST(MeshPieceTest, OneVertexTooManyIsOutOfRange) {
  const std::string vertex = Bytes<float>({0, 0, 0});
  ISOSCOPE_EXPECT_OK(DecodeMeshPiece(vertex, vertex, "", kMaxVertexCount - 1).status());
  EXPECT_THAT(DecodeMeshPiece(vertex, vertex, "", kMaxVertexCount),
              StatusIs(absl::StatusCode::kOutOfRange, HasSubstr("2,147,483,647")));
}

}  // namespace
}  // namespace isoscope::client
