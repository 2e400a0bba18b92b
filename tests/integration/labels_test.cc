// Surfaces of labels, from real processes: two labels that meet show no gap, pixels and picks tell
// the right one, meshes are closed, and all are the same for any number of agents.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <grpcpp/client_context.h>

#include "core/base/coding.h"
#include "core/base/monotonic_time.h"
#include "core/base/random.h"
#include "core/math/vec.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope {
namespace {

namespace v1 = isoscope::v1;
using ::testing::HasSubstr;
using testing::ProcessCluster;
using testing::StatusIs;

constexpr int kShardCounts[] = {1, 3};
constexpr int kSidePx = 120;
constexpr std::uint8_t kNoSurface = 255;
// Two boxes that meet between the samples 15 and 16 of x.
constexpr math::Index3 kDims = {32, 28, 26};
constexpr std::int64_t kFirstRight = 16;
constexpr double kLeft = 3;
constexpr double kRight = 7;

testing::TestVolume VolumeOf(std::uint8_t (*sample_at)(const math::Index3& at)) {
  testing::TestVolume volume;
  volume.geometry.sample_dims = kDims;
  for (std::int64_t z = 0; z < kDims.z; ++z) {
    for (std::int64_t y = 0; y < kDims.y; ++y) {
      for (std::int64_t x = 0; x < kDims.x; ++x) {
        volume.samples.push_back(static_cast<char>(sample_at({x, y, z})));
      }
    }
  }
  return volume;
}

// Whether a sample lies this far inside of the volume.
bool IsInner(const math::Index3& at, std::int64_t margin) {
  bool is_inner = true;
  for (int axis = 0; axis < 3; ++axis) {
    is_inner = is_inner && at[axis] >= margin && at[axis] < kDims[axis] - margin;
  }
  return is_inner;
}

std::uint8_t TwoBoxes(const math::Index3& at) {
  return static_cast<std::uint8_t>(!IsInner(at, 5) ? 0 : at.x < kFirstRight ? kLeft : kRight);
}

// Labels 1 to 4 and none, sample by sample: cells of every case.
std::uint8_t Grains(const math::Index3& at) {
  const auto index = static_cast<std::uint64_t>(at.x + kDims.x * (at.y + kDims.y * at.z));
  return static_cast<std::uint8_t>(IsInner(at, 1) ? base::RandomBits(5, index / 2) % 5 : 0);
}

v1::Surface LabelSurface(const std::vector<double>& labels, float red) {
  v1::Surface surface;
  surface.mutable_labels()->Assign(labels.begin(), labels.end());
  surface.mutable_color()->set_red(red);
  surface.mutable_color()->set_blue(1 - red);
  surface.mutable_color()->set_alpha(1);
  return surface;
}

struct Mesh {
  std::vector<math::Vec3f> positions;
  std::vector<std::vector<std::int64_t>> triangles;  // by surface
};

using Corner = std::tuple<float, float, float>;

class LabelsTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    shared_ = new testing::TempDir();
    for (const int shard_count : kShardCounts) {
      ISOSCOPE_ASSERT_OK(
          testing::MakeDataset(VolumeOf(TwoBoxes), Dataset("boxes", shard_count), shard_count, 6));
      ISOSCOPE_ASSERT_OK(
          testing::MakeDataset(VolumeOf(Grains), Dataset("grains", shard_count), shard_count, 6));
    }
  }
  static void TearDownTestSuite() {
    delete shared_;
    shared_ = nullptr;
  }
  static std::string Dataset(const std::string& name, int shard_count) {
    return shared_->Sub(name + std::to_string(shard_count));
  }

  void StartCluster(const std::string& name, int shard_count) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(cluster_,
                                  ProcessCluster::Start(Dataset(name, shard_count), shard_count));
    stub_ = v1::IsosurfaceService::NewStub(rpc::MakeFreshChannel(cluster_->address()));
  }

  // The left box red, the right one blue, seen along -z.
  static v1::RenderIsosurfaceRequest Request() {
    v1::RenderIsosurfaceRequest request;
    *request.add_surfaces() = LabelSurface({kLeft}, 1);
    *request.add_surfaces() = LabelSurface({kRight}, 0);
    request.mutable_viewport()->set_width_px(kSidePx);
    request.mutable_viewport()->set_height_px(kSidePx);
    v1::Camera* const camera = request.mutable_camera();
    camera->mutable_eye()->set_x(15.5);
    camera->mutable_eye()->set_y(13.5);
    camera->mutable_eye()->set_z(80);
    camera->mutable_target()->set_x(15.5);
    camera->mutable_target()->set_y(13.5);
    camera->mutable_target()->set_z(13);
    camera->mutable_orthographic()->set_height(30);
    request.mutable_output()->set_surface_index(true);
    request.mutable_output()->set_position(true);
    return request;
  }

  template <typename Request, typename Response>
  using Method = grpc::Status (v1::IsosurfaceService::Stub::*)(grpc::ClientContext*, const Request&,
                                                               Response*);
  template <typename Request, typename Response>
  absl::StatusOr<Response> Call(Method<Request, Response> method, const Request& request) {
    grpc::ClientContext context;
    context.set_deadline(base::MonotonicNow() + testing::kPatience);
    Response response;
    const absl::Status status =
        rpc::ToAbslStatus((stub_.get()->*method)(&context, request, &response));
    return status.ok() ? absl::StatusOr<Response>(response) : status;
  }
  absl::StatusOr<v1::RenderIsosurfaceResponse> Render(const v1::RenderIsosurfaceRequest& request) {
    return Call<v1::RenderIsosurfaceRequest, v1::RenderIsosurfaceResponse>(
        &v1::IsosurfaceService::Stub::RenderIsosurface, request);
  }
  absl::StatusOr<v1::PickSurfaceResponse> Pick(const v1::PickSurfaceRequest& request) {
    return Call<v1::PickSurfaceRequest, v1::PickSurfaceResponse>(
        &v1::IsosurfaceService::Stub::PickSurface, request);
  }

  absl::StatusOr<Mesh> Export(const v1::ExportIsosurfaceRequest& request) {
    grpc::ClientContext context;
    context.set_deadline(base::MonotonicNow() + testing::kPatience);
    const auto reader = stub_->ExportIsosurface(&context, request);
    v1::ExportIsosurfaceResponse message;
    Mesh mesh;
    mesh.triangles.resize(static_cast<std::size_t>(request.surfaces_size()));
    while (reader->Read(&message)) {
      const auto* const floats = message.positions().data();
      for (std::size_t i = 0; i < message.positions().size() / 12; ++i) {
        const auto at = [&](std::size_t k) {
          return base::LoadLittleEndian<float>(floats + 12 * i + 4 * k);
        };
        mesh.positions.push_back({at(0), at(1), at(2)});
      }
      for (std::size_t i = 0; i < message.triangles().size() / 8; ++i) {
        mesh.triangles[static_cast<std::size_t>(message.surface_index())].push_back(
            base::LoadLittleEndian<std::int64_t>(message.triangles().data() + 8 * i));
      }
    }
    const absl::Status status = rpc::ToAbslStatus(reader->Finish());
    return status.ok() ? absl::StatusOr<Mesh>(mesh) : status;
  }

  static testing::TempDir* shared_;
  std::unique_ptr<ProcessCluster> cluster_;
  std::unique_ptr<v1::IsosurfaceService::Stub> stub_;
};

