#include "web-gateway/api/json.h"

#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "tests/support/status_matchers.h"

namespace isoscope::gateway {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::IsOk;
using testing::StatusIs;

TEST(JsonTest, FollowsTheMappingOfProtobuf) {
  isoscope::v1::RenderIsosurfaceRequest request;
  request.set_isovalue(60.5);
  request.set_ray_seed(std::int64_t{1} << 60);
  request.set_camera_fit(isoscope::v1::CAMERA_FIT_SURFACE);
  request.mutable_viewport()->set_width_px(4);
  EXPECT_EQ(ToJson(request),
            "{\"isovalue\":60.5,\"viewport\":{\"widthPx\":4},\"raySeed\":\"1152921504606846976\","
            "\"cameraFit\":\"CAMERA_FIT_SURFACE\"}");
  isoscope::v1::RenderIsosurfaceRequest back;
  ASSERT_THAT(FromJson(ToJson(request), &back), IsOk());
  EXPECT_EQ(back.SerializeAsString(), request.SerializeAsString());
}

TEST(JsonTest, HeadersHaveAsciiAndNumbersAllTheirDigits) {
  isoscope::v1::FieldSelection selection;
  selection.set_field("temp\xc3\xa9rature");
  selection.set_time_step(0);
  EXPECT_EQ(ToAsciiJson(selection), R"({"field":"temp\u00e9rature","timeStep":0})");
  EXPECT_EQ(ToJson(0.1 + 0.2), "0.30000000000000004");
}

TEST(JsonTest, RefusesWhatIsNoMessage) {
  std::string deep;
  for (int i = 0; i < 10000; ++i) {
    deep += "{\"camera\":";
  }
  for (const std::string& json :
       {std::string(), std::string("x"), std::string("[]"), std::string("{\"isovalue\":\"x\"}"),
        std::string("{\"isovaleu\":1}"), std::string("{\"viewport\":3}"), std::string("{"),
        std::string("{\"isovalue\":1}}"), std::string("\xff\xfe"), deep}) {
    isoscope::v1::RenderIsosurfaceRequest request;
    const absl::Status status = FromJson(json, &request);
    EXPECT_THAT(status,
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("RenderIsosurfaceRequest")))
        << json.substr(0, 40);
    EXPECT_LT(status.message().size(), 500U);
  }
  isoscope::v1::RenderIsosurfaceRequest request;
  EXPECT_THAT(FromJson("{\"isovaleu\":1}", &request),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("isovaleu")));
}

}  // namespace
}  // namespace isoscope::gateway
