#include "core/solid/face_polygons.h"

#include <bit>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::solid {
namespace {

using ::testing::ElementsAre;

std::vector<int> PointsOf(const FacePolygon& polygon) {
  return {polygon.points.begin(),
          polygon.points.begin() + static_cast<std::ptrdiff_t>(polygon.size)};
}

// Each inside corner and each crossed edge is a corner of one polygon.
TEST(FacePolygonsTest, PolygonsHaveEachInsideCornerAndEachCrossedEdgeOnce) {
  for (const bool has_labels : {false, true}) {
    for (unsigned inside = 0; inside < 16; ++inside) {
      const FacePolygons& face = FacePolygonsOf(inside, has_labels);
      std::vector<int> counts(8, 0);
      for (std::size_t i = 0; i < face.count; ++i) {
        for (const int point : PointsOf(face.polygons[i])) {
          ++counts[static_cast<std::size_t>(point)];
        }
      }
      for (unsigned i = 0; i < 4; ++i) {
        const bool is_inside = (inside >> i & 1) != 0;
        const bool is_crossed = is_inside != ((inside >> (i + 1) % 4 & 1) != 0);
        EXPECT_EQ(counts[i], is_inside ? 1 : 0) << inside;
        EXPECT_EQ(counts[4 + i], is_crossed ? 1 : 0) << inside;
      }
    }
  }
}

TEST(FacePolygonsTest, OppositeCornersAreJoinedOnlyByLabelsAndOnlyAwayFromTheLowestOne) {
  EXPECT_EQ(FacePolygonsOf(0b0101, false).count, 2U);
  EXPECT_EQ(FacePolygonsOf(0b1010, false).count, 2U);
  EXPECT_EQ(FacePolygonsOf(0b0101, true).count, 2U);
  ASSERT_EQ(FacePolygonsOf(0b1010, true).count, 1U);
  EXPECT_THAT(PointsOf(FacePolygonsOf(0b1010, true).polygons[0]), ElementsAre(4, 1, 5, 6, 3, 7));
  EXPECT_THAT(PointsOf(FacePolygonsOf(0b1010, false).polygons[0]), ElementsAre(4, 1, 5));
  EXPECT_THAT(PointsOf(FacePolygonsOf(0b1111, true).polygons[0]), ElementsAre(0, 1, 2, 3));
}

TEST(FacePolygonsTest, FaceCornersAreThoseOfTheCell) {
  // Corner 5 of the cell is (1, 0, 1).
  EXPECT_EQ(InsideOfFace(1U << 5, 0), 0U);       // x = 0
  EXPECT_EQ(InsideOfFace(1U << 5, 1), 1U << 3);  // x = 1: +z
  EXPECT_EQ(InsideOfFace(1U << 5, 2), 1U << 2);  // y = 0: +z +x
  EXPECT_EQ(InsideOfFace(1U << 5, 5), 1U << 1);  // z = 1: +x
  for (std::size_t face = 0; face < kFaceCount; ++face) {
    EXPECT_EQ(InsideOfFace(0xff, face), 0xfU);
  }
}

TEST(FacePolygonsTest, ACellBehindAFaceLiesOutward) {
  for (std::size_t face = 0; face < kFaceCount; ++face) {
    const math::Index3 behind = CellBehind({3, 4, 5}, face);
    const math::Vec3d way{static_cast<double>(behind.x - 3), static_cast<double>(behind.y - 4),
                          static_cast<double>(behind.z - 5)};
    EXPECT_EQ(way, OutwardOf(face));
  }
  EXPECT_EQ(CellBehind({3, 4, 5}, 3), (math::Index3{3, 5, 5}));
}

}  // namespace
}  // namespace isoscope::solid