testing::TempDir* LabelsTest::shared_ = nullptr;

Corner CornerOf(const Mesh& mesh, std::int64_t vertex) {
  const math::Vec3f& p = mesh.positions[static_cast<std::size_t>(vertex)];
  return {p.x, p.y, p.z};
}

// A triangle that starts at its least corner.
std::array<Corner, 3> TriangleAt(const Mesh& mesh, const std::vector<std::int64_t>& triangles,
                                 std::size_t first, bool is_reversed) {
  std::array<Corner, 3> corners;
  for (std::size_t i = 0; i < 3; ++i) {
    corners[i] = CornerOf(mesh, triangles[first + (is_reversed ? 2 - i : i)]);
  }
  std::rotate(corners.begin(), std::min_element(corners.begin(), corners.end()), corners.end());
  return corners;
}

// The edges that do not have as many triangles on one side as on the other, and the vertices that
// have the position of another one.
std::size_t FlawCount(const Mesh& mesh, const std::vector<std::int64_t>& triangles) {
  std::map<std::pair<std::int64_t, std::int64_t>, int> edges;
  std::map<Corner, std::int64_t> vertex_at;
  std::size_t flaws = 0;
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    const std::int64_t a = triangles[i];
    const std::int64_t b = triangles[i % 3 == 2 ? i - 2 : i + 1];
    edges[std::minmax(a, b)] += a < b ? 1 : -1;
    flaws += vertex_at.emplace(CornerOf(mesh, a), a).first->second != a ? 1U : 0U;
  }
  for (const auto& [edge, balance] : edges) {
    flaws += balance != 0 ? 1U : 0U;
  }
  return flaws;
}

