// Planes, picks and streams of a cluster of real processes: they agree with each other in every
// pixel, for any number of agents, and bad requests are named.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "google/protobuf/util/message_differencer.h"
#include "gtest/gtest.h"
#include <grpcpp/client_context.h>
#include <nlohmann/json.hpp>

#include "core/base/coding.h"
#include "core/base/monotonic_time.h"
#include "core/base/random.h"
#include "core/image/png_codec.h"
#include "core/io/file.h"
#include "core/math/vec.h"
#include "core/store/shard_reader.h"
#include "core/volume/block_layout.h"
#include "core/volume/field_gradient.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "wire/response_splitter.h"

namespace isoscope {
namespace {

namespace v1 = isoscope::v1;
using ::testing::HasSubstr;
using testing::ProcessCluster;
using testing::StatusIs;

constexpr int kShardCounts[] = {1, 3};
constexpr int kWidth = 200;
constexpr int kHeight = 160;

float FloatAt(const std::string& plane, std::size_t index) {
  return base::LoadLittleEndian<float>(plane.data() + index * sizeof(float));
}

class PlanesTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    shared_ = new testing::TempDir();
    for (const int shard_count : kShardCounts) {
      ISOSCOPE_ASSERT_OK(testing::MakeDataset(Volume(), Dataset(shard_count), shard_count, 8));
    }
  }
  static void TearDownTestSuite() {
    delete shared_;
    shared_ = nullptr;
  }

  static testing::TestVolume Volume() { return testing::GyroidVolume({43, 37, 29}); }
  static std::string Dataset(int shard_count) {
    return shared_->Sub("d" + std::to_string(shard_count));
  }

  void StartCluster(int shard_count, const std::vector<std::string>& flags = {}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(cluster_,
                                  ProcessCluster::Start(Dataset(shard_count), shard_count, flags));
    stub_ = v1::IsosurfaceService::NewStub(rpc::MakeFreshChannel(cluster_->address()));
  }

  // The gyroid from beside, with all planes.
  static v1::RenderIsosurfaceRequest Request() {
    v1::RenderIsosurfaceRequest request = testing::SmallRequest();
    request.mutable_viewport()->set_width_px(kWidth);
    request.mutable_viewport()->set_height_px(kHeight);
    v1::Camera* camera = request.mutable_camera();
    camera->mutable_eye()->set_x(90);
    camera->mutable_eye()->set_y(60);
    camera->mutable_eye()->set_z(70);
    camera->mutable_target()->set_x(21);
    camera->mutable_target()->set_y(18);
    camera->mutable_target()->set_z(14);
    camera->mutable_perspective()->set_fov_y_degrees(35);
    v1::OutputOptions* output = request.mutable_output();
    output->set_depth(true);
    output->set_surface_index(true);
    output->set_position(true);
    output->set_normal(true);
    return request;
  }

  absl::StatusOr<v1::RenderIsosurfaceResponse> Render(const v1::RenderIsosurfaceRequest& request) {
    grpc::ClientContext context;
    context.set_deadline(base::MonotonicNow() + testing::kPatience);
    v1::RenderIsosurfaceResponse response;
    const absl::Status status =
        rpc::ToAbslStatus(stub_->RenderIsosurface(&context, request, &response));
    return status.ok() ? absl::StatusOr<v1::RenderIsosurfaceResponse>(response) : status;
  }

  absl::StatusOr<v1::RenderIsosurfaceResponse> RenderStream(
      const v1::RenderIsosurfaceRequest& request, int* part_count = nullptr) {
    grpc::ClientContext context;
    context.set_deadline(base::MonotonicNow() + testing::kPatience);
    v1::RenderIsosurfaceStreamRequest in_parts;
    *in_parts.mutable_request() = request;
    const auto reader = stub_->RenderIsosurfaceStream(&context, in_parts);
    v1::RenderIsosurfaceStreamResponse message;
    v1::RenderIsosurfaceResponse response;
    int count = 0;
    while (reader->Read(&message)) {
      ++count;
      EXPECT_LE(message.ByteSizeLong(), wire::kMaxPartBytes + 65536);
      wire::AppendPart(message.part(), &response);
    }
    if (part_count != nullptr) {
      *part_count = count;
    }
    const absl::Status status = rpc::ToAbslStatus(reader->Finish());
    return status.ok() ? absl::StatusOr<v1::RenderIsosurfaceResponse>(response) : status;
  }

  absl::StatusOr<v1::PickSurfaceResponse> Pick(const v1::PickSurfaceRequest& request) {
    grpc::ClientContext context;
    context.set_deadline(base::MonotonicNow() + testing::kPatience);
    v1::PickSurfaceResponse response;
    const absl::Status status = rpc::ToAbslStatus(stub_->PickSurface(&context, request, &response));
    return status.ok() ? absl::StatusOr<v1::PickSurfaceResponse>(response) : status;
  }

  static testing::TempDir* shared_;
  std::unique_ptr<ProcessCluster> cluster_;
  std::unique_ptr<v1::IsosurfaceService::Stub> stub_;
};

