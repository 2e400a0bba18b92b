#include "clients/cpp/connection/render_frame.h"

#include <memory>
#include <string>

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

// Says which call it got.
class Frames final : public v1::IsosurfaceService::Service {
 public:
  grpc::Status RenderIsosurface(grpc::ServerContext*, const v1::RenderIsosurfaceRequest*,
                                v1::RenderIsosurfaceResponse* response) override {
    response->set_png("whole");
    return grpc::Status::OK;
  }
  grpc::Status RenderIsosurfaceStream(
      grpc::ServerContext*, const v1::RenderIsosurfaceStreamRequest*,
      grpc::ServerWriter<v1::RenderIsosurfaceStreamResponse>* writer) override {
    v1::RenderIsosurfaceStreamResponse message;
    message.mutable_part()->set_png("parts");
    writer->Write(message);
    return grpc::Status::OK;
  }
};

TEST(RenderFrameTest, LargePicturesAndPlanesComeInParts) {
  Frames frames;
  grpc::ServerBuilder builder;
  builder.RegisterService(&frames);
  const std::unique_ptr<grpc::Server> server = builder.BuildAndStart();
  ServiceClient client(server->InProcessChannel({}), "", nullptr, "");
  const auto way_of = [&](const v1::RenderIsosurfaceRequest& request) {
    const auto response = RenderFrame(request, absl::Seconds(60), &client);
    return response.ok() ? response->png() : response.status().ToString();
  };
  v1::RenderIsosurfaceRequest request;
  request.mutable_viewport()->set_width_px(4096);
  request.mutable_viewport()->set_height_px(4096);
  EXPECT_EQ(way_of(request), "parts") << "a picture of noise has 64 MiB";
  request.mutable_viewport()->set_width_px(2048);
  request.mutable_viewport()->set_height_px(2048);
  EXPECT_EQ(way_of(request), "whole");
  RequestPlanes({.depth = "d.npy", .normal = "n.npy"}, request.mutable_output());
  EXPECT_EQ(way_of(request), "whole") << "64 MiB";
  RequestPlanes({.depth = "d.npy", .surface_index = "s.npy", .normal = "n.npy"},
                request.mutable_output());
  EXPECT_EQ(way_of(request), "parts");
  RequestPlanes({.depth_bounds = "b.npy"}, request.mutable_output());
  EXPECT_EQ(way_of(request), "whole") << "32 MiB";
  RequestPlanes({.depth = "d.npy", .normal = "n.npy", .depth_bounds = "b.npy"},
                request.mutable_output());
  EXPECT_EQ(way_of(request), "parts");
  request.mutable_region()->set_width_px(100);
  request.mutable_region()->set_height_px(100);
  EXPECT_EQ(way_of(request), "whole");
}

TEST(RenderFrameTest, PlanesAreWrittenWithTheirShape) {
  const testing::TempDir folder;
  v1::RenderIsosurfaceResponse response;
  response.mutable_extent()->set_width_px(2);
  response.mutable_extent()->set_height_px(3);
  response.set_surface_index("abcdef");
  ISOSCOPE_ASSERT_OK(WritePlanes({.surface_index = folder.Sub("s.npy")}, response));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string file,
                                io::ReadWholeFile(folder.Sub("s.npy"), 1000));
  EXPECT_NE(file.find("(3, 2)"), std::string::npos);
  EXPECT_EQ(file.substr(file.size() - 6), "abcdef");
  EXPECT_FALSE(WritePlanes({.depth = folder.Sub("d.npy")}, response).ok())
      << "a server that does not know planes";
  response.set_depth_bounds(std::string(std::size_t{2} * 3 * 2 * 4, 'b'));
  ISOSCOPE_ASSERT_OK(WritePlanes({.depth_bounds = folder.Sub("b.npy")}, response));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bounds,
                                io::ReadWholeFile(folder.Sub("b.npy"), 1000));
  EXPECT_NE(bounds.find("(3, 2, 2)"), std::string::npos);
}

}  // namespace
}  // namespace isoscope::client
