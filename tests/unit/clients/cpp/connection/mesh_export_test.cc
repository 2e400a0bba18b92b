#include "clients/cpp/connection/mesh_export.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>

#include "core/io/file.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::client {
namespace {

namespace v1 = isoscope::v1;
using isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Pair;

template <typename T>
std::string Bytes(const std::vector<T>& values) {
  return std::string(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
}

// A triangle for each surface of the request.
class Triangles final : public v1::IsosurfaceService::Service {
 public:
  grpc::Status ExportIsosurface(grpc::ServerContext*, const v1::ExportIsosurfaceRequest* request,
                                grpc::ServerWriter<v1::ExportIsosurfaceResponse>* writer) override {
    for (int i = 0; i < std::max(1, request->surfaces_size()) + extra_surfaces; ++i) {
      v1::ExportIsosurfaceResponse chunk;
      chunk.set_surface_index(i);
      chunk.set_positions(Bytes<float>({0, 0, 0, 1, 0, 0, 0, 1, 0}));
      chunk.set_normals(Bytes<float>({0, 0, 1, 0, 0, 1, 0, 0, 1}));
      chunk.set_triangles(Bytes<std::int64_t>({3 * i, 3 * i + 1, 3 * i + 2}));
      writer->Write(chunk);
    }
    return grpc::Status::OK;
  }

  int extra_surfaces = 0;
};

class MeshExportTest : public ::testing::Test {
 protected:
  void SetUp() override {
    grpc::ServerBuilder builder;
    builder.RegisterService(&triangles_);
    server_ = builder.BuildAndStart();
    client_ = std::make_unique<ServiceClient>(server_->InProcessChannel({}), "", nullptr, "");
  }

  Triangles triangles_;
  std::unique_ptr<grpc::Server> server_;
  std::unique_ptr<ServiceClient> client_;
  testing::TempDir folder_;
};

class Counter final : public MeshSink {
 public:
  absl::Status Add(const MeshPiece& piece) override {
    surfaces.push_back(piece.surface_index);
    return absl::OkStatus();
  }
  absl::Status Finish() override { return absl::InternalError("nobody calls this"); }

  std::vector<int> surfaces;
};

TEST_F(MeshExportTest, PiecesComeInOrderAndProgressSaysWhatThereWas) {
  v1::ExportIsosurfaceRequest request;
  request.add_surfaces()->set_isovalue(1);
  request.add_surfaces()->set_isovalue(2);
  Counter counter;
  std::vector<std::pair<std::int64_t, std::int64_t>> seen;
  ISOSCOPE_ASSERT_OK(ReceiveMesh(request, absl::Seconds(60), client_.get(), &counter,
                                 [&](std::int64_t vertices, std::int64_t triangles) {
                                   seen.emplace_back(vertices, triangles);
                                 }));
  EXPECT_THAT(counter.surfaces, ElementsAre(0, 1));
  EXPECT_THAT(seen, ElementsAre(Pair(0, 0), Pair(3, 1)));
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