testing::TempDir* PlanesTest::shared_ = nullptr;

TEST_F(PlanesTest, PlanesDoNotDependOnAgentsCullingStreamOrRegion) {
  v1::RenderIsosurfaceResponse expected;
  for (const int shard_count : kShardCounts) {
    SCOPED_TRACE(shard_count);
    ASSERT_NO_FATAL_FAILURE(StartCluster(shard_count));
    v1::RenderIsosurfaceRequest request = Request();
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response, Render(request));
    if (shard_count == kShardCounts[0]) {
      expected = response;
    }
    const auto expect_same = [&](const v1::RenderIsosurfaceResponse& other, const char* what) {
      EXPECT_EQ(other.png() == expected.png(), true) << what;
      EXPECT_EQ(other.depth() == expected.depth(), true) << what;
      EXPECT_EQ(other.surface_index() == expected.surface_index(), true) << what;
      EXPECT_EQ(other.position() == expected.position(), true) << what;
      EXPECT_EQ(other.normal() == expected.normal(), true) << what;
    };
    expect_same(response, "agents");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse streamed,
                                  RenderStream(request));
    expect_same(streamed, "stream");
    request.set_culling(v1::CULLING_NONE);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse all, Render(request));
    expect_same(all, "culling");
    // The picture without planes is the same, and a plane without the picture.
    v1::RenderIsosurfaceRequest plain = Request();
    plain.clear_output();
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse alone, Render(plain));
    EXPECT_TRUE(alone.png() == expected.png());
    EXPECT_TRUE(alone.depth().empty() && alone.normal().empty() && alone.position().empty());
    plain.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_NONE);
    plain.mutable_output()->set_normal(true);
    plain.mutable_output()->set_depth(true);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse normals, Render(plain));
    EXPECT_TRUE(normals.normal() == expected.normal());
    EXPECT_TRUE(normals.depth() == expected.depth());
    EXPECT_TRUE(normals.png().empty());
    // A region's planes are the crop.
    v1::RenderIsosurfaceRequest region = Request();
    region.mutable_region()->set_x(60);
    region.mutable_region()->set_y(31);
    region.mutable_region()->set_width_px(90);
    region.mutable_region()->set_height_px(70);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse part, Render(region));
    EXPECT_EQ(part.extent().width_px(), 90);
    EXPECT_EQ(part.extent().height_px(), 70);
    for (std::size_t y = 0; y < 70; ++y) {
      EXPECT_TRUE(part.depth().substr(y * 360, 360) ==
                  expected.depth().substr(((y + 31) * kWidth + 60) * 4, 360));
      EXPECT_TRUE(part.position().substr(y * 1080, 1080) ==
                  expected.position().substr(((y + 31) * kWidth + 60) * 12, 1080));
      EXPECT_TRUE(part.normal().substr(y * 1080, 1080) ==
                  expected.normal().substr(((y + 31) * kWidth + 60) * 12, 1080));
    }
  }
}

// The interval that the plane states, and the depth plane of the same picture.
void ExpectBounded(const v1::RenderIsosurfaceResponse& response, int* background_count) {
  const std::size_t pixel_count = response.depth().size() / 4;
  ASSERT_EQ(response.depth_bounds().size(), 8 * pixel_count);
  for (std::size_t i = 0; i < pixel_count; ++i) {
    const float depth = FloatAt(response.depth(), i);
    const float nearest = FloatAt(response.depth_bounds(), 2 * i);
    const float farthest = FloatAt(response.depth_bounds(), 2 * i + 1);
    ASSERT_LE(nearest, farthest);
    ASSERT_EQ(std::isinf(nearest), std::isinf(farthest));
    *background_count += std::isinf(nearest) ? 1 : 0;
    if (!std::isinf(depth)) {
      ASSERT_LE(nearest, depth) << "pixel " << i;
      ASSERT_GE(farthest, depth) << "pixel " << i;
    }
  }
}

TEST_F(PlanesTest, BoundsHoldTheDepthsAndDoNotDependOnAgentsOrRegion) {
  std::string expected;
  for (const int shard_count : kShardCounts) {
    SCOPED_TRACE(shard_count);
    ASSERT_NO_FATAL_FAILURE(StartCluster(shard_count));
    v1::RenderIsosurfaceRequest request = Request();
    request.mutable_output()->set_depth_bounds(true);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response, Render(request));
    int background_count = 0;
    ASSERT_NO_FATAL_FAILURE(ExpectBounded(response, &background_count));
    EXPECT_GT(background_count, 0);
    EXPECT_LT(background_count, kWidth * kHeight);
    if (expected.empty()) {
      expected = response.depth_bounds();
    }
    EXPECT_TRUE(response.depth_bounds() == expected);
    // Alone: nothing is drawn.
    request.mutable_output()->Clear();
    request.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_NONE);
    request.mutable_output()->set_depth_bounds(true);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse alone, RenderStream(request));
    EXPECT_TRUE(alone.depth_bounds() == expected);
    EXPECT_EQ(alone.statistics().triangle_count(), 0);
    request.mutable_region()->set_x(60);
    request.mutable_region()->set_y(31);
    request.mutable_region()->set_width_px(90);
    request.mutable_region()->set_height_px(70);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse part, Render(request));
    for (std::size_t y = 0; y < 70; ++y) {
      EXPECT_TRUE(part.depth_bounds().substr(y * 720, 720) ==
                  expected.substr(((y + 31) * kWidth + 60) * 8, 720));
    }
  }
}

