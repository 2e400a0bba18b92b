#include "clients/cpp/connection/mesh_export.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include "core/io/file.h"
#include "core/math/vec.h"
#include "isoscope/v1/cluster_service.grpc.pb.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::client {
namespace {

namespace v1 = isoscope::v1;
using isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Pair;

template <typename T>
std::string Bytes(const std::vector<T>& values) {
  return std::string(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
}

class Features final : public v1::ClusterService::Service {
 public:
  grpc::Status GetCapabilities(grpc::ServerContext*, const v1::GetCapabilitiesRequest*,
                               v1::GetCapabilitiesResponse* response) override {
    for (const std::string& name : names) {
      response->add_features(name);
    }
    return grpc::Status::OK;
  }

  std::vector<std::string> names = {"labels", "closed_meshes"};
};

// A triangle for each surface of the request, and its measures if they are wanted.
class Triangles final : public v1::IsosurfaceService::Service {
 public:
  grpc::Status ExportIsosurface(grpc::ServerContext*, const v1::ExportIsosurfaceRequest* request,
                                grpc::ServerWriter<v1::ExportIsosurfaceResponse>* writer) override {
    requests.push_back(*request);
    for (int i = 0; i < std::max(1, request->surfaces_size()) + extra_surfaces; ++i) {
      v1::ExportIsosurfaceResponse chunk;
      chunk.set_surface_index(i);
      if (request->with_origin()) {
        chunk.mutable_origin()->set_x(500000);
      }
      if (!request->without_mesh()) {
        chunk.set_positions(Bytes<float>({0, 0, 0, 1, 0, 0, 0, 1, 0}));
        chunk.set_normals(Bytes<float>({0, 0, 1, 0, 0, 1, 0, 0, 1}));
        chunk.set_triangles(Bytes<std::int64_t>({3 * i, 3 * i + 1, 3 * i + 2}));
        writer->Write(chunk);
        chunk.clear_positions();
        chunk.clear_normals();
        chunk.clear_triangles();
      }
      if (request->with_measures() && !forgets_measures) {
        const double isovalue =
            request->surfaces().empty() ? request->isovalue() : request->surfaces(i).isovalue();
        chunk.mutable_measures()->set_area(isovalue);
        chunk.mutable_measures()->set_open_edge_count(isovalue == 7 ? 3 : 0);
        if (isovalue != 7) {
          chunk.mutable_measures()->set_volume(-isovalue);
        }
        chunk.mutable_measures()->set_triangle_count(1);
        writer->Write(chunk);
      }
    }
    return grpc::Status::OK;
  }

  int extra_surfaces = 0;
  bool forgets_measures = false;
  std::vector<v1::ExportIsosurfaceRequest> requests;
};

class MeshExportTest : public ::testing::Test {
 protected:
  void SetUp() override {
    grpc::ServerBuilder builder;
    builder.RegisterService(&features_);
    builder.RegisterService(&triangles_);
    server_ = builder.BuildAndStart();
    client_ = std::make_unique<ServiceClient>(server_->InProcessChannel({}), "", nullptr, "");
  }

  Features features_;
  Triangles triangles_;
  std::unique_ptr<grpc::Server> server_;
  std::unique_ptr<ServiceClient> client_;
  testing::TempDir folder_;
};

class Counter final : public MeshSink {
 public:
  absl::Status Add(const MeshPiece& piece) override {
    surfaces.push_back(piece.surface_index);
    first_vertices.push_back(piece.triangles.empty() ? 0 : piece.triangles[0]);
    origin = piece.origin;
    return absl::OkStatus();
  }
  absl::Status Finish() override { return absl::InternalError("nobody calls this"); }

  std::vector<int> surfaces;
  std::vector<std::uint32_t> first_vertices;
  std::optional<math::Vec3d> origin;
};

TEST_F(MeshExportTest, PiecesComeInOrderAndProgressSaysWhatThereWas) {
  v1::ExportIsosurfaceRequest request;
  request.add_surfaces()->set_isovalue(1);
  request.add_surfaces()->set_isovalue(2);
  Counter counter;
  std::vector<std::pair<std::int64_t, std::int64_t>> seen;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<SurfaceMeasures> measures,
                                ReceiveMesh(request, absl::Seconds(60), client_.get(), &counter,
                                            [&](std::int64_t vertices, std::int64_t triangles) {
                                              seen.emplace_back(vertices, triangles);
                                            }));
  EXPECT_THAT(measures, IsEmpty());
  EXPECT_FALSE(counter.origin.has_value());
  EXPECT_THAT(counter.surfaces, ElementsAre(0, 1));
  EXPECT_THAT(seen, ElementsAre(Pair(0, 0), Pair(3, 1)));
}

// A call has a few surfaces; the pieces of later calls continue those of earlier ones.
TEST_F(MeshExportTest, ManySurfacesComeInSeveralCallsAsOneMesh) {
  v1::ExportIsosurfaceRequest request;
  for (int i = 0; i < 5; ++i) {
    request.add_surfaces()->set_isovalue(5 + i);
  }
  request.set_with_measures(true);
  request.set_closes(true);
  Counter counter;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<SurfaceMeasures> measures,
                                ReceiveMesh(request, absl::Seconds(60), client_.get(), &counter,
                                            /*progress=*/nullptr, /*group_size=*/2));
  EXPECT_THAT(counter.surfaces, ElementsAre(0, 1, 2, 3, 4));
  EXPECT_THAT(counter.first_vertices, ElementsAre(0, 3, 6, 9, 12));
  ASSERT_EQ(triangles_.requests.size(), 3U);
  EXPECT_EQ(triangles_.requests[2].surfaces_size(), 1);
  EXPECT_EQ(triangles_.requests[2].surfaces(0).isovalue(), 9);
  EXPECT_TRUE(triangles_.requests[2].closes());
  ASSERT_EQ(measures.size(), 5U);
  EXPECT_EQ(measures[4].area, 9);
  EXPECT_EQ(measures[4].volume, -9);
  EXPECT_EQ(measures[2].volume, std::nullopt);
  EXPECT_EQ(measures[2].open_edge_count, 3);
  EXPECT_EQ(measures[2].triangle_count, 1);
  triangles_.forgets_measures = true;
  EXPECT_THAT(ReceiveMesh(request, absl::Seconds(60), client_.get(), &counter),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("no measures of surface 0")));
}

