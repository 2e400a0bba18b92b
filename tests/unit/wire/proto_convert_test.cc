// Each message that core converts, in both directions:
//
// - values survive the way to the message and back: cameras, colours, geometry, block lists,
//   durations;
// - the limits of each field, with the name of the field in the error;
// - descriptions of datasets that contradict themselves.

#include "wire/proto_convert.h"

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::wire {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::IsOk;
using testing::StatusIs;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

isoscope::v1::Camera GoodCamera() {
  isoscope::v1::Camera camera;
  camera.mutable_eye()->set_z(10);
  camera.mutable_target();
  camera.mutable_perspective()->set_fov_y_degrees(30);
  return camera;
}

struct BadCamera {
  std::string name;
  std::function<void(isoscope::v1::Camera*)> spoil;
  std::string message;  // must be in the error
};

class BadCameraTest : public ::testing::TestWithParam<BadCamera> {};

TEST_P(BadCameraTest, IsRefusedNamingTheField) {
  isoscope::v1::Camera camera = GoodCamera();
  GetParam().spoil(&camera);
  EXPECT_THAT(CameraFromProto(camera, "camera"),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("camera"), HasSubstr(GetParam().message))));
}

INSTANTIATE_TEST_SUITE_P(
    Rows, BadCameraTest,
    ::testing::Values(
        BadCamera{"NoEye", [](auto* c) { c->clear_eye(); }, "camera.eye"},
        BadCamera{"NoTarget", [](auto* c) { c->clear_target(); }, "camera.target"},
        BadCamera{"NoProjection", [](auto* c) { c->clear_perspective(); }, "camera.projection"},
        BadCamera{"NanEye", [](auto* c) { c->mutable_eye()->set_y(kNan); }, "camera.eye.y is nan"},
        BadCamera{"InfTarget", [](auto* c) { c->mutable_target()->set_x(-kInf); },
                  "camera.target.x is -inf"},
        BadCamera{"NanUp", [](auto* c) { c->mutable_up()->set_z(kNan); }, "camera.up.z"},
        BadCamera{"ZeroUp", [](auto* c) { c->mutable_up(); }, "up"},
        BadCamera{"UpAlongView", [](auto* c) { c->mutable_up()->set_z(-3); }, "up"},
        BadCamera{"EyeIsTarget", [](auto* c) { c->mutable_eye()->set_z(0); }, "eye"},
        BadCamera{"ZeroFov", [](auto* c) { c->mutable_perspective()->set_fov_y_degrees(0); },
                  "camera.perspective.fov_y_degrees is 0"},
        BadCamera{"FlatFov", [](auto* c) { c->mutable_perspective()->set_fov_y_degrees(180); },
                  "fov_y_degrees is 180"},
        BadCamera{"NanFov", [](auto* c) { c->mutable_perspective()->set_fov_y_degrees(kNan); },
                  "fov_y_degrees is nan"},
        BadCamera{"ZeroHeight", [](auto* c) { c->mutable_orthographic()->set_height(0); },
                  "camera.orthographic.height is 0"},
        BadCamera{"InfHeight", [](auto* c) { c->mutable_orthographic()->set_height(kInf); },
                  "height is inf"}),
    [](const auto& row) { return row.param.name; });

TEST(ProtoConvertTest, FovIsTakenToRadiansAndUpDefaultsToY) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const view::Camera camera, CameraFromProto(GoodCamera(), "camera"));
  EXPECT_DOUBLE_EQ(camera.fov_y_radians, std::numbers::pi / 6);
  EXPECT_EQ(camera.up, (math::Vec3d{0, 1, 0}));
  EXPECT_EQ(camera.projection, view::Projection::kPerspective);
}

TEST(ProtoConvertTest, WholeDegreesComeBackAsWholeDegrees) {
  for (int degrees = 1; degrees < 180; ++degrees) {
    isoscope::v1::Camera proto = GoodCamera();
    proto.mutable_perspective()->set_fov_y_degrees(degrees);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const view::Camera camera, CameraFromProto(proto, "camera"));
    EXPECT_EQ(ToProto(camera).perspective().fov_y_degrees(), degrees);
  }
}