// Cuts with caps show what has no triangles.
TEST_F(PlanesTest, BoundsHoldCaps) {
  ASSERT_NO_FATAL_FAILURE(StartCluster(3));
  v1::RenderIsosurfaceRequest request = Request();
  request.mutable_output()->set_depth_bounds(true);
  v1::HalfSpace* const cut = request.mutable_clip()->add_half_spaces();
  cut->mutable_normal()->set_x(1);
  cut->mutable_normal()->set_y(0.25);
  cut->set_offset(21);
  request.mutable_caps();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response, Render(request));
  int background_count = 0;
  ASSERT_NO_FATAL_FAILURE(ExpectBounded(response, &background_count));
}

// More pixels than agents are asked for at a time.
TEST_F(PlanesTest, BoundsOfALargePictureAreJoinedFromRows) {
  ASSERT_NO_FATAL_FAILURE(StartCluster(3));
  v1::RenderIsosurfaceRequest request = Request();
  request.mutable_output()->Clear();
  request.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_NONE);
  request.mutable_output()->set_depth_bounds(true);
  request.mutable_viewport()->set_width_px(1501);
  request.mutable_viewport()->set_height_px(1103);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse whole, RenderStream(request));
  ASSERT_EQ(whole.depth_bounds().size(), std::size_t{8} * 1501 * 1103);
  request.mutable_region()->set_y(700);
  request.mutable_region()->set_width_px(1501);
  request.mutable_region()->set_height_px(11);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse part, Render(request));
  EXPECT_TRUE(part.depth_bounds() ==
              whole.depth_bounds().substr(std::size_t{8} * 1501 * 700, std::size_t{8} * 1501 * 11));
}

TEST_F(PlanesTest, PlanesDescribeTheSurface) {
  // A ball: its normals point along its radii, its positions lie on it.
  const testing::TestVolume ball = testing::BallVolume({41, 41, 41}, 0.7);
  ISOSCOPE_ASSERT_OK(testing::MakeDataset(ball, shared_->Sub("ball"), 2, 8));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(cluster_, ProcessCluster::Start(shared_->Sub("ball"), 2));
  stub_ = v1::IsosurfaceService::NewStub(rpc::MakeFreshChannel(cluster_->address()));
  v1::RenderIsosurfaceRequest request = Request();
  request.clear_camera();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response, Render(request));
  const std::size_t pixel_count = std::size_t{kWidth} * kHeight;
  ASSERT_EQ(response.depth().size(), 4 * pixel_count);
  ASSERT_EQ(response.position().size(), 12 * pixel_count);
  ASSERT_EQ(response.normal().size(), 12 * pixel_count);
  ASSERT_EQ(response.surface_index().size(), pixel_count);
  const double eye_z = response.camera().eye().z();
  int hits = 0;
  for (std::size_t i = 0; i < pixel_count; ++i) {
    const auto surface = static_cast<unsigned char>(response.surface_index()[i]);
    const float depth = FloatAt(response.depth(), i);
    ASSERT_EQ(std::isinf(depth), surface == 255);
    ASSERT_EQ(std::isnan(FloatAt(response.position(), 3 * i)), surface == 255);
    ASSERT_EQ(std::isnan(FloatAt(response.normal(), 3 * i)), surface == 255);
    if (surface == 255) {
      continue;
    }
    ++hits;
    ASSERT_EQ(surface, 0);
    double radius_squared = 0;
    double along = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double p = static_cast<double>(FloatAt(response.position(), 3 * i + axis)) - 20;
      radius_squared += p * p;
      along += p * static_cast<double>(FloatAt(response.normal(), 3 * i + axis));
    }
    const double radius = std::sqrt(radius_squared);
    ASSERT_NEAR(radius, 14, 0.3) << "pixel " << i;
    ASSERT_GT(along / radius, 0.98) << "pixel " << i;
    // The default camera looks along -z: the distance is that of the heights.
    ASSERT_NEAR(static_cast<double>(depth),
                eye_z - static_cast<double>(FloatAt(response.position(), 3 * i + 2)), 1e-3);
  }
  EXPECT_GT(hits, 2000);
}