TEST_F(LabelsTest, NoBackgroundShowsBetweenTwoLabelsThatMeet) {
  std::string first_picture;
  std::string first_plane;
  for (const int shard_count : kShardCounts) {
    SCOPED_TRACE(shard_count);
    ASSERT_NO_FATAL_FAILURE(StartCluster("boxes", shard_count));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response, Render(Request()));
    const std::string& surfaces = response.surface_index();
    ASSERT_EQ(surfaces.size(), std::size_t{kSidePx} * kSidePx);
    int covered = 0;
    for (std::size_t i = 0; i < surfaces.size(); ++i) {
      // Pixel centres in world space. The boxes reach half a sample beyond their samples.
      const double scale = 30.0 / kSidePx;
      const double x = 15.5 + (static_cast<double>(i % kSidePx) + 0.5 - kSidePx / 2.0) * scale;
      const double y = 13.5 - (static_cast<double>(i / kSidePx) + 0.5 - kSidePx / 2.0) * scale;
      const double beyond = std::max(std::abs(x - 15.5) - 11, std::abs(y - 13.5) - 9);
      if (std::abs(beyond) < 0.6 || std::abs(x - 15.5) < 0.1) {
        continue;  // edges and corners are cut off
      }
      const int expected = beyond > 0 ? kNoSurface : x < 15.5 ? 0 : 1;
      ASSERT_EQ(static_cast<std::uint8_t>(surfaces[i]), expected) << x << ", " << y;
      covered += beyond > 0 ? 0 : 1;
    }
    EXPECT_GT(covered, 5000);
    // Along a row the boxes have no gap, wherever they begin and end. At their upper and lower edge
    // three labels meet in a cell, so that a notch stays (docs/numerics.md, "Labels").
    for (std::size_t row = 0; row < kSidePx; ++row) {
      const double y = (static_cast<double>(row) + 0.5 - kSidePx / 2.0) * 30.0 / kSidePx;
      if (std::abs(std::abs(y) - 9) < 0.6) {
        continue;
      }
      const std::string line = surfaces.substr(row * kSidePx, kSidePx);
      const std::size_t begin = line.find_first_not_of(static_cast<char>(kNoSurface));
      const std::size_t end = line.find_last_not_of(static_cast<char>(kNoSurface));
      for (std::size_t i = begin; begin != std::string::npos && i < end; ++i) {
        ASSERT_NE(static_cast<std::uint8_t>(line[i]), kNoSurface) << row << ", " << i;
        ASSERT_LE(static_cast<std::uint8_t>(line[i]), static_cast<std::uint8_t>(line[i + 1]))
            << "the left box is left of the right one";
      }
    }
    if (first_picture.empty()) {
      first_picture = response.png();
      first_plane = response.position();
    }
    EXPECT_EQ(response.png(), first_picture);
    EXPECT_EQ(response.position(), first_plane);
  }
}