TEST(ProtoConvertTest, OrthographicCameraSurvivesBothWays) {
  isoscope::v1::Camera proto = GoodCamera();
  proto.mutable_orthographic()->set_height(2.5);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const view::Camera camera, CameraFromProto(proto, "camera"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const view::Camera again,
                                CameraFromProto(ToProto(camera), "camera"));
  EXPECT_EQ(again, camera);
}

TEST(ProtoConvertTest, ViewportOutsideItsRangeIsRefused) {
  for (const int bad : {-1, 0, view::kMaxViewportPx + 1}) {
    isoscope::v1::Viewport proto;
    proto.set_width_px(bad);
    proto.set_height_px(1);
    EXPECT_THAT(ViewportFromProto(proto, "viewport"),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         HasSubstr("viewport.width_px is " + std::to_string(bad))));
    proto.set_width_px(1);
    proto.set_height_px(bad);
    EXPECT_THAT(ViewportFromProto(proto, "viewport"),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("viewport.height_px")));
  }
  isoscope::v1::Viewport largest;
  largest.set_width_px(view::kMaxViewportPx);
  largest.set_height_px(1);
  EXPECT_THAT(ViewportFromProto(largest, "viewport"), IsOk());
}

TEST(ProtoConvertTest, CullingOfANewerClientIsRefusedAndUnsetIsDepth) {
  EXPECT_EQ(*CullingFromProto(isoscope::v1::CULLING_UNSPECIFIED, "culling"),
            frame::Culling::kDepth);
  for (const auto culling :
       {frame::Culling::kDepth, frame::Culling::kMask, frame::Culling::kNone}) {
    EXPECT_EQ(*CullingFromProto(ToProto(culling), "culling"), culling);
  }
  EXPECT_THAT(CullingFromProto(static_cast<isoscope::v1::Culling>(17), "culling"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("culling is 17")));
}

TEST(ProtoConvertTest, EveryEightBitColorSurvivesBothWays) {
  for (int i = 0; i < 256; ++i) {
    const auto v = static_cast<std::uint8_t>(i);
    const image::Rgba8 color{v, static_cast<std::uint8_t>(255 - i), v, v};
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::Rgba8 again, ColorFromProto(ToProto(color), "c"));
    EXPECT_EQ(again, color);
  }
}

TEST(ProtoConvertTest, ColorChannelsOutsideUnitRangeAreRefused) {
  for (const float bad : {-0.01F, 1.01F, std::numeric_limits<float>::quiet_NaN(),
                          std::numeric_limits<float>::infinity()}) {
    isoscope::v1::Color proto;
    proto.set_blue(bad);
    EXPECT_THAT(ColorFromProto(proto, "base_color"),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("base_color.blue")));
  }
}

volume::GridGeometry Geometry() {
  volume::GridGeometry geometry;
  geometry.sample_dims = {9, 8, 7};
  geometry.spacing = {0.5, 1, 2};
  geometry.origin = {-1, 0, 3};
  geometry.direction.columns = {math::Vec3d{0, 1, 0}, math::Vec3d{1, 0, 0}, math::Vec3d{0, 0, 1}};
  return geometry;
}

TEST(ProtoConvertTest, GeometrySurvivesBothWaysAndUnsetDirectionIsTheIdentity) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::GridGeometry again,
                                GeometryFromProto(ToProto(Geometry()), "geometry"));
  EXPECT_EQ(again, Geometry());
  isoscope::v1::GridGeometry proto = ToProto(Geometry());
  proto.clear_direction_columns();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::GridGeometry plain,
                                GeometryFromProto(proto, "geometry"));
  EXPECT_EQ(plain.direction, math::Mat3d());
}

