// The interface for operators of a coordinator: requests that name their expected contents,
// features, pages, reasons of errors, readiness, draining agents, and the audit log.

#include <atomic>
#include <fstream>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <grpcpp/health_check_service_interface.h>

#include "core/base/error_reason.h"
#include "core/base/monotonic_time.h"
#include "core/io/file.h"
#include "isoscope/v1/cluster_service.grpc.pb.h"
#include "isoscope/v1/dataset_service.grpc.pb.h"
#include "isoscope/v1/interact_service.grpc.pb.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "rpc/grpc_status.h"
#include "rpc/health_probe.h"
#include "rpc/peer.h"
#include "server/access/access_tokens.h"
#include "server/coordinator_server.h"
#include "tests/support/metric_values.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/server/fake_cluster.h"

namespace isoscope::server {
namespace {

namespace v1 = isoscope::v1;
namespace internal = isoscope::internal::v1;

using ::testing::AllOf;
using ::testing::ElementsAre;
using testing::FakeAgent;
using ::testing::HasSubstr;
using testing::IsOk;
using testing::kSomeId;
using testing::MakeShard;
using testing::PlayEmptyFrame;
using testing::StatusIs;

constexpr char kOtherId[] = "fedcba9876543210fedcba9876543210";
constexpr absl::Duration kLong = absl::Seconds(60);

v1::RenderIsosurfaceRequest FrameRequest(const std::string& dataset_id) {
  v1::RenderIsosurfaceRequest request = testing::FrameRequest();
  request.set_dataset_id(dataset_id);
  return request;
}

class CoordinatorOperationsTest : public testing::FakeClusterTest {
 protected:
  CoordinatorOperationsTest() { options_.poll_interval = absl::Milliseconds(20); }