TEST_F(LabelsTest, PicksTellTheLabel) {
  for (const int shard_count : kShardCounts) {
    SCOPED_TRACE(shard_count);
    ASSERT_NO_FATAL_FAILURE(StartCluster("boxes", shard_count));
    v1::PickSurfaceRequest request;
    *request.mutable_frame() = Request();
    request.mutable_frame()->clear_output();
    request.mutable_frame()->clear_surfaces();
    *request.mutable_frame()->add_surfaces() = LabelSurface({kRight, kLeft, 99}, 1);
    for (const int x : {40, 55, 65, 80, 2}) {
      v1::Pixel* const pixel = request.add_pixels();
      pixel->set_x(x);
      pixel->set_y(50);
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::PickSurfaceResponse picks, Pick(request));
    ASSERT_EQ(picks.points_size(), 5);
    for (int i = 0; i < 4; ++i) {
      EXPECT_TRUE(picks.points(i).has_label());
      EXPECT_EQ(picks.points(i).label(), i < 2 ? kLeft : kRight) << i;
      EXPECT_EQ(picks.points(i).label_name(), "") << "the dataset has no names";
      EXPECT_FALSE(picks.points(i).has_gradient());
      EXPECT_NEAR(picks.points(i).normal().z(), 1, 1e-3) << "it points out of the box";
    }
    EXPECT_FALSE(picks.points(4).is_hit());
    EXPECT_FALSE(picks.points(4).has_label());

    // The cut through both boxes, filled.
    v1::HalfSpace* const half_space = request.mutable_frame()->mutable_clip()->add_half_spaces();
    half_space->mutable_normal()->set_z(-1);
    half_space->set_offset(-13.25);
    request.mutable_frame()->mutable_caps();
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::PickSurfaceResponse on_caps, Pick(request));
    for (int i = 0; i < 4; ++i) {
      EXPECT_NEAR(on_caps.points(i).position().z(), 13.25, 1e-3);
      EXPECT_EQ(on_caps.points(i).label(), i < 2 ? kLeft : kRight) << i;
    }

    // An isovalue has no label.
    request.mutable_frame()->mutable_surfaces(0)->clear_labels();
    request.mutable_frame()->mutable_surfaces(0)->set_isovalue(2);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::PickSurfaceResponse without, Pick(request));
    EXPECT_TRUE(without.points(0).is_hit());
    EXPECT_FALSE(without.points(0).has_label());
  }
}

TEST_F(LabelsTest, MeshesAreClosedAndNeighboursShareTheirTriangles) {
  for (const std::string name : {"boxes", "grains"}) {
    v1::ExportIsosurfaceRequest request;
    const bool is_boxes = name == "boxes";
    for (const double label :
         is_boxes ? std::vector<double>{kLeft, kRight} : std::vector<double>{1, 2, 3, 4}) {
      request.add_surfaces()->add_labels(label);
    }
    *request.add_surfaces() = LabelSurface(
        is_boxes ? std::vector<double>{kLeft, kRight} : std::vector<double>{1, 2, 3, 4}, 1);
    std::size_t first_count = 0;
    for (const int shard_count : kShardCounts) {
      SCOPED_TRACE(name + std::to_string(shard_count));
      ASSERT_NO_FATAL_FAILURE(StartCluster(name, shard_count));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Mesh mesh, Export(request));
      for (const std::vector<std::int64_t>& triangles : mesh.triangles) {
        EXPECT_GT(triangles.size(), 1000U);
        EXPECT_EQ(FlawCount(mesh, triangles), 0U);
      }
      first_count = first_count == 0 ? mesh.positions.size() : first_count;
      EXPECT_EQ(mesh.positions.size(), first_count);
      if (!is_boxes) {
        continue;
      }
      std::set<std::array<Corner, 3>> left_triangles;
      for (std::size_t i = 0; i < mesh.triangles[0].size(); i += 3) {
        left_triangles.insert(TriangleAt(mesh, mesh.triangles[0], i, /*is_reversed=*/false));
      }
      std::size_t shared = 0;
      for (std::size_t i = 0; i < mesh.triangles[1].size(); i += 3) {
        shared +=
            left_triangles.count(TriangleAt(mesh, mesh.triangles[1], i, /*is_reversed=*/true));
      }
      EXPECT_GE(shared, 2U * 16 * 14) << "two triangles in each cell where only the boxes meet";
      EXPECT_LT(shared, 2U * 20 * 18);
    }
  }
}