TEST(ProtoConvertTest, BadGeometryIsRefused) {
  const auto code = [](const isoscope::v1::GridGeometry& proto) {
    return GeometryFromProto(proto, "geometry").status().code();
  };
  isoscope::v1::GridGeometry proto = ToProto(Geometry());
  proto.mutable_sample_dims()->set_y(1);
  EXPECT_EQ(code(proto), absl::StatusCode::kInvalidArgument);
  proto = ToProto(Geometry());
  proto.mutable_spacing()->set_z(0);
  EXPECT_EQ(code(proto), absl::StatusCode::kInvalidArgument);
  proto = ToProto(Geometry());
  proto.mutable_origin()->set_x(kInf);
  EXPECT_EQ(code(proto), absl::StatusCode::kInvalidArgument);
  proto = ToProto(Geometry());
  proto.mutable_direction_columns()->RemoveLast();
  EXPECT_EQ(code(proto), absl::StatusCode::kInvalidArgument);
  proto = ToProto(Geometry());
  proto.mutable_direction_columns(1)->CopyFrom(proto.direction_columns(0));
  EXPECT_EQ(code(proto), absl::StatusCode::kInvalidArgument);
}

store::Manifest SomeManifest() {
  store::Manifest manifest;
  manifest.dataset_id = "0123456789abcdef0123456789abcdef";
  manifest.name = "head";
  manifest.source = "head.nrrd";
  manifest.geometry = Geometry();
  manifest.scalar_type = volume::ScalarType::kInt16;
  manifest.value_range = {-5, 300};
  manifest.block_cells = {4, 4, 4};
  manifest.shards.resize(3);
  return manifest;
}

TEST(ProtoConvertTest, ManifestBecomesADatasetThatPassesItsOwnCheck) {
  const isoscope::v1::Dataset dataset = ToProto(SomeManifest());
  EXPECT_THAT(Validate(dataset, "dataset"), IsOk());
  EXPECT_EQ(dataset.name(), "head");
  EXPECT_EQ(dataset.sample_type(), isoscope::v1::SAMPLE_TYPE_INT16);
  EXPECT_EQ(dataset.block_count(), 2 * 2 * 2);
  EXPECT_EQ(dataset.shard_count(), 3);
  EXPECT_EQ(dataset.value_range().max(), 300);
}

TEST(ProtoConvertTest, AVolumeOfNanOnlyHasNoValueRange) {
  store::Manifest manifest = SomeManifest();
  manifest.value_range = {};
  EXPECT_FALSE(ToProto(manifest).has_value_range());
  EXPECT_THAT(Validate(ToProto(manifest), "dataset"), IsOk());
}

TEST(ProtoConvertTest, DatasetsThatContradictThemselvesAreRefused) {
  const auto expect_bad = [](const std::function<void(isoscope::v1::Dataset*)>& spoil,
                             const std::string& field) {
    isoscope::v1::Dataset dataset = ToProto(SomeManifest());
    spoil(&dataset);
    EXPECT_THAT(Validate(dataset, "dataset"),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("dataset." + field)));
  };
  expect_bad([](auto* d) { d->clear_name(); }, "name");
  expect_bad([](auto* d) { d->set_dataset_id("xyz"); }, "dataset_id");
  expect_bad([](auto* d) { d->set_block_count(9); }, "block_count");
  expect_bad([](auto* d) { d->set_shard_count(0); }, "shard_count");
  expect_bad([](auto* d) { d->mutable_block_cells()->set_x(0); }, "block_cells");
  expect_bad([](auto* d) { d->mutable_value_range()->set_min(kNan); }, "value_range");
}

TEST(ProtoConvertTest, BlockListsSurviveBothWays) {
  for (const std::vector<volume::BlockId>& ids :
       std::vector<std::vector<volume::BlockId>>{{}, {0}, {99}, {0, 1, 2, 50, 99}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<volume::BlockId> again,
                                  BlockListFromProto(ToProto(ids), 100, "hits"));
    EXPECT_EQ(again, ids);
  }
}

TEST(ProtoConvertTest, BlockListsThatLeaveTheVolumeOrDoNotAscendAreRefused) {
  for (const std::vector<std::int64_t>& deltas :
       std::vector<std::vector<std::int64_t>>{{-1},
                                              {100},
                                              {99, 1},
                                              {5, 0},
                                              {5, -3},
                                              {1, std::numeric_limits<std::int64_t>::max()},
                                              {std::numeric_limits<std::int64_t>::min()}}) {
    isoscope::internal::v1::BlockList proto;
    proto.mutable_block_id_deltas()->Add(deltas.begin(), deltas.end());
    EXPECT_THAT(BlockListFromProto(proto, 100, "hits"),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("hits.block_id_deltas[")));
  }
}