  absl::Status Render(const v1::RenderIsosurfaceRequest& request) {
    return FakeClusterTest::Render(request, kLong).status();
  }
  absl::Status Pick(const v1::RenderIsosurfaceRequest& frame) {
    v1::PickSurfaceRequest request;
    *request.mutable_frame() = frame;
    request.add_pixels();
    return Call(frames_, &v1::IsosurfaceService::Stub::PickSurface, request).status();
  }
  // The error or the exact frame of one view.
  v1::InteractResponse Interact(const v1::RenderIsosurfaceRequest& frame) {
    grpc::ClientContext context;
    const auto stub = v1::InteractService::NewStub(channel_);
    const auto stream = stub->Interact(&context);
    v1::InteractRequest request;
    request.mutable_view_state()->set_sequence_number(1);
    request.mutable_view_state()->set_is_at_rest(true);
    *request.mutable_view_state()->mutable_frame() = frame;
    stream->Write(request);
    v1::InteractResponse response;
    while (stream->Read(&response) && !response.has_error() && !response.is_exact()) {
    }
    stream->WritesDone();
    stream->Finish();
    return response;
  }
  absl::Status Export(const std::string& dataset_id) {
    v1::ExportIsosurfaceRequest request = testing::ExportRequest();
    request.set_dataset_id(dataset_id);
    return testing::Export(frames_.get(), "", request).Finish();
  }
  absl::Status Histogram(const std::string& dataset_id) {
    v1::GetHistogramRequest request;
    request.set_dataset("head");
    request.set_dataset_id(dataset_id);
    return Call(datasets_, &v1::DatasetService::Stub::GetHistogram, request).status();
  }
  absl::StatusOr<v1::GetClusterStatusResponse> Status(int page_size = 0,
                                                      const std::string& token = "") {
    v1::GetClusterStatusRequest request;
    request.set_page_size(page_size);
    request.set_page_token(token);
    return FakeClusterTest::Status("", request);
  }
};

std::vector<std::string> NamesOf(const v1::ListDatasetsResponse& response) {
  std::vector<std::string> names;
  for (const v1::Dataset& dataset : response.datasets()) {
    names.push_back(dataset.name());
  }
  return names;
}

TEST_F(CoordinatorOperationsTest, ARequestForOtherContentsIsRefusedNamingBothIds) {
  AddAgent({MakeShard("head", 0, 1)});
  const Running running = Start();
  const auto is_refused = StatusIs(absl::StatusCode::kFailedPrecondition,
                                   AllOf(HasSubstr(kSomeId), HasSubstr(kOtherId)));
  const absl::Status refused = Render(FrameRequest(kOtherId));
  EXPECT_THAT(refused, is_refused);
  EXPECT_EQ(base::ReasonOf(refused), base::ErrorReason::kDatasetIdDiffers);
  EXPECT_THAT(Pick(FrameRequest(kOtherId)), is_refused);
  EXPECT_THAT(Export(kOtherId), is_refused);
  EXPECT_THAT(Histogram(kOtherId), is_refused);
  const v1::InteractResponse answer = Interact(FrameRequest(kOtherId));
  EXPECT_EQ(answer.error().code(), static_cast<int>(absl::StatusCode::kFailedPrecondition));
  EXPECT_THAT(answer.error().message(), AllOf(HasSubstr(kSomeId), HasSubstr(kOtherId)));
}

// A finding of docs/lab/robustness.md: only an agent with other contents under the name is reached.
TEST_F(CoordinatorOperationsTest, APartOfOtherContentsIsNoPartOfThoseExpected) {
  AddAgent({MakeShard("head", 0, 2, kOtherId)});
  const Running running = Start(/*waits=*/false);
  v1::RenderIsosurfaceRequest request = FrameRequest("");
  request.set_allow_partial(true);
  request.set_dataset_id(kSomeId);
  EXPECT_THAT(Render(request),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr(kOtherId)));
}

TEST_F(CoordinatorOperationsTest, ADatasetOfTheRightIdIsDrawn) {
  bool was_drawn = false;
  AddAgent({MakeShard("head", 0, 1)})->on_frame = [&](grpc::ServerContext*,
                                                      FakeAgent::FrameStream* stream) {
    internal::RenderFrameRequest request;
    stream->Read(&request);
    was_drawn = request.has_begin();
    internal::RenderFrameResponse response;
    response.mutable_frame_done();
    stream->Write(response);
    return grpc::Status::OK;
  };
  const Running running = Start();
  v1::RenderIsosurfaceRequest request = FrameRequest(kSomeId);
  request.set_culling(v1::CULLING_NONE);
  EXPECT_THAT(Render(request), IsOk());
  EXPECT_TRUE(was_drawn);
}

TEST_F(CoordinatorOperationsTest, TheFeaturesAreExactlyTheseInOrder) {
  AddAgent({MakeShard("head", 0, 1)});
  const Running running = Start();
  grpc::ClientContext context;
  v1::GetCapabilitiesResponse capabilities;
  ASSERT_TRUE(cluster_->GetCapabilities(&context, {}, &capabilities).ok());
  EXPECT_THAT(capabilities.features(),
              ElementsAre("bands", "closed_meshes", "color_ranges", "dataset_id", "depth_bounds",
                          "draining_agents", "error_info", "fit_cells", "label_values", "labels",
                          "levels", "nan_color", "notes", "pages", "refinement", "smooth_labels",
                          "unresolved_count"));
}

TEST_F(CoordinatorOperationsTest, PagesHaveEachDatasetOnceAndZeroIsAll) {
  AddAgent({MakeShard("a", 0, 1), MakeShard("b", 0, 1, kOtherId), MakeShard("c", 0, 1)});
  const Running running = Start();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto all, List(0, ""));
  EXPECT_THAT(NamesOf(all), ElementsAre("a", "b", "c"));
  EXPECT_EQ(all.next_page_token(), "");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto first, List(2, ""));
  EXPECT_THAT(NamesOf(first), ElementsAre("a", "b"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto second, List(2, first.next_page_token()));
  EXPECT_THAT(NamesOf(second), ElementsAre("c"));
  EXPECT_EQ(second.next_page_token(), "");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto exact, List(3, ""));
  EXPECT_EQ(exact.next_page_token(), "");
}

TEST_F(CoordinatorOperationsTest, DatasetsThatGoBetweenPagesShiftNothing) {
  AddAgent({MakeShard("a", 0, 1)});
  FakeAgent* const other = AddAgent({MakeShard("b", 0, 1, kOtherId), MakeShard("d", 0, 1)});
  AddAgent({MakeShard("c", 0, 1)});
  const Running running = Start();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto first, List(2, ""));
  EXPECT_THAT(NamesOf(first), ElementsAre("a", "b"));
  other->Stop();
  const base::MonotonicTime limit = base::MonotonicNow() + kLong;
  while (base::MonotonicNow() < limit) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto all, List(0, ""));
    if (all.datasets_size() == 2) {
      break;
    }
    absl::SleepFor(absl::Milliseconds(5));
  }
  // "b", at which the page ended, is gone.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto second, List(2, first.next_page_token()));
  EXPECT_THAT(NamesOf(second), ElementsAre("c"));
  EXPECT_EQ(second.next_page_token(), "");
}

