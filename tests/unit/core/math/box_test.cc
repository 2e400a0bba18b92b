#include "core/math/box.h"

#include "gtest/gtest.h"

namespace isoscope::math {
namespace {

TEST(IndexBoxTest, EndIsOutside) {
  const IndexBox box{{1, 2, 3}, {4, 5, 6}};
  EXPECT_EQ(box.dims(), (Index3{3, 3, 3}));
  EXPECT_TRUE(box.Contains({1, 2, 3}));
  EXPECT_TRUE(box.Contains({3, 4, 5}));
  EXPECT_FALSE(box.Contains({4, 4, 5}));
  EXPECT_FALSE(box.Contains({0, 2, 3}));
}

TEST(IndexBoxTest, GrowsToTheLeastBoxAroundBoxes) {
  IndexBox box;
  EXPECT_TRUE(box.empty());
  box.Add({{5, 5, 5}, {5, 9, 9}});
  EXPECT_TRUE(box.empty()) << "an empty box adds nothing";
  box.Add({{1, 2, 3}, {4, 5, 6}});
  EXPECT_EQ(box, (IndexBox{{1, 2, 3}, {4, 5, 6}})) << "an empty one has no corner of its own";
  box.Add({});
  EXPECT_EQ(box, (IndexBox{{1, 2, 3}, {4, 5, 6}}));
  box.Add({{0, 3, 3}, {2, 9, 4}});
  EXPECT_EQ(box, (IndexBox{{0, 2, 3}, {4, 9, 6}}));
}

TEST(IndexBoxTest, CoversWhatHasNothingOutside) {
  const IndexBox box{{1, 2, 3}, {4, 5, 6}};
  EXPECT_TRUE(box.Covers(box));
  EXPECT_TRUE(box.Covers({{2, 2, 3}, {3, 3, 4}}));
  EXPECT_FALSE(box.Covers({{0, 2, 3}, {4, 5, 6}}));
  EXPECT_FALSE(box.Covers({{1, 2, 3}, {4, 5, 7}}));
  EXPECT_TRUE(box.Covers({{9, 9, 9}, {9, 9, 9}})) << "an empty box";
  EXPECT_FALSE(IndexBox{}.Covers(box));
}

TEST(Box3dTest, GrowsFromEmptyToTheHullOfItsPoints) {
  Box3d box;
  EXPECT_GT(box.min.x, box.max.x);
  box.Add({1, 5, -2});
  box.Add({-3, 7, 2});
  EXPECT_EQ(box.min, (Vec3d{-3, 5, -2}));
  EXPECT_EQ(box.max, (Vec3d{1, 7, 2}));
  EXPECT_EQ(box.Center(), (Vec3d{-1, 6, 0}));
  EXPECT_DOUBLE_EQ(box.Radius(), 3);
}

TEST(Box3dTest, CornersVaryInXFirst) {
  Box3d box;
  box.Add({0, 0, 0});
  box.Add({1, 2, 3});
  const auto corners = box.Corners();
  EXPECT_EQ(corners[0], (Vec3d{0, 0, 0}));
  EXPECT_EQ(corners[1], (Vec3d{1, 0, 0}));
  EXPECT_EQ(corners[2], (Vec3d{0, 2, 0}));
  EXPECT_EQ(corners[7], (Vec3d{1, 2, 3}));
}

}  // namespace
}  // namespace isoscope::math
