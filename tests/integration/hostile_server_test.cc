// A server whose every text would steer a terminal, and the program on a terminal in front of it.

#include <atomic>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <grpcpp/grpcpp.h>
#include <nlohmann/json.hpp>

#include "isoscope/v1/cluster_service.grpc.pb.h"
#include "isoscope/v1/dataset_service.grpc.pb.h"
#include "isoscope/v1/interact_service.grpc.pb.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "tests/support/process_cluster.h"
#include "tests/support/pseudo_terminal.h"
#include "wire/proto_convert.h"

namespace isoscope {
namespace {

namespace v1 = isoscope::v1;

using ::testing::HasSubstr;
using ::testing::Not;
using testing::PseudoTerminal;

// Sets the title, asks what the terminal is, clears the screen with a CSI of 8 bits, forges a line.
constexpr char kHostile[] = "hostile\x1b]0;title\x07\x1b[5n\u009b2J\x7f\nforged\rline";
// The same, made harmless.
constexpr char kHarmless[] = "hostile?]0;title??[5n?2J?";

v1::Dataset HostileDataset() {
  v1::Dataset dataset;
  dataset.set_name(kHostile);
  dataset.set_dataset_id(kHostile);
  dataset.set_samples_digest(kHostile);
  dataset.set_source(kHostile);
  volume::GridGeometry geometry;
  geometry.sample_dims = {8, 8, 8};
  *dataset.mutable_geometry() = wire::ToProto(geometry);
  dataset.set_sample_type(v1::SAMPLE_TYPE_UINT8);
  dataset.mutable_value_range()->set_max(255);
  dataset.mutable_block_cells()->set_x(7);
  dataset.mutable_block_cells()->set_y(7);
  dataset.mutable_block_cells()->set_z(7);
  dataset.set_block_count(1);
  dataset.set_shard_count(1);
  return dataset;
}

class Datasets final : public v1::DatasetService::Service {
 public:
  grpc::Status ListDatasets(grpc::ServerContext* /*context*/,
                            const v1::ListDatasetsRequest* /*request*/,
                            v1::ListDatasetsResponse* response) override {
    *response->add_datasets() = HostileDataset();
    return grpc::Status::OK;
  }
  grpc::Status GetDataset(grpc::ServerContext* /*context*/,
                          const v1::GetDatasetRequest* /*request*/,
                          v1::GetDatasetResponse* response) override {
    *response->mutable_dataset() = HostileDataset();
    return grpc::Status::OK;
  }
};

class Cluster final : public v1::ClusterService::Service {
 public:
  grpc::Status GetCapabilities(grpc::ServerContext* /*context*/,
                               const v1::GetCapabilitiesRequest* /*request*/,
                               v1::GetCapabilitiesResponse* response) override {
    response->set_version(kHostile);
    return grpc::Status::OK;
  }
  grpc::Status GetClusterStatus(grpc::ServerContext* /*context*/,
                                const v1::GetClusterStatusRequest* /*request*/,
                                v1::GetClusterStatusResponse* response) override {
    if (is_lost) {
      return {grpc::StatusCode::NOT_FOUND, kHostile};
    }
    for (int i = 0; i < 2; ++i) {  // a message that two have stands apart
      v1::AgentStatus& agent = *response->add_agents();
      agent.set_address(absl::StrCat(kHostile, i));
      agent.set_version(kHostile);
      agent.set_renderer(kHostile);
      agent.set_message(kHostile);
      agent.set_state(v1::AgentStatus::STATE_REACHABLE);
      agent.add_shards()->set_dataset(kHostile);
    }
    v1::FrameInWork& frame = *response->add_frames();
    frame.set_request_id(kHostile);
    frame.set_client(kHostile);
    frame.set_dataset(kHostile);
    return grpc::Status::OK;
  }

  std::atomic<bool> is_lost = false;
};

class Surfaces final : public v1::IsosurfaceService::Service {
 public:
  grpc::Status RenderIsosurface(grpc::ServerContext* /*context*/,
                                const v1::RenderIsosurfaceRequest* /*request*/,
                                v1::RenderIsosurfaceResponse* /*response*/) override {
    return {grpc::StatusCode::NOT_FOUND, kHostile};
  }
};

class Views final : public v1::InteractService::Service {
 public:
  grpc::Status Interact(
      grpc::ServerContext* /*context*/,
      grpc::ServerReaderWriter<v1::InteractResponse, v1::InteractRequest>* stream) override {
    v1::InteractRequest request;
    while (stream->Read(&request)) {
      if (request.has_view_state()) {
        v1::InteractResponse response;
        response.set_sequence_number(request.view_state().sequence_number());
        response.set_frame_number(request.view_state().sequence_number());
        response.mutable_error()->set_message(kHostile);
        stream->Write(response);
      }
    }
    return {grpc::StatusCode::NOT_FOUND, kHostile};
  }
};

class HostileServerTest : public ::testing::Test {
 protected:
  void SetUp() override {
    int port = 0;
    grpc::ServerBuilder builder;
    builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &port);
    builder.RegisterService(&datasets_);
    builder.RegisterService(&cluster_);
    builder.RegisterService(&surfaces_);
    builder.RegisterService(&views_);
    server_ = builder.BuildAndStart();
    ASSERT_NE(server_, nullptr);
    address_ = absl::StrCat("127.0.0.1:", port);
  }

