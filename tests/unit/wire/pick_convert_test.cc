#include "wire/pick_convert.h"

#include <limits>
#include <optional>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::wire {
namespace {

using isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

isoscope::v1::PickSurfaceRequest MakePick(const std::vector<PixelPosition>& pixels) {
  isoscope::v1::PickSurfaceRequest pick;
  pick.mutable_frame()->set_isovalue(60);
  pick.mutable_frame()->mutable_viewport()->set_width_px(400);
  pick.mutable_frame()->mutable_viewport()->set_height_px(300);
  for (const PixelPosition& pixel : pixels) {
    pick.add_pixels()->set_x(pixel.x);
    pick.mutable_pixels(pick.pixels_size() - 1)->set_y(pixel.y);
  }
  return pick;
}

TEST(PickSpecFromProtoTest, TheRegionIsTheSmallestAroundThePixels) {
  isoscope::v1::PickSurfaceRequest pick = MakePick({{30, 7}, {10, 200}, {30, 7}});
  pick.mutable_frame()->set_culling(isoscope::v1::CULLING_MASK);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const PickSpec spec, PickSpecFromProto(pick));
  EXPECT_THAT(spec.pixels,
              ElementsAre(PixelPosition{30, 7}, PixelPosition{10, 200}, PixelPosition{30, 7}));
  EXPECT_EQ(spec.asked.spec.region, (view::Region{10, 7, 21, 194}));
  EXPECT_EQ(spec.asked.spec.culling, frame::Culling::kDepth) << "picks are exact";
  EXPECT_TRUE(spec.asked.spec.sends_normals);
  EXPECT_FALSE(spec.asked.with_all_fields);
  pick.set_with_field_values(true);
  EXPECT_TRUE(PickSpecFromProto(pick)->asked.with_all_fields);
}

TEST(PickSpecFromProtoTest, APickIsOfLevelZero) {
  isoscope::v1::PickSurfaceRequest pick = MakePick({{30, 7}});
  pick.mutable_frame()->mutable_level()->set_level(3);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const PickSpec spec, PickSpecFromProto(pick));
  EXPECT_FALSE(spec.asked.level.has_value());
  EXPECT_EQ(spec.asked.spec.level, 0);
}

TEST(PickSpecFromProtoTest, APickHasNoEffects) {
  isoscope::v1::PickSurfaceRequest pick = MakePick({{30, 7}});
  pick.mutable_frame()->set_samples(16);
  pick.mutable_frame()->mutable_ambient_occlusion();
  pick.mutable_frame()->mutable_silhouette();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const PickSpec spec, PickSpecFromProto(pick));
  EXPECT_EQ(spec.asked.spec.effects, frame::PictureEffects());
}

TEST(PickSpecFromProtoTest, WrongMembersAreNamedWithValueAndRange) {
  const auto expect = [](const isoscope::v1::PickSurfaceRequest& pick, const char* what) {
    EXPECT_THAT(PickSpecFromProto(pick),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(what)));
  };
  expect(MakePick({}), "pixels has 0 elements: must have 1 to 1000");
  expect(MakePick(std::vector<PixelPosition>(1001)), "pixels has 1001 elements");
  expect(MakePick({{0, 0}, {400, 0}}), "pixels[1].x is 400: must be in [0, 399]");
  expect(MakePick({{0, -1}}), "pixels[0].y is -1: must be in [0, 299]");
  expect(MakePick({{std::numeric_limits<int>::max(), 0}}), "pixels[0].x is 2147483647");
  isoscope::v1::PickSurfaceRequest pick = MakePick({{0, 0}});
  pick.mutable_frame()->mutable_region()->set_width_px(1);
  expect(pick, "frame.region is set");
  pick = MakePick({{0, 0}});
  pick.mutable_frame()->mutable_output()->set_depth(true);
  expect(pick, "frame.output is set");
  pick = MakePick({{0, 0}});
  pick.clear_frame();
  expect(pick, "frame.viewport is not set");
  pick = MakePick({{0, 0}});
  pick.mutable_frame()->mutable_viewport()->set_width_px(70000);
  expect(pick, "frame.viewport.width_px is 70000");
  pick = MakePick({{0, 0}});
  pick.mutable_frame()->set_isovalue(std::numeric_limits<double>::quiet_NaN());
  expect(pick, "isovalue");
  pick = MakePick({{0, 0}});
  pick.mutable_frame()->set_culling(static_cast<isoscope::v1::Culling>(9));
  expect(pick, "frame.culling");
  pick = MakePick({{0, 0}});
  pick.GetReflection()->MutableUnknownFields(&pick)->AddVarint(90, 1);
  expect(pick, "number 90");
}