TEST_F(MeshExportTest, SurfacesAreMeasuredWithoutTheirMeshesUnlessTheServerIsOlder) {
  v1::ExportIsosurfaceRequest request;
  request.set_isovalue(5);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<SurfaceMeasures> measures,
                                MeasureSurfaces(request, absl::Seconds(60), client_.get()));
  EXPECT_THAT(measures, ElementsAre(SurfaceMeasures{
                            .area = 5, .volume = -5, .triangle_count = 1, .open_edge_count = 0}));
  EXPECT_TRUE(triangles_.requests.back().without_mesh());
  features_.names = {"labels"};
  EXPECT_THAT(MeasureSurfaces(request, absl::Seconds(60), client_.get()),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("older")));
}

// An older server refuses the field.
TEST_F(MeshExportTest, AnOriginIsAskedForWhereTheServerKnowsIt) {
  v1::ExportIsosurfaceRequest request;
  request.set_with_origin(true);
  Counter counter;
  ISOSCOPE_ASSERT_OK(ReceiveMesh(request, absl::Seconds(60), client_.get(), &counter).status());
  EXPECT_EQ(counter.origin, (math::Vec3d{500000, 0, 0}));
  ISOSCOPE_ASSERT_OK(
      WriteMeshFile({}, folder_.Sub("a.ply"), absl::Seconds(60), client_.get()).status());
  EXPECT_TRUE(triangles_.requests.back().with_origin());
  features_.names.clear();
  ISOSCOPE_ASSERT_OK(
      WriteMeshFile({}, folder_.Sub("b.ply"), absl::Seconds(60), client_.get()).status());
  EXPECT_FALSE(triangles_.requests.back().with_origin());
}