  [[nodiscard]] std::vector<std::string> Command(const std::vector<std::string>& arguments) const {
    std::vector<std::string> command = {ISOSCOPE_TEST_PROGRAM, arguments[0], "--server", address_};
    command.insert(command.end(), arguments.begin() + 1, arguments.end());
    return command;
  }

  // Everything that the program writes to a terminal of `columns`.
  std::string Shown(const std::vector<std::string>& arguments, int exit_code, int columns) {
    PseudoTerminal terminal({.columns = columns, .rows = 40});
    terminal.Start(Command(arguments), kEnvironment);
    EXPECT_EQ(terminal.Wait(), exit_code) << terminal.bytes();
    return terminal.bytes();
  }

  static void ExpectHarmless(const std::string& shown) {
    for (const char* part : {"\x1b]0", "\x07", "\x1b[5n", "\u009b", "\x7f", "\rline"}) {
      EXPECT_THAT(shown, Not(HasSubstr(part)));
    }
  }

  const std::vector<std::string> kEnvironment = {"TERM=xterm-kitty", "PATH=/usr/bin:/bin"};
  Datasets datasets_;
  Cluster cluster_;
  Surfaces surfaces_;
  Views views_;
  std::unique_ptr<grpc::Server> server_;
  std::string address_;
};

TEST_F(HostileServerTest, AnErrorIsOneHarmlessLine) {
  const std::string shown = Shown({"render", "--isovalue", "1", "--width", "8", "--height", "8",
                                   "--show", "never", "--output", "/dev/null"},
                                  1, 200);
  EXPECT_THAT(shown, HasSubstr(absl::StrCat("isoscope: NOT_FOUND: ", kHarmless, "; forged line")));
  ExpectHarmless(shown);
}

TEST_F(HostileServerTest, InfoShowsNamesVersionsAndAgentsHarmlessly) {
  for (const int columns : {60, 400}) {
    const std::string shown = Shown({"info"}, 0, columns);
    EXPECT_THAT(shown, HasSubstr(absl::StrCat(", version ", kHarmless, " forged line")));
    EXPECT_THAT(shown, HasSubstr(absl::StrCat("dataset       ", kHarmless)));
    EXPECT_THAT(shown, HasSubstr(absl::StrCat("source        ", kHarmless)));
    ExpectHarmless(shown);
  }
}

TEST_F(HostileServerTest, JsonIsHarmlessAndHasTheTextAsItIs) {
  ExpectHarmless(Shown({"info", "--json"}, 0, 80));
  const testing::CommandResult result =
      testing::RunIsoscope({"info", "--server", address_, "--json"});
  const nlohmann::json json = nlohmann::json::parse(result.out, nullptr, false);
  ASSERT_FALSE(json.is_discarded()) << result.out;
  EXPECT_EQ(json.at("server").at("version"), kHostile);
  EXPECT_EQ(json.at("datasets").at(0).at("name"), kHostile);
}

TEST_F(HostileServerTest, TopShowsHarmlessTablesAndErrors) {
  const std::string shown = Shown({"top", "--once"}, 0, 400);
  EXPECT_THAT(shown, HasSubstr("hostile?]0;title"));
  ExpectHarmless(shown);
  PseudoTerminal terminal({.columns = 200, .rows = 40});
  terminal.Start(Command({"top", "--interval", "0.1"}), kEnvironment);
  ASSERT_TRUE(terminal.ReadUntilText("older than this program"));
  cluster_.is_lost = true;
  ASSERT_TRUE(terminal.ReadUntilText("isoscope top: hostile"));
  terminal.Press("q");
  EXPECT_EQ(terminal.Wait(), 0);
  ExpectHarmless(terminal.bytes());
}

TEST_F(HostileServerTest, TheViewerShowsNamesAndErrorsHarmlessly) {
  PseudoTerminal terminal({.columns = 160, .rows = 24, .width_px = 1280, .height_px = 384});
  terminal.Start(Command({"view", "--isovalue", "9", "--terminal"}), kEnvironment);
  ASSERT_TRUE(terminal.ReadUntilText("isovalue 9   hostile"));
  terminal.Press("q");
  EXPECT_EQ(terminal.Wait(), 0) << terminal.bytes();
  EXPECT_THAT(terminal.bytes(), HasSubstr(absl::StrCat(" ", kHarmless)));
  ExpectHarmless(terminal.bytes());
}

}  // namespace
}  // namespace isoscope