TEST(PickSpecFromProtoTest, PixelsOfAPosterMustLieWithinOneRegion) {
  isoscope::v1::PickSurfaceRequest pick = MakePick({{0, 0}, {20000, 5}});
  pick.mutable_frame()->mutable_viewport()->set_width_px(65536);
  EXPECT_THAT(PickSpecFromProto(pick),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr("window of 20001 x 6 pixels: must lie in one of at most 16384")));
  pick.mutable_pixels(0)->set_x(20000);
  ISOSCOPE_EXPECT_OK(PickSpecFromProto(pick));
}

TEST(GradientsTest, PointsOfARequestAreCheckedAndAnswersFindTheirPoints) {
  isoscope::internal::v1::GetGradientsRequest request;
  request.add_points()->set_y(3);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<math::Vec3d> points,
                                PickedPointsFromProto(request));
  EXPECT_THAT(points, ElementsAre(math::Vec3d{0, 3, 0}));
  request.add_points()->set_x(std::numeric_limits<double>::infinity());
  EXPECT_THAT(PickedPointsFromProto(request),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("points[1].x is inf")));
  request.clear_points();
  for (int i = 0; i <= kMaxPickedPixels; ++i) {
    request.add_points();
  }
  EXPECT_THAT(PickedPointsFromProto(request),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("points has 1001 elements")));

  std::vector<std::optional<math::Vec3d>> gradients(3);
  isoscope::internal::v1::GetGradientsResponse response;
  isoscope::internal::v1::PointGradient* const gradient = response.add_gradients();
  gradient->set_point_index(1);
  gradient->mutable_gradient()->set_z(-2);
  ISOSCOPE_EXPECT_OK(AddGradients(response, &gradients));
  EXPECT_THAT(gradients, ElementsAre(std::nullopt, math::Vec3d{0, 0, -2}, std::nullopt));
  for (const int index : {-1, 3}) {
    gradient->set_point_index(index);
    EXPECT_THAT(
        AddGradients(response, &gradients),
        StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("gradients[0].point_index is ")));
  }
  gradient->set_point_index(0);
  gradient->mutable_gradient()->set_z(std::numeric_limits<double>::quiet_NaN());
  EXPECT_THAT(AddGradients(response, &gradients),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("gradients[0].gradient")));
}

TEST(PointValuesTest, EveryPointNeedsItsIsovalueAndBlock) {
  isoscope::internal::v1::GetGradientsRequest good;
  for (int i = 0; i < 2; ++i) {
    good.add_points();
    good.add_block_ids(i);
    good.mutable_values()->add_isovalues(i);
    good.add_on_caps(false);
  }
  good.mutable_values()->add_dataset_ids("a");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto surfaces, PickedSurfacesFromProto(good));
  ASSERT_EQ(surfaces.size(), 2U);
  EXPECT_EQ(surfaces[1].rule, volume::InsideRule::OfIsovalue(1));
  const auto expect = [&](const char* what, const auto& change) {
    isoscope::internal::v1::GetGradientsRequest bad = good;
    change(&bad);
    EXPECT_THAT(PickedSurfacesFromProto(bad),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(what)));
  };
  using Request = isoscope::internal::v1::GetGradientsRequest;
  expect("values.dataset_ids has 0 elements: must have 1 to 1000",
         [](Request* bad) { bad->mutable_values()->clear_dataset_ids(); });
  expect("values.dataset_ids has 1001", [](Request* bad) {
    for (int i = 0; i < kMaxPickedVolumes; ++i) {
      bad->mutable_values()->add_dataset_ids("a");
    }
  });
  expect("values.isovalues has 3 elements: must have one for each of the 2 points",
         [](Request* bad) { bad->mutable_values()->add_isovalues(0); });
  expect("on_caps has 0", [](Request* bad) { bad->clear_on_caps(); });
  expect("block_ids has 0", [](Request* bad) { bad->clear_block_ids(); });
  expect("values.isovalues[1] is nan", [](Request* bad) {
    bad->mutable_values()->set_isovalues(1, std::numeric_limits<double>::quiet_NaN());
  });
}

TEST(PointValuesTest, ValuesOfNoPointOrOfTooFewVolumesAreRefused) {
  isoscope::internal::v1::GetGradientsResponse response;
  std::vector<std::vector<double>> values(3);
  response.add_values()->set_point_index(1);
  response.mutable_values(0)->add_values(7);
  response.mutable_values(0)->add_values(std::numeric_limits<double>::infinity());
  ISOSCOPE_EXPECT_OK(AddPointValues(response, 2, &values));
  EXPECT_THAT(values[1], ElementsAre(7, std::numeric_limits<double>::infinity()));
  EXPECT_TRUE(values[0].empty());
  EXPECT_THAT(
      AddPointValues(response, 3, &values),
      StatusIs(
          absl::StatusCode::kInvalidArgument,
          HasSubstr("values[0].values has 2 elements: must have one for each of the 3 volumes")));
  for (const int bad : {-1, 3}) {
    response.mutable_values(0)->set_point_index(bad);
    EXPECT_THAT(AddPointValues(response, 2, &values),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("must be in [0, 3)")));
  }
}