TEST_F(PlanesTest, PicksAreThePlanesInTenThousandPixels) {
  std::vector<v1::Vec3> gradients;  // of all hits, with one agent
  for (const int shard_count : kShardCounts) {
    SCOPED_TRACE(shard_count);
    ASSERT_NO_FATAL_FAILURE(StartCluster(shard_count));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse planes, Render(Request()));
    int differences = 0;
    int hits = 0;
    int pixels = 0;
    std::set<int> shards;
    for (std::uint64_t call = 0; call < 10; ++call) {
      v1::PickSurfaceRequest request;
      *request.mutable_frame() = Request();
      request.mutable_frame()->clear_output();
      // Calls look at windows of different sizes, so that different regions are drawn.
      const double share = 0.1 * static_cast<double>(call + 1);
      for (std::uint64_t i = 0; i < 1000; ++i) {
        const auto unit = [&](std::uint64_t k) { return base::RandomUnit(call, 2 * i + k); };
        v1::Pixel* pixel = request.add_pixels();
        pixel->set_x(static_cast<int>(kWidth * (0.5 + share * (unit(0) - 0.5))));
        pixel->set_y(static_cast<int>(kHeight * (0.5 + share * (unit(1) - 0.5))));
      }
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::PickSurfaceResponse picks, Pick(request));
      ASSERT_EQ(picks.points_size(), 1000);
      for (int i = 0; i < picks.points_size(); ++i) {
        const v1::PickedPoint& point = picks.points(i);
        const auto at =
            static_cast<std::size_t>(request.pixels(i).y() * kWidth + request.pixels(i).x());
        ++pixels;
        const float depth = FloatAt(planes.depth(), at);
        if (point.is_hit() == std::isinf(depth)) {
          ++differences;
          continue;
        }
        if (!point.is_hit()) {
          continue;
        }
        ++hits;
        const std::vector<double> position{point.position().x(), point.position().y(),
                                           point.position().z()};
        bool same = point.depth() == depth &&
                    point.surface_index() == static_cast<unsigned char>(planes.surface_index()[at]);
        for (std::size_t axis = 0; axis < 3; ++axis) {
          same = same &&
                 static_cast<float>(position[axis]) == FloatAt(planes.position(), 3 * at + axis);
        }
        same = same && point.has_normal() &&
               static_cast<float>(point.normal().x()) == FloatAt(planes.normal(), 3 * at) &&
               static_cast<float>(point.normal().z()) == FloatAt(planes.normal(), 3 * at + 2);
        // The normal is interpolated over a triangle, the gradient over a cell.
        const math::Vec3d gradient{point.gradient().x(), point.gradient().y(),
                                   point.gradient().z()};
        const math::Vec3d normal{point.normal().x(), point.normal().y(), point.normal().z()};
        same = same && math::Dot(gradient, normal) < -0.9 * math::Length(gradient);
        if (shard_count == 1) {
          gradients.push_back(point.gradient());
        } else {
          same = same && google::protobuf::util::MessageDifferencer::Equals(
                             point.gradient(), gradients.at(static_cast<std::size_t>(hits - 1)));
        }
        same = same && point.has_shard_index() && point.shard_index() >= 0 &&
               point.shard_index() < shard_count && point.block_id() >= 0;
        differences += same ? 0 : 1;
        shards.insert(point.shard_index());
      }
    }
    EXPECT_EQ(pixels, 10000);
    EXPECT_EQ(differences, 0);
    EXPECT_GT(hits, 5000);
    EXPECT_EQ(static_cast<int>(shards.size()), shard_count);
  }
}

// Caps are surfaces to planes and picks, whatever colours they show.
TEST_F(PlanesTest, PlanesAndPicksKnowCaps) {
  v1::RenderIsosurfaceRequest request = Request();
  v1::HalfSpace* const half_space = request.mutable_clip()->add_half_spaces();
  half_space->mutable_normal()->set_x(-3);
  half_space->mutable_normal()->set_z(-4);
  half_space->set_offset(-150);
  v1::RenderIsosurfaceResponse first;
  for (const bool has_map : {false, true}) {
    request.mutable_caps()->Clear();
    if (has_map) {
      request.mutable_caps()->set_color_map(v1::COLOR_MAP_GREY);
      request.add_lights()->mutable_direction()->set_z(1);  // normals in place of colours
    }
    for (const int shard_count : kShardCounts) {
      SCOPED_TRACE(shard_count);
      ASSERT_NO_FATAL_FAILURE(StartCluster(shard_count));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse planes, Render(request));
      if (first.depth().empty()) {
        first = planes;
      }
      EXPECT_TRUE(planes.depth() == first.depth());
      EXPECT_TRUE(planes.normal() == first.normal());
      EXPECT_TRUE(planes.surface_index() == first.surface_index());
      int cap_count = 0;
      v1::PickSurfaceRequest pick;
      *pick.mutable_frame() = request;
      pick.mutable_frame()->clear_output();
      std::vector<std::size_t> picked;
      for (std::size_t i = 0; i < std::size_t{kWidth} * kHeight; ++i) {
        const double x = static_cast<double>(FloatAt(planes.position(), 3 * i));
        const double z = static_cast<double>(FloatAt(planes.position(), 3 * i + 2));
        if (!(std::abs(3 * x + 4 * z - 150) < 1e-3)) {
          continue;
        }
        ++cap_count;
        EXPECT_NEAR(static_cast<double>(FloatAt(planes.normal(), 3 * i)), 0.6, 1e-4);
        EXPECT_NEAR(static_cast<double>(FloatAt(planes.normal(), 3 * i + 2)), 0.8, 1e-4);
        EXPECT_EQ(planes.surface_index()[i], 0);
        if (cap_count % 7 == 0 && pick.pixels_size() < 300) {
          pick.add_pixels()->set_x(static_cast<int>(i % kWidth));
          pick.mutable_pixels(pick.pixels_size() - 1)->set_y(static_cast<int>(i / kWidth));
          picked.push_back(i);
        }
      }
      EXPECT_GT(cap_count, 700);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::PickSurfaceResponse picks, Pick(pick));
      ASSERT_EQ(picks.points_size(), static_cast<int>(picked.size()));
      for (int i = 0; i < picks.points_size(); ++i) {
        const v1::PickedPoint& point = picks.points(i);
        const std::size_t at = picked[static_cast<std::size_t>(i)];
        EXPECT_TRUE(point.is_hit());
        EXPECT_EQ(point.depth(), FloatAt(planes.depth(), at));
        EXPECT_EQ(point.normal().x(), static_cast<double>(FloatAt(planes.normal(), 3 * at)));
        EXPECT_EQ(point.surface_index(), 0);
        EXPECT_TRUE(point.has_gradient());
      }
    }
  }
}