TEST_F(CoordinatorOperationsTest, PagesOfARestrictedCallerHaveNeitherHoleNorHiddenName) {
  const testing::TempDir folder;
  options_.token_file = folder.Sub("tokens.json");
  options_.audit_log = folder.Sub("audit.log");
  std::ofstream(options_.token_file)
      << R"({"tokens": [{"name": "ward", "sha256": ")"
      << absl::BytesToHexString(DigestOfToken("secret")) << R"(", "datasets": ["a", "c"]}]})";
  AddAgent({MakeShard("a", 0, 1), MakeShard("b", 0, 1, kOtherId), MakeShard("c", 0, 1)});
  const Running running = Start();
  std::vector<std::string> names;
  std::string token;
  do {
    grpc::ClientContext context;
    rpc::SendToken("secret", &context);
    v1::ListDatasetsRequest request;
    request.set_page_size(1);
    request.set_page_token(token);
    v1::ListDatasetsResponse response;
    ISOSCOPE_ASSERT_OK(rpc::ToAbslStatus(datasets_->ListDatasets(&context, request, &response)));
    ASSERT_EQ(response.datasets_size(), 1);
    names.push_back(response.datasets(0).name());
    token = response.next_page_token();
  } while (!token.empty());
  EXPECT_THAT(names, ElementsAre("a", "c"));
  // Who shows nothing is refused, and leaves a line all the same.
  EXPECT_THAT(List(0, ""), StatusIs(absl::StatusCode::kUnauthenticated));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string text,
                                io::ReadWholeFile(options_.audit_log, 1 << 20));
  EXPECT_THAT(text, HasSubstr("\"caller\":\"ward\""));
  EXPECT_THAT(text, HasSubstr("\"code\":\"UNAUTHENTICATED\""));
}

TEST_F(CoordinatorOperationsTest, AgentsHavePagesAndWrongTokensAreNamed) {
  for (int i = 0; i < 3; ++i) {
    AddAgent({MakeShard("head", i, 3)});
  }
  const Running running = Start();
  std::set<std::string> seen;
  std::string token;
  for (int page = 0; page < 3; ++page) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto status, Status(1, token));
    ASSERT_EQ(status.agents_size(), 1);
    EXPECT_TRUE(status.has_load());
    seen.insert(status.agents(0).address());
    token = status.next_page_token();
    EXPECT_EQ(token.empty(), page == 2);
  }
  EXPECT_EQ(seen.size(), 3u);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto first, Status(1));
  // A token of one list is none of another.
  for (const std::string& wrong : {std::string("x"), std::string("!"), first.next_page_token()}) {
    const absl::Status refused = List(1, wrong).status();
    EXPECT_THAT(refused, StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("page_token")));
    EXPECT_EQ(base::ReasonOf(refused), base::ErrorReason::kInvalidField);
  }
  EXPECT_THAT(List(-1, ""), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("page_size")));
  EXPECT_THAT(Status(-1), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("page_size")));
}

TEST_F(CoordinatorOperationsTest, ErrorsTellTheirReasonAndWhetherItPasses) {
  FakeAgent* const agent = AddAgent({MakeShard("head", 0, 1)});
  AddAgent({MakeShard("half", 0, 2, kOtherId)});
  agent->on_frame = [](grpc::ServerContext*, FakeAgent::FrameStream*) {
    return grpc::Status(grpc::StatusCode::DATA_LOSS, "block 7 is damaged");
  };
  const Running running = Start();
  const auto reason_of = [this](v1::RenderIsosurfaceRequest request, const std::string& dataset) {
    request.set_dataset(dataset);
    return base::ReasonOf(Render(request));
  };
  EXPECT_EQ(reason_of(FrameRequest(""), "head"), base::ErrorReason::kShardDamaged);
  EXPECT_EQ(reason_of(FrameRequest(""), "foot"), base::ErrorReason::kDatasetUnknown);
  EXPECT_EQ(reason_of(FrameRequest(""), "half"), base::ErrorReason::kDatasetIncomplete);
  v1::RenderIsosurfaceRequest malformed = FrameRequest("");
  malformed.mutable_viewport()->set_width_px(-1);
  EXPECT_EQ(reason_of(malformed, "head"), base::ErrorReason::kInvalidField);
  agents_[0]->Stop();
  const base::ErrorReason lost = reason_of(FrameRequest(""), "head");
  EXPECT_TRUE(lost == base::ErrorReason::kAgentLost ||
              lost == base::ErrorReason::kDatasetIncomplete)
      << base::NameOf(lost);
  EXPECT_TRUE(base::IsTransient(lost));
}

