#include "wire/depth_bounds_convert.h"

#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/compression.h"
#include "tests/support/status_matchers.h"
#include "wire/frame_convert.h"

namespace isoscope::wire {
namespace {

namespace internal = isoscope::internal::v1;
using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;
using visibility::DepthBounds;

internal::GetDepthBoundsRequest ValidRequest() {
  frame::FrameSpec spec;
  spec.surfaces = {{.rule = {.isovalue = 3}}};
  spec.camera = view::Camera();
  spec.camera->eye = {0, 0, 10};
  spec.camera->fov_y_radians = 0.5;
  spec.viewport = {64, 32};
  internal::GetDepthBoundsRequest request;
  request.set_dataset_id("some");
  *request.mutable_frame() = ToProto(spec);
  request.set_part_index(2);
  request.set_part_count(3);
  return request;
}

TEST(DepthBoundsConvertTest, AQuestionIsTaken) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DepthBoundsQuery query,
                                DepthBoundsQueryFromProto(ValidRequest()));
  EXPECT_EQ(query.part_index, 2);
  EXPECT_EQ(query.part_count, 3);
  EXPECT_EQ(query.spec.surfaces[0].rule.isovalue, 3);
  EXPECT_EQ(query.spec.viewport.width_px, 64);
}

TEST(DepthBoundsConvertTest, EveryHostileQuestionIsNamed) {
  struct Case {
    std::function<void(internal::GetDepthBoundsRequest*)> change;
    std::string named;
  };
  const std::vector<Case> cases = {
      {[](auto* r) { r->set_part_index(3); }, "part_index is 3 of part_count 3"},
      {[](auto* r) { r->set_part_index(-1); }, "part_index is -1"},
      {[](auto* r) { r->set_part_count(0); }, "part_count 0"},
      {[](auto* r) { r->set_part_count(std::numeric_limits<std::int32_t>::max()); },
       "part_count 2147483647"},
      {[](auto* r) { r->mutable_frame()->clear_camera(); }, "frame.camera is not set"},
      {[](auto* r) {
         r->mutable_frame()->mutable_viewport()->set_width_px(1024);
         r->mutable_frame()->mutable_viewport()->set_height_px(513);
       },
       "525312 pixels"},
      {[](auto* r) { r->clear_frame(); }, ""},
      {[](auto* r) { r->mutable_frame()->set_level(1); }, "frame.level is 1"},
      {[](auto* r) { r->GetReflection()->MutableUnknownFields(r)->AddVarint(99, 1); }, "99"},
  };
  for (const Case& c : cases) {
    internal::GetDepthBoundsRequest request = ValidRequest();
    c.change(&request);
    EXPECT_THAT(DepthBoundsQueryFromProto(request),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(c.named)));
  }
}

// A region of a large viewport may be asked for.
TEST(DepthBoundsConvertTest, ThePictureCountsNotTheViewport) {
  internal::GetDepthBoundsRequest request = ValidRequest();
  request.mutable_frame()->mutable_viewport()->set_width_px(8192);
  request.mutable_frame()->mutable_viewport()->set_height_px(8192);
  request.mutable_frame()->mutable_region()->set_width_px(8192);
  request.mutable_frame()->mutable_region()->set_height_px(64);
  ISOSCOPE_EXPECT_OK(DepthBoundsQueryFromProto(request));
}

DepthBounds SomeBounds() {
  DepthBounds bounds(3, 2);
  bounds.AddToRows({0, 0, 2, 2}, 0.25F, 0.5F, 0, 2);
  bounds.AddToRows({1, 1, 2, 2}, 0, 1, 0, 2);
  return bounds;
}

TEST(DepthBoundsConvertTest, BoundsSurviveTheWire) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DepthBounds again,
                                DepthBoundsFromProto(ToProto(SomeBounds()), {3, 2}));
  EXPECT_EQ(again, SomeBounds());
}

std::string PlaneOf(const std::vector<float>& values) {
  std::string bytes;
  for (const float value : values) {
    base::AppendLittleEndian(value, &bytes);
  }
  return base::Compress(bytes);
}

TEST(DepthBoundsConvertTest, EveryHostileAnswerIsRefused) {
  const internal::GetDepthBoundsResponse valid = ToProto(SomeBounds());
  EXPECT_FALSE(DepthBoundsFromProto({}, {3, 2}).ok());
  EXPECT_FALSE(DepthBoundsFromProto(valid, {3, 3}).ok()) << "of another size";
  EXPECT_FALSE(DepthBoundsFromProto(valid, {1, 2}).ok());
  internal::GetDepthBoundsResponse damaged = valid;
  damaged.mutable_nearest()->back() ^= 1;
  damaged.mutable_nearest()->resize(damaged.nearest().size() - 1);
  EXPECT_FALSE(DepthBoundsFromProto(damaged, {3, 2}).ok());
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const auto& [nearest, farthest] :
       {std::pair{0.5F, 0.25F}, {-1.0F, 1.0F}, {0.0F, 1.5F}, {2.0F, 1.0F}, {nan, 1.0F}}) {
    internal::GetDepthBoundsResponse answer;
    answer.set_nearest(PlaneOf({0.5F, nearest}));
    answer.set_farthest(PlaneOf({0.5F, farthest}));
    EXPECT_THAT(DepthBoundsFromProto(answer, {2, 1}),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("pixel 1")));
  }
}

}  // namespace
}  // namespace isoscope::wire