TEST_F(PlanesTest, ASinglePickTellsTheShardOfAnAgentWithSeveral) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(testing::ServerProcess agent, testing::StartAgent({Dataset(3)}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(testing::ServerProcess coordinator,
                                testing::StartCoordinator({agent.address}));
  const auto alone = v1::IsosurfaceService::NewStub(rpc::MakeFreshChannel(coordinator.address));
  ASSERT_NO_FATAL_FAILURE(StartCluster(3));
  v1::PickSurfaceRequest request;
  *request.mutable_frame() = Request();
  request.mutable_frame()->clear_output();
  for (int i = 0; i < 20; ++i) {
    request.clear_pixels();
    request.add_pixels()->set_x(70 + 3 * i);
    request.mutable_pixels(0)->set_y(60 + 2 * i);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::PickSurfaceResponse expected, Pick(request));
    grpc::ClientContext context;
    v1::PickSurfaceResponse response;
    ISOSCOPE_ASSERT_OK(rpc::ToAbslStatus(alone->PickSurface(&context, request, &response)));
    EXPECT_TRUE(
        google::protobuf::util::MessageDifferencer::Equals(response.points(0), expected.points(0)))
        << response.points(0).DebugString() << expected.points(0).DebugString();
  }
}

// A slab between the planes z = 8 and z = 40, which are faces of blocks; there are samples that are
// not numbers near both.
testing::TestVolume SlabVolume() {
  testing::TestVolume slab;
  slab.geometry.sample_dims = {41, 41, 49};
  slab.type = volume::ScalarType::kFloat32;
  for (int z = 0; z < slab.geometry.sample_dims.z; ++z) {
    for (int y = 0; y < slab.geometry.sample_dims.y; ++y) {
      for (int x = 0; x < slab.geometry.sample_dims.x; ++x) {
        const bool is_hole = (z == 9 || z == 39) && x % 5 == 0 && y % 5 == 0;
        base::AppendLittleEndian(is_hole ? std::numeric_limits<float>::quiet_NaN()
                                         : static_cast<float>(128 + 4 * (16 - std::abs(z - 24))),
                                 &slab.samples);
      }
    }
  }
  return slab;
}

// Returns the shard of each block, as the shards' own files say.
std::map<std::int64_t, int> ShardsByBlock(const std::string& dataset, int shard_count) {
  std::map<std::int64_t, int> shards;
  for (int i = 0; i < shard_count; ++i) {
    const auto reader = store::ShardReader::Open(testing::ShardDirectory(dataset, i, shard_count));
    EXPECT_TRUE(reader.ok()) << reader.status();
    for (std::uint32_t ordinal = 0; ordinal < (*reader)->block_count(); ++ordinal) {
      shards.emplace((*reader)->block_id(ordinal), i);
    }
  }
  return shards;
}