TEST(ProtoConvertTest, ShardIndicesMustAscendWithinTheDataset) {
  const auto convert = [](const std::vector<std::int32_t>& indices) {
    isoscope::internal::v1::ExtractSurfaceRequest request;
    request.mutable_shard_indices()->Add(indices.begin(), indices.end());
    return ShardIndicesFromProto(request.shard_indices(), 4, "shard_indices");
  };
  EXPECT_EQ(*convert({0, 2, 3}), (std::vector<int>{0, 2, 3}));
  for (const std::vector<std::int32_t>& bad :
       std::vector<std::vector<std::int32_t>>{{}, {-1}, {4}, {1, 1}, {2, 1}}) {
    EXPECT_THAT(convert(bad), StatusIs(absl::StatusCode::kInvalidArgument));
  }
}

TEST(ProtoConvertTest, StatisticsOfAnAgentComeBack) {
  isoscope::v1::AgentStatistics proto;
  proto.set_agent_address("b:1");
  proto.add_shard_indices(3);
  proto.add_shard_indices(5);
  // Each number is different.
  const google::protobuf::Descriptor* const descriptor = proto.GetDescriptor();
  for (int i = 0; i < descriptor->field_count(); ++i) {
    const google::protobuf::FieldDescriptor* const field = descriptor->field(i);
    if (field->type() == google::protobuf::FieldDescriptor::TYPE_INT64) {
      proto.GetReflection()->SetInt64(&proto, field, 100 + i);
    } else if (field->type() == google::protobuf::FieldDescriptor::TYPE_MESSAGE &&
               !field->is_repeated()) {
      static_cast<google::protobuf::Duration*>(proto.GetReflection()->MutableMessage(&proto, field))
          ->set_nanos(200 + i);
    }
  }
  for (int i = 1; i <= 2; ++i) {
    proto.add_surfaces()->set_triangle_count(300 + i);
    proto.mutable_surfaces(i - 1)->set_unique_vertex_count(400 + i);
  }
  EXPECT_EQ(ToProto(AgentStatisticsFromProto(proto)).SerializeAsString(),
            proto.SerializeAsString());
  EXPECT_GT(proto.busy_duration().nanos(), 200) << "every kind of field was set";
}

TEST(ProtoConvertTest, DurationsSurviveToTheNanosecondAndAreClamped) {
  for (const absl::Duration d : {absl::ZeroDuration(), absl::Nanoseconds(1), -absl::Nanoseconds(7),
                                 absl::Seconds(3) + absl::Nanoseconds(5)}) {
    EXPECT_EQ(DurationFromProto(ToProto(d)), d);
  }
  EXPECT_EQ(ToProto(absl::InfiniteDuration()).seconds(), 315'576'000'000);
}

TEST(ProtoConvertTest, OnlyFiniteNumbersPass) {
  EXPECT_THAT(CheckFinite(-1e308, "isovalue"), IsOk());
  for (const double bad : {kNan, kInf, -kInf}) {
    EXPECT_THAT(CheckFinite(bad, "isovalue"),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("isovalue is ")));
  }
}

// Agents compute the coordinator's view, bit for bit, from a message that the coordinator makes.
TEST(CameraConvertTest, EveryAngleOfAMessageComesBackAsTheSameBits) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> angles(0, 180);
  isoscope::v1::Camera proto = GoodCamera();
  for (int i = 0; i < 20000; ++i) {
    double degrees = angles(random);
    degrees = i % 3 == 0   ? degrees * 1e-12
              : i % 3 == 1 ? std::nextafter(180 - degrees / 1e9, 0)
                           : degrees;
    proto.mutable_perspective()->set_fov_y_degrees(degrees);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const view::Camera camera, CameraFromProto(proto, "camera"));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const view::Camera again,
                                  CameraFromProto(ToProto(camera), "camera"));
    ASSERT_EQ(again, camera) << degrees;
  }
}

}  // namespace
}  // namespace isoscope::wire