TEST_F(CoordinatorOperationsTest, AnAgentThatDrainsGetsNoFramesIfAReplicaHasItsShards) {
  std::atomic<int> drained_frames{0};
  std::atomic<bool> is_drained{false};
  for (int i = 0; i < 2; ++i) {
    FakeAgent* const agent = AddAgent({MakeShard("head", 0, 1)});
    agent->on_frame = [&, agent](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
      drained_frames += is_drained && agent->is_draining ? 1 : 0;
      return PlayEmptyFrame(stream);
    };
  }
  const Running running = Start();
  for (int i = 0; i < 10; ++i) {
    EXPECT_THAT(Render(FrameRequest("")), IsOk());
  }
  for (const std::unique_ptr<FakeAgent>& agent : agents_) {
    agent->is_draining = true;
    const base::MonotonicTime limit = base::MonotonicNow() + kLong;
    while (base::MonotonicNow() < limit) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto status, Status());
      const auto drains = [&](const v1::AgentStatus& seen) {
        return seen.is_draining() == (seen.address() == agent->address());
      };
      if (drains(status.agents(0)) && drains(status.agents(1))) {
        break;
      }
      EXPECT_THAT(Render(FrameRequest("")), IsOk());
    }
    is_drained = true;
    for (int i = 0; i < 10; ++i) {
      EXPECT_THAT(Render(FrameRequest("")), IsOk());
    }
    EXPECT_EQ(drained_frames, 0);
    is_drained = false;
    agent->is_draining = false;
  }
}

TEST_F(CoordinatorOperationsTest, AnAgentThatDrainsAloneServesToItsEnd) {
  AddAgent({MakeShard("head", 0, 1)})->is_draining = true;
  const Running running = Start();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto status, Status());
  EXPECT_TRUE(status.agents(0).is_draining());
  EXPECT_THAT(Render(FrameRequest("")), IsOk());
}

// The lines of the audit log that a call has left.
TEST_F(CoordinatorOperationsTest, EachCallLeavesAnAuditLineRefusedOnesToo) {
  const testing::TempDir folder;
  const std::string path = folder.Sub("audit.log");
  options_.audit_log = path;
  AddAgent({MakeShard("head", 0, 1)});
  const Running running = Start();
  EXPECT_THAT(Render(FrameRequest(kSomeId)), IsOk());
  EXPECT_FALSE(Render(FrameRequest(kOtherId)).ok());
  v1::RenderIsosurfaceRequest malformed = FrameRequest("");
  malformed.mutable_viewport()->set_width_px(-1);
  EXPECT_FALSE(Render(malformed).ok());
  EXPECT_FALSE(Pick(FrameRequest(kOtherId)).ok());
  EXPECT_FALSE(Export(kOtherId).ok());
  EXPECT_FALSE(Histogram(kOtherId).ok());
  EXPECT_TRUE(Interact(FrameRequest("")).is_exact());
  ISOSCOPE_EXPECT_OK(List(0, "").status());
  coordinator_->Shutdown(kLong);  // the last lines are written
  coordinator_.reset();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string text, io::ReadWholeFile(path, 1 << 20));
  const std::vector<std::string> lines = absl::StrSplit(text, '\n', absl::SkipEmpty());
  const auto line_of = [&](const std::string& method, const std::string& code) {
    std::vector<std::string> found;
    for (const std::string& line : lines) {
      if (absl::StrContains(line, absl::StrCat("\"method\":\"", method, "\"")) &&
          absl::StrContains(line, absl::StrCat("\"code\":\"", code, "\""))) {
        found.push_back(line);
      }
    }
    return found.empty() ? std::string("no line\n") + text : found.front();
  };
  const std::string id = absl::StrCat("\"dataset\":\"head\",\"dataset_id\":\"", kSomeId, "\"");
  EXPECT_THAT(line_of("RenderIsosurface", "OK"), HasSubstr(id));
  EXPECT_THAT(line_of("RenderIsosurface", "FAILED_PRECONDITION"),
              HasSubstr("\"reason\":\"DATASET_ID_DIFFERS\""));
  EXPECT_THAT(line_of("RenderIsosurface", "INVALID_ARGUMENT"),
              HasSubstr("\"dataset\":\"head\",\"dataset_id\":\"\""));
  EXPECT_THAT(line_of("PickSurface", "FAILED_PRECONDITION"), HasSubstr("\"peer\":\"unknown\""));
  EXPECT_THAT(line_of("ExportIsosurface", "FAILED_PRECONDITION"), HasSubstr(id));
  EXPECT_THAT(line_of("GetHistogram", "FAILED_PRECONDITION"), HasSubstr(id));
  EXPECT_THAT(line_of("Interact", "OK"), HasSubstr(id));
  EXPECT_THAT(line_of("ListDatasets", "OK"), HasSubstr("\"request\":\""));
}