// Also beside samples that are not numbers, on a cap in a block that no surface meets, and where
// the point's cell is another block's than the one that drew it.
TEST_F(PlanesTest, APickTellsTheShardOfTheBlockHoweverManyAnAgentHas) {
  const testing::TestVolume slab = SlabVolume();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::BlockLayout layout,
                                volume::BlockLayout::Make(slab.geometry.sample_dims, {8, 8, 8}));
  v1::PickSurfaceRequest request;
  *request.mutable_frame() = Request();
  request.mutable_frame()->clear_output();
  v1::HalfSpace* const half_space = request.mutable_frame()->mutable_clip()->add_half_spaces();
  half_space->mutable_normal()->set_x(-1);
  half_space->set_offset(-20.5);
  request.mutable_frame()->mutable_caps();
  for (int i = 0; i < 1000; ++i) {
    request.add_pixels()->set_x(5 * (i % 40));
    request.mutable_pixels(i)->set_y(6 * (i / 40));
  }
  std::vector<v1::PickSurfaceResponse> one_shard_picks;
  for (const int shard_count : {1, 3, 80}) {
    SCOPED_TRACE(shard_count);
    const std::string dataset = shared_->Sub("slab" + std::to_string(shard_count));
    ISOSCOPE_ASSERT_OK(testing::MakeDataset(slab, dataset, shard_count, 8));
    const std::map<std::int64_t, int> shards = ShardsByBlock(dataset, shard_count);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(testing::ServerProcess agent, testing::StartAgent({dataset}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(testing::ServerProcess coordinator,
                                  testing::StartCoordinator({agent.address}));
    stub_ = v1::IsosurfaceService::NewStub(rpc::MakeFreshChannel(coordinator.address));
    int beside_holes = 0;
    int on_inner_caps = 0;
    int on_faces = 0;
    for (const bool is_from_above : {false, true}) {
      v1::Camera* const camera = request.mutable_frame()->mutable_camera();
      *camera->mutable_eye() = v1::Vec3();
      camera->mutable_eye()->set_x(70);
      camera->mutable_eye()->set_y(20);
      camera->mutable_eye()->set_z(is_from_above ? 90 : -40);
      camera->mutable_target()->set_y(20);
      camera->mutable_target()->set_z(24);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(v1::PickSurfaceResponse picked, Pick(request));
      for (v1::PickedPoint& point : *picked.mutable_points()) {
        if (!point.is_hit()) {
          continue;
        }
        ASSERT_TRUE(point.has_shard_index()) << point.DebugString();
        EXPECT_EQ(point.shard_index(), shards.at(point.block_id())) << point.DebugString();
        point.clear_shard_index();
        const math::Vec3d position{point.position().x(), point.position().y(),
                                   point.position().z()};
        const auto block = static_cast<volume::BlockId>(point.block_id());
        const auto is_near_hole = [](double at) { return std::abs(std::remainder(at, 5)) < 1; };
        beside_holes += is_near_hole(position.x) && is_near_hole(position.y) ? 1 : 0;
        on_inner_caps += std::abs(position.x - 20.5) < 1e-3 && position.z > 17 && position.z < 31;
        on_faces += volume::BlockOfCell(layout, volume::CellAt(layout, position)) != block ? 1 : 0;
      }
      picked.clear_statistics();
      if (shard_count == 1) {
        one_shard_picks.push_back(picked);
      }
      EXPECT_TRUE(google::protobuf::util::MessageDifferencer::Equals(
          picked, one_shard_picks[is_from_above ? 1 : 0]));
    }
    EXPECT_GT(beside_holes, 10);
    EXPECT_GT(on_inner_caps, 10);
    EXPECT_GT(on_faces, 10);
  }
}

// The agent has room for three frames, and more shards.
TEST_F(PlanesTest, APickIsOneFrameToAnAgentWithManyShards) {
  const std::string dataset = shared_->Sub("d32");
  ISOSCOPE_ASSERT_OK(testing::MakeDataset(Volume(), dataset, 32, 8));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      testing::ServerProcess agent,
      testing::StartAgent({dataset}, "127.0.0.1:0",
                          {"--max-concurrent-frames", "1", "--max-queued-frames", "2"}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(testing::ServerProcess coordinator,
                                testing::StartCoordinator({agent.address}));
  stub_ = v1::IsosurfaceService::NewStub(rpc::MakeFreshChannel(coordinator.address));
  v1::PickSurfaceRequest request;
  *request.mutable_frame() = Request();
  request.mutable_frame()->clear_output();
  request.add_pixels()->set_x(70);
  request.mutable_pixels(0)->set_y(60);
  std::vector<std::thread> threads;
  for (int i = 0; i < 3; ++i) {
    threads.emplace_back([&] { ISOSCOPE_EXPECT_OK(Pick(request).status()); });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
}

TEST_F(PlanesTest, RawAndJpegShowThePngsPicture) {
  ASSERT_NO_FATAL_FAILURE(StartCluster(1));
  v1::RenderIsosurfaceRequest request = Request();
  request.clear_output();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse png, Render(request));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const image::RgbaImage decoded, image::DecodePng(png.png()));
  request.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_RGBA8);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse raw, Render(request));
  ASSERT_EQ(raw.rgba8().size(), decoded.pixels.size() * 4);
  EXPECT_EQ(std::memcmp(raw.rgba8().data(), decoded.pixels.data(), raw.rgba8().size()), 0);
  EXPECT_TRUE(raw.png().empty());
  request.mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_JPEG);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse jpeg, Render(request));
  EXPECT_EQ(jpeg.jpeg().substr(0, 2), "\xff\xd8");
  request.mutable_output()->set_jpeg_quality(90);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse ninety, Render(request));
  EXPECT_EQ(jpeg.jpeg(), ninety.jpeg());
  request.mutable_output()->set_jpeg_quality(10);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse ten, Render(request));
  EXPECT_LT(ten.jpeg().size(), ninety.jpeg().size());
}