TEST(AddPointShardsTest, ShardsOfNoPointAndThoseThatNobodyAskedForAreRefused) {
  isoscope::internal::v1::GetGradientsResponse response;
  std::vector<std::optional<int>> shards(3);
  response.add_shards()->set_point_index(1);
  response.mutable_shards(0)->set_shard_index(7);
  ISOSCOPE_EXPECT_OK(AddPointShards(response, {2, 7}, &shards));
  EXPECT_THAT(shards, ElementsAre(std::nullopt, 7, std::nullopt));
  EXPECT_THAT(AddPointShards(response, {2, 8}, &shards),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("shard_index is 7")));
  for (const int bad : {-1, 3}) {
    response.mutable_shards(0)->set_point_index(bad);
    EXPECT_THAT(AddPointShards(response, {7}, &shards),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("must be in [0, 3)")));
  }
}

TEST(PointLabelsTest, EveryPointHasASetOrTheIsovalue) {
  using Request = isoscope::internal::v1::GetGradientsRequest;
  Request good;
  for (int i = 0; i < 3; ++i) {
    good.add_points();
    good.add_block_ids(i);
    good.add_on_caps(i == 1);
    good.add_label_set_indices(i - 1);
  }
  good.add_label_sets()->add_labels(5);
  good.add_label_sets()->add_labels(7);
  good.mutable_label_sets(1)->add_labels(-2);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto surfaces, PickedSurfacesFromProto(good));
  ASSERT_EQ(surfaces.size(), 3U);
  EXPECT_FALSE(surfaces[0].rule.has_labels());
  EXPECT_EQ(surfaces[1].rule, volume::InsideRule::OfLabels({5}));
  EXPECT_TRUE(surfaces[1].is_on_cap);
  EXPECT_EQ(surfaces[2].rule, volume::InsideRule::OfLabels({-2, 7}));
  const auto expect = [&](const char* what, const auto& change) {
    Request bad = good;
    change(&bad);
    EXPECT_THAT(PickedSurfacesFromProto(bad),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(what)));
  };
  expect("label_set_indices[2] is 2: must be in [-1, 1]",
         [](Request* bad) { bad->set_label_set_indices(2, 2); });
  expect("label_set_indices[0] is -2", [](Request* bad) { bad->set_label_set_indices(0, -2); });
  expect("label_set_indices has 4", [](Request* bad) { bad->add_label_set_indices(0); });
  expect("label_set_indices has 0", [](Request* bad) { bad->clear_label_set_indices(); });
  expect("block_ids has 0", [](Request* bad) { bad->clear_block_ids(); });
  expect("label_sets[1].labels has 0 different values: must have 1 to 256",
         [](Request* bad) { bad->mutable_label_sets(1)->clear_labels(); });
  expect("label_sets[0].labels[0] is nan", [](Request* bad) {
    bad->mutable_label_sets(0)->set_labels(0, std::numeric_limits<double>::quiet_NaN());
  });
}

TEST(PointLabelsTest, AnswersAreLabelsOfTheSurface) {
  isoscope::internal::v1::GetGradientsResponse response;
  const std::vector<volume::InsideRule> rules = {volume::InsideRule::OfIsovalue(1),
                                                 volume::InsideRule::OfLabels({3, 7})};
  std::vector<std::optional<double>> labels(2);
  response.add_labels()->set_point_index(1);
  response.mutable_labels(0)->set_label(7);
  ISOSCOPE_EXPECT_OK(AddPointLabels(response, rules, &labels));
  EXPECT_EQ(labels[0], std::nullopt);
  EXPECT_EQ(labels[1], 7);
  const auto expect = [&](int point, double label, const char* what) {
    response.mutable_labels(0)->set_point_index(point);
    response.mutable_labels(0)->set_label(label);
    EXPECT_THAT(AddPointLabels(response, rules, &labels),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(what)));
  };
  expect(1, 4, "labels[0].label is 4: must be one of the surface, which has labels 3, 7");
  expect(0, 3, "labels[0].label is 3");
  expect(2, 3, "labels[0].point_index is 2");
}

}  // namespace
}  // namespace isoscope::wire