TEST_F(CoordinatorOperationsTest, AnAuditLogThatCannotBeOpenedStopsTheStart) {
  options_.audit_log = "/nonexistent/audit.log";
  options_.agents = {{"127.0.0.1:1", nullptr}};
  EXPECT_THAT(CoordinatorServer::Start(options_).status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("--audit-log")));
}

class ReadinessTest : public CoordinatorOperationsTest {
 protected:
  absl::Status Probe(rpc::Probe probe) const {
    return rpc::ProbeHealth(absl::StrCat("127.0.0.1:", coordinator_->port()), {}, kLong, probe);
  }
};

TEST_F(ReadinessTest, ItIsLiveAtOnceAndReadyOnceAllAgentsWereAsked) {
  const auto may_answer = std::make_shared<absl::Notification>();  // agents outlive this body
  AddAgent({MakeShard("head", 0, 2)});  // one of two shards: never complete
  AddAgent({})->on_describe = [may_answer] { may_answer->WaitForNotification(); };
  options_.listen_address = "127.0.0.1:0";
  const Running running = Start(/*waits=*/false);
  EXPECT_THAT(Probe(rpc::Probe::kLive), IsOk());
  EXPECT_THAT(Probe(rpc::Probe::kReady), StatusIs(absl::StatusCode::kUnavailable));
  may_answer->Notify();
  const base::MonotonicTime limit = base::MonotonicNow() + kLong;
  while (!Probe(rpc::Probe::kReady).ok() && base::MonotonicNow() < limit) {
    absl::SleepFor(absl::Milliseconds(5));
  }
  EXPECT_THAT(Probe(rpc::Probe::kReady), IsOk());
}

TEST_F(ReadinessTest, ItStaysReadyWhenItsOnlyDatasetIsLost) {
  AddAgent({MakeShard("head", 0, 1)});
  options_.listen_address = "127.0.0.1:0";
  const Running running = Start();
  EXPECT_THAT(Probe(rpc::Probe::kReady), IsOk());
  agents_[0]->Stop();
  const base::MonotonicTime limit = base::MonotonicNow() + kLong;
  while (base::MonotonicNow() < limit) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto status, Status());
    if (status.agents(0).state() == v1::AgentStatus::STATE_UNREACHABLE) {
      break;
    }
    absl::SleepFor(absl::Milliseconds(5));
  }
  EXPECT_THAT(Probe(rpc::Probe::kReady), IsOk());
  coordinator_->Shutdown(absl::ZeroDuration());
  EXPECT_FALSE(Probe(rpc::Probe::kReady).ok());
}

TEST_F(CoordinatorOperationsTest, EachMetricHasOneOwnerAndANameByTheConvention) {
  options_.max_concurrent_frames = 3;
  options_.max_queued_frames = 7;
  AddAgent({MakeShard("head", 0, 2, kSomeId)});
  AddAgent({MakeShard("head", 1, 2, kSomeId)});
  const Running running = Start();
  const std::vector<base::MetricFamily> families = coordinator_->CollectMetrics();
  testing::ExpectNamesFollowTheConvention(families);
  auto values = testing::ValuesOf(families);
  EXPECT_EQ(values["isoscope_admission_limit_frames state=working"], 3);
  EXPECT_EQ(values["isoscope_admission_limit_frames state=queued"], 7);
  EXPECT_EQ(values["isoscope_agents state=reachable"], 2);
  EXPECT_EQ(values["isoscope_agents state=unreachable"], 0);
  EXPECT_EQ(values["isoscope_datasets state=complete"], 1);
  EXPECT_EQ(values["isoscope_audit_lines_total result=written"], 0) << "there is no audit log";
}

}  // namespace
}  // namespace isoscope::server