TEST_F(MeshExportTest, AMeshFileHasAllSurfaces) {
  v1::ExportIsosurfaceRequest request;
  request.set_isovalue(1);
  const std::string path = folder_.Sub("mesh.glb");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const MeshFileSummary one,
                                WriteMeshFile(request, path, absl::Seconds(60), client_.get()));
  EXPECT_EQ(one.vertex_count, 3);
  EXPECT_EQ(one.triangle_count, 1);
  EXPECT_EQ(one.size_bytes, static_cast<std::int64_t>(std::filesystem::file_size(path)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, io::ReadWholeFile(path, 1 << 20));
  EXPECT_EQ(bytes.substr(0, 4), "glTF");
  request.add_surfaces()->set_isovalue(1);
  request.add_surfaces()->set_isovalue(2);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const MeshFileSummary two,
                                WriteMeshFile(request, path, absl::Seconds(60), client_.get()));
  EXPECT_EQ(two.triangle_count, 2);
}

TEST(PinSelectionTest, TheRequestNamesTheStepThatItMeansNow) {
  v1::Dataset dataset;
  EXPECT_FALSE(PinSelection(dataset, std::make_unique<v1::ExportIsosurfaceRequest>().get()));
  dataset.set_time_unit("s");
  for (const int number : {0, 2}) {
    v1::TimeStep* const step = dataset.add_time_steps();
    step->set_number(number);
    step->set_value(number * 0.5);
  }
  v1::Field* const velocity = dataset.add_fields();
  velocity->set_name("velocity");
  velocity->set_unit("m/s");
  velocity->add_time_steps(0);
  velocity->add_time_steps(1);
  velocity->add_components()->set_name("x");
  velocity->add_components()->set_name("magnitude");
  v1::ExportIsosurfaceRequest request;
  const std::optional<MeshField> last = PinSelection(dataset, &request);
  ASSERT_TRUE(last.has_value());
  EXPECT_THAT(LinesOf(*last),
              ElementsAre("field velocity:magnitude", "unit m/s", "step 2", "time 1 s"));
  EXPECT_EQ(request.selection().ShortDebugString(),
            R"(field: "velocity" component: "magnitude" time_step: 2)");
  request.mutable_selection()->set_component("0");
  request.mutable_selection()->set_time(0.2);
  EXPECT_THAT(LinesOf(*PinSelection(dataset, &request)),
              ElementsAre("field velocity:x", "unit m/s", "step 0", "time 0 s"));
  request.mutable_selection()->set_field("heat");
  const std::string before = request.DebugString();
  EXPECT_FALSE(PinSelection(dataset, &request).has_value());
  EXPECT_EQ(request.DebugString(), before) << "the server says what there is";
  dataset.clear_time_steps();
  request.mutable_selection()->set_field("velocity");
  request.mutable_selection()->clear_when();
  EXPECT_THAT(LinesOf(*PinSelection(dataset, &request)),
              ElementsAre("field velocity:x", "unit m/s"));
}

TEST_F(MeshExportTest, AnErrorLeavesNoFile) {
  EXPECT_THAT(WriteMeshFile({}, folder_.Sub("mesh.xyz"), absl::Seconds(60), client_.get()),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("xyz")));
  triangles_.extra_surfaces = 1;
  const std::string path = folder_.Sub("mesh.glb");
  EXPECT_THAT(WriteMeshFile({}, path, absl::Seconds(60), client_.get()),
              StatusIs(absl::StatusCode::kDataLoss));
  EXPECT_FALSE(std::filesystem::exists(path));
}

}  // namespace
}  // namespace isoscope::client
