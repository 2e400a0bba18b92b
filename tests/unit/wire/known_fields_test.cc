#include "wire/known_fields.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "tests/support/status_matchers.h"

namespace isoscope::wire {
namespace {

using isoscope::testing::IsOk;
using isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

void AddUnknown(google::protobuf::Message* message, int number) {
  message->GetReflection()->MutableUnknownFields(message)->AddVarint(number, 1);
}

TEST(KnownFieldsTest, MessagesOfThisVersionPass) {
  isoscope::v1::RenderIsosurfaceRequest request;
  EXPECT_THAT(CheckKnownFields(request), IsOk());
  request.set_isovalue(3);
  request.mutable_camera()->mutable_eye()->set_x(1);
  request.mutable_base_color()->set_alpha(1);
  EXPECT_THAT(CheckKnownFields(request), IsOk());
}

TEST(KnownFieldsTest, FieldsOfANewerVersionAreRefusedAtEveryDepth) {
  isoscope::v1::RenderIsosurfaceRequest top;
  AddUnknown(&top, 31);
  EXPECT_THAT(CheckKnownFields(top),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("RenderIsosurfaceRequest"), HasSubstr("number 31"))));
  isoscope::v1::RenderIsosurfaceRequest deep;
  AddUnknown(deep.mutable_camera()->mutable_eye(), 9);
  EXPECT_THAT(CheckKnownFields(deep),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("camera.eye"), HasSubstr("number 9"))));
  isoscope::internal::v1::ExtractSurfaceResponse repeated;
  repeated.add_blocks();
  AddUnknown(repeated.add_blocks(), 5);
  EXPECT_THAT(CheckKnownFields(repeated),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("blocks[1]")));
}

TEST(KnownFieldsTest, FieldsThatCameOverTheWireAreFound) {
  // Field 200, a varint, behind an isovalue.
  isoscope::v1::RenderIsosurfaceRequest known;
  known.set_isovalue(1.5);
  const std::string bytes = known.SerializeAsString() + std::string("\xc0\x0c\x01", 3);
  isoscope::v1::RenderIsosurfaceRequest parsed;
  ASSERT_TRUE(parsed.ParseFromString(bytes));
  EXPECT_THAT(CheckKnownFields(parsed),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("number 200")));
}

TEST(KnownFieldsTest, PreparingChangesNoResult) {
  isoscope::internal::v1::RenderFrameRequest frame;
  AddUnknown(frame.mutable_begin()->mutable_frame()->mutable_camera(), 77);
  PrepareKnownFields(frame);
  PrepareKnownFields(isoscope::internal::v1::ExtractSurfaceResponse());
  EXPECT_THAT(CheckKnownFields(frame),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("begin.frame.camera"), HasSubstr("number 77"))));
}

}  // namespace
}  // namespace isoscope::wire