TEST_F(LabelsTest, CutsAndSurfacesAmongIsovaluesAreThoseOfAnyNumberOfAgents) {
  std::string first;
  for (const int shard_count : kShardCounts) {
    ASSERT_NO_FATAL_FAILURE(StartCluster("grains", shard_count));
    v1::RenderIsosurfaceRequest request = Request();
    request.clear_surfaces();
    *request.add_surfaces() = LabelSurface({1}, 1);
    *request.add_surfaces() = LabelSurface({2, 4}, 0.5F);
    request.mutable_surfaces(1)->mutable_color()->set_alpha(0.5F);
    request.add_surfaces()->set_isovalue(3.5);
    v1::HalfSpace* const half_space = request.mutable_clip()->add_half_spaces();
    half_space->mutable_normal()->set_x(-1);
    half_space->mutable_normal()->set_z(-2);
    half_space->set_offset(-40.3);
    request.mutable_caps();
    request.set_camera_fit(v1::CAMERA_FIT_SURFACE);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse response, Render(request));
    const std::set<char> shown(response.surface_index().begin(), response.surface_index().end());
    EXPECT_EQ(shown.size(), 4U) << "three surfaces and the background";
    if (first.empty()) {
      first = response.png();
    }
    EXPECT_EQ(response.png(), first);
  }
}

TEST_F(LabelsTest, SmoothPicturesAndMeshesAreThoseOfAnyNumberOfAgents) {
  std::string first;
  std::string first_cut;
  std::vector<math::Vec3f> first_positions;
  for (const int shard_count : kShardCounts) {
    SCOPED_TRACE(shard_count);
    ASSERT_NO_FATAL_FAILURE(StartCluster("grains", shard_count));
    v1::RenderIsosurfaceRequest request = Request();
    request.clear_surfaces();
    v1::ExportIsosurfaceRequest mesh_request;
    for (const double label : {1.0, 2.0, 3.0, 4.0}) {
      *request.add_surfaces() = LabelSurface({label}, static_cast<float>(label) / 4);
      *mesh_request.add_surfaces() = LabelSurface({label}, 1);
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse rough, Render(request));
    for (int i = 0; i < 4; ++i) {
      request.mutable_surfaces(i)->set_smooth_labels(true);
      mesh_request.mutable_surfaces(i)->set_smooth_labels(true);
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse smooth, Render(request));
    EXPECT_NE(smooth.png(), rough.png());
    request.set_culling(v1::CULLING_NONE);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse all, Render(request));
    EXPECT_EQ(all.png(), smooth.png());
    v1::HalfSpace* const half_space = request.mutable_clip()->add_half_spaces();
    half_space->mutable_normal()->set_x(-1);
    half_space->mutable_normal()->set_z(-2);
    half_space->set_offset(-40.3);
    request.mutable_caps();
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const v1::RenderIsosurfaceResponse cut, Render(request));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Mesh mesh, Export(mesh_request));
    for (const std::vector<std::int64_t>& triangles : mesh.triangles) {
      EXPECT_GT(triangles.size(), 1000U);
      EXPECT_EQ(FlawCount(mesh, triangles), 0U);
    }
    if (first.empty()) {
      first = smooth.png();
      first_cut = cut.png();
      first_positions = mesh.positions;
    }
    EXPECT_EQ(smooth.png(), first);
    EXPECT_EQ(cut.png(), first_cut);
    EXPECT_EQ(mesh.positions, first_positions);
  }
}

TEST_F(LabelsTest, WrongRequestsAreNamed) {
  ASSERT_NO_FATAL_FAILURE(StartCluster("boxes", 1));
  v1::ExportIsosurfaceRequest mesh;
  *mesh.add_surfaces() = LabelSurface({kLeft}, 1);
  mesh.mutable_surfaces(0)->set_smooth_labels(true);
  mesh.mutable_clip()->add_half_spaces()->mutable_normal()->set_x(1);
  EXPECT_THAT(Export(mesh), StatusIs(absl::StatusCode::kInvalidArgument,
                                     HasSubstr("surfaces[0].smooth_labels is set beside clip")));
  v1::RenderIsosurfaceRequest request = Request();
  request.mutable_surfaces(1)->set_isovalue(5);
  EXPECT_THAT(Render(request), StatusIs(absl::StatusCode::kInvalidArgument,
                                        HasSubstr("surfaces[1].isovalue is 5 beside")));
  request = Request();
  request.mutable_surfaces(0)->mutable_color_by()->set_quantity(
      v1::ColorBy::QUANTITY_GRADIENT_MAGNITUDE);
  EXPECT_THAT(Render(request), StatusIs(absl::StatusCode::kInvalidArgument,
                                        HasSubstr("surfaces[0].color_by.quantity is 5")));
}

}  // namespace
}  // namespace isoscope