TEST_F(PlanesTest, LargePlanesComeAsAStreamAndAreRefusedInOneMessage) {
  ASSERT_NO_FATAL_FAILURE(StartCluster(1));
  v1::RenderIsosurfaceRequest request = Request();
  request.mutable_viewport()->set_width_px(4000);
  request.mutable_viewport()->set_height_px(2500);
  const absl::Status refused = Render(request).status();
  EXPECT_THAT(refused,
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("RenderIsosurfaceStream")));
  request.mutable_output()->set_normal(false);
  request.mutable_output()->set_position(false);
  int part_count = 0;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response,
                                RenderStream(request, &part_count));
  EXPECT_EQ(response.depth().size(), std::size_t{4} * 4000 * 2500);
  EXPECT_EQ(response.surface_index().size(), std::size_t{1} * 4000 * 2500);
  EXPECT_GT(part_count, 45);
}

TEST_F(PlanesTest, TheCoordinatorsMemoryLimitRefusesBeforeAgentsWorkAndQueuesTheRest) {
  ASSERT_NO_FATAL_FAILURE(StartCluster(1, {"--memory-limit", "96MiB"}));
  v1::RenderIsosurfaceRequest request = Request();
  request.clear_output();
  request.mutable_viewport()->set_width_px(8192);
  request.mutable_viewport()->set_height_px(8192);
  const base::MonotonicTime start = base::MonotonicNow();
  EXPECT_THAT(Render(request),
              StatusIs(absl::StatusCode::kResourceExhausted,
                       ::testing::AllOf(HasSubstr("8192 x 8192"), HasSubstr("96 MiB"),
                                        HasSubstr("coordinator's --memory-limit"))));
  EXPECT_LT(base::MonotonicNow() - start, testing::kPatience);
  // Frames of which only one fits at a time all come.
  request.mutable_viewport()->set_width_px(1024);
  request.mutable_viewport()->set_height_px(1024);
  std::vector<std::thread> clients;
  for (int i = 0; i < 6; ++i) {
    clients.emplace_back(
        [&] { ISOSCOPE_EXPECT_OK(testing::Render(cluster_->address(), request)); });
  }
  for (std::thread& client : clients) {
    client.join();
  }
}

TEST_F(PlanesTest, HostileOptionsAreNamedWithValueAndRange) {
  ASSERT_NO_FATAL_FAILURE(StartCluster(1));
  const auto expect = [&](const std::vector<std::string>& parts,
                          const std::function<void(v1::RenderIsosurfaceRequest*)>& spoil) {
    v1::RenderIsosurfaceRequest request = Request();
    spoil(&request);
    for (const absl::Status& status : {Render(request).status(), RenderStream(request).status()}) {
      EXPECT_THAT(status, StatusIs(absl::StatusCode::kInvalidArgument));
      for (const std::string& part : parts) {
        EXPECT_THAT(std::string(status.message()), HasSubstr(part));
      }
    }
  };
  for (const int format :
       {-1, 5, std::numeric_limits<int>::max(), std::numeric_limits<int>::min()}) {
    expect({"output.image_format is " + std::to_string(format), "2 (JPEG)"}, [&](auto* r) {
      r->mutable_output()->set_image_format(static_cast<v1::OutputOptions::ImageFormat>(format));
    });
  }
  for (const int quality :
       {-1, 101, std::numeric_limits<int>::max(), std::numeric_limits<int>::min()}) {
    expect({"output.jpeg_quality is " + std::to_string(quality), "[1, 100]"}, [&](auto* r) {
      r->mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_JPEG);
      r->mutable_output()->set_jpeg_quality(quality);
    });
  }
  expect({"output.jpeg_quality is 50", "JPEG"},
         [](auto* r) { r->mutable_output()->set_jpeg_quality(50); });
  expect({"output.image_format is 4", "output.depth"}, [](auto* r) {
    r->mutable_output()->Clear();
    r->mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_NONE);
  });
  expect({"background_color.alpha is 0.5", "JPEG"}, [](auto* r) {
    r->mutable_output()->set_image_format(v1::OutputOptions::IMAGE_FORMAT_JPEG);
    r->mutable_background_color()->set_alpha(0.5F);
  });
  expect({"number 90", "output"}, [](auto* r) {
    r->GetReflection();
    auto* output = r->mutable_output();
    output->GetReflection()->MutableUnknownFields(output)->AddVarint(90, 1);
  });
  // Picks.
  v1::PickSurfaceRequest pick;
  *pick.mutable_frame() = Request();
  pick.mutable_frame()->clear_output();
  EXPECT_THAT(Pick(pick), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("pixels has 0")));
  pick.add_pixels()->set_x(kWidth);
  EXPECT_THAT(Pick(pick),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("pixels[0].x is 200")));
  for (int i = 0; i < 1000; ++i) {
    pick.add_pixels();
  }
  EXPECT_THAT(Pick(pick),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("pixels has 1001")));
  ISOSCOPE_EXPECT_OK(Render(Request()));
}

TEST_F(PlanesTest, TheCommandLineWritesPlanesAndPicks) {
  const testing::TempDir folder;
  const auto run = [&](const std::vector<std::string>& flags) {
    std::vector<std::string> arguments{"render", Dataset(3), "--isovalue", "128",      "--renderer",
                                       "cpu",    "--width",  "64",         "--height", "48"};
    arguments.insert(arguments.end(), flags.begin(), flags.end());
    return testing::RunIsoscope(arguments);
  };
  const testing::CommandResult planes =
      run({"--output", folder.Sub("p.jpg"), "--quality", "80", "--depth", folder.Sub("d.npy"),
           "--surface-index", folder.Sub("s.npy"), "--position", folder.Sub("p.npy"), "--normal",
           folder.Sub("n.npy"), "--depth-bounds", folder.Sub("b.npy")});
  ASSERT_EQ(planes.exit_code, 0) << planes.err;
  const auto size_of = [&](const char* name) {
    return static_cast<std::size_t>(std::filesystem::file_size(folder.Sub(name)));
  };
  EXPECT_EQ(size_of("d.npy"), 128U + 64 * 48 * 4);
  EXPECT_EQ(size_of("s.npy"), 128U + 64 * 48);
  EXPECT_EQ(size_of("p.npy"), 128U + 64 * 48 * 12);
  EXPECT_EQ(size_of("n.npy"), 128U + 64 * 48 * 12);
  EXPECT_EQ(size_of("b.npy"), 128U + 64 * 48 * 8);
  EXPECT_GT(size_of("p.jpg"), 500U);
  const testing::CommandResult alone = run({"--depth", folder.Sub("again.npy")});
  EXPECT_EQ(alone.exit_code, 0) << alone.err;
  EXPECT_EQ(size_of("again.npy"), size_of("d.npy"));
  EXPECT_EQ(run({"--output", folder.Sub("x.png"), "--quality", "80"}).exit_code, 2);
  EXPECT_EQ(run({}).exit_code, 2) << "neither a picture nor a plane";

  const testing::CommandResult picked = testing::RunIsoscope(
      {"pick", Dataset(3), "--isovalue", "128", "--renderer", "cpu", "--width", "64", "--height",
       "48", "--pixel", "32,24", "--pixel", "0,0", "--json"});
  EXPECT_EQ(picked.exit_code, 0) << picked.err;
  EXPECT_THAT(picked.out,
              ::testing::AllOf(HasSubstr("\"is_hit\": true"), HasSubstr("\"is_hit\": false"),
                               HasSubstr("\"is_hit\": true"), HasSubstr("\"shard_index\"")));
  // A named view, fitted to the surface: the depth of the plane of the same picture.
  const std::vector<std::string> view{"--view", "top", "--fit", "surface", "--zoom", "1.5"};
  std::vector<std::string> render_arguments{"--depth", folder.Sub("top.npy"), "--save-camera",
                                            folder.Sub("c.json")};
  render_arguments.insert(render_arguments.end(), view.begin(), view.end());
  EXPECT_EQ(run(render_arguments).exit_code, 0);
  std::string plane;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(plane, io::ReadWholeFile(folder.Sub("top.npy"), 1 << 20));
  const auto depth = base::LoadLittleEndian<float>(plane.data() + 128 + 4 * (24 * 64 + 32));
  for (const bool from_file : {false, true}) {
    std::vector<std::string> pick_arguments{
        "pick",   Dataset(3),   "--isovalue", "128",           "--width",
        "64",     "--height",   "48",         "--pixel",       "32,24",
        "--json", "--renderer", "cpu",        "--save-camera", folder.Sub("again.json")};
    const std::vector<std::string> camera{"--camera", folder.Sub("c.json")};
    pick_arguments.insert(pick_arguments.end(), from_file ? camera.begin() : view.begin(),
                          from_file ? camera.end() : view.end());
    const testing::CommandResult result = testing::RunIsoscope(pick_arguments);
    ASSERT_EQ(result.exit_code, 0) << result.err;
    EXPECT_EQ(nlohmann::json::parse(result.out).at("points").at(0).at("depth").get<float>(), depth);
    EXPECT_EQ(io::ReadWholeFile(folder.Sub("again.json"), 10'000).value_or("1"),
              io::ReadWholeFile(folder.Sub("c.json"), 10'000).value_or("2"));
  }
  const testing::CommandResult twice =
      testing::RunIsoscope({"pick", Dataset(3), "--isovalue", "128", "--pixel", "1,1", "--view",
                            "top", "--eye", "1,2,3"});
  EXPECT_EQ(twice.exit_code, 2);

  const testing::CommandResult outside = testing::RunIsoscope(
      {"pick", Dataset(3), "--isovalue", "128", "--width", "64", "--pixel", "64,0"});
  EXPECT_EQ(outside.exit_code, 2);
  EXPECT_THAT(outside.err, HasSubstr("a column from 0 to 63"));
}

}  // namespace
}  // namespace isoscope
