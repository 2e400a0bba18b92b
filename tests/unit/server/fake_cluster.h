// A coordinator in this process over agents of a script, and what tests ask of it.

#ifndef ISOSCOPE_TESTS_UNIT_SERVER_FAKE_CLUSTER_H_
#define ISOSCOPE_TESTS_UNIT_SERVER_FAKE_CLUSTER_H_

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/synchronization/notification.h"
#include "absl/time/clock.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"
#include "isoscope/v1/cluster_service.grpc.pb.h"
#include "isoscope/v1/dataset_service.grpc.pb.h"
#include "isoscope/v1/interact_service.grpc.pb.h"
#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"
#include "rpc/peer.h"
#include "server/access/access_tokens.h"
#include "server/coordinator_server.h"
#include "tests/support/certificates.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/server/fake_agent.h"

namespace isoscope::testing {

// A guard against a hang; nothing is measured by it.
inline constexpr absl::Duration kLimit = absl::Seconds(60);

inline bool WaitFor(const std::function<bool()>& condition) {
  const base::MonotonicTime end = base::MonotonicNow() + kLimit;
  while (!condition() && base::MonotonicNow() < end) {
    absl::SleepFor(absl::Milliseconds(1));
  }
  return condition();
}

// Plays an agent that hangs until the coordinator cancels, for as long as any test may take.
inline grpc::Status HangUntilCancelled(grpc::ServerContext* context,
                                       std::atomic<int>* cancelled = nullptr) {
  if (WaitFor([&] { return context->IsCancelled(); }) && cancelled != nullptr) {
    ++*cancelled;
  }
  return grpc::Status::CANCELLED;
}

inline v1::RenderIsosurfaceRequest FrameRequest(int width = 32, int height = 16) {
  v1::RenderIsosurfaceRequest request;
  request.set_dataset("head");
  request.set_isovalue(100);
  request.mutable_viewport()->set_width_px(width);
  request.mutable_viewport()->set_height_px(height);
  return request;
}

inline v1::ExportIsosurfaceRequest ExportRequest() {
  v1::ExportIsosurfaceRequest request;
  request.set_dataset("head");
  request.set_isovalue(100);
  return request;
}

// The same triangle several times, of a block that shares no vertex with others.
inline internal::v1::ExtractSurfaceResponse Triangles(std::int64_t block_id = 0, int count = 1) {
  internal::v1::ExtractSurfaceResponse message;
  internal::v1::BlockSurface* block = message.add_blocks();
  block->set_block_id(block_id);
  const std::vector<float> positions = {1, 1, 1.5F, 2, 1, 1.5F, 1, 2, 1.5F};
  std::vector<std::uint32_t> triangles;
  for (int i = 0; i < count; ++i) {
    triangles.insert(triangles.end(), {0, 1, 2});
  }
  block->set_positions(positions.data(), positions.size() * sizeof(float));
  block->set_normals(positions.data(), positions.size() * sizeof(float));
  block->set_triangles(triangles.data(), triangles.size() * sizeof(std::uint32_t));
  return message;
}

// Sends the meshes of blocks, each with the given number of triangles.
inline grpc::Status WriteBlocks(std::int64_t first, std::int64_t end, int triangles,
                                FakeAgent::SurfaceWriter* writer) {
  for (std::int64_t id = first; id < end; ++id) {
    if (!writer->Write(Triangles(id, triangles))) {
      return grpc::Status::CANCELLED;
    }
  }
  return grpc::Status::OK;
}

// An entry of a token file whose token is its name. `limits`: more members.
inline std::string TokenEntry(const std::string& token, const std::string& limits = "",
                              const std::string& datasets = R"("*")") {
  return absl::StrCat(R"({"name": ")", token, R"(", "sha256": ")",
                      absl::BytesToHexString(server::DigestOfToken(token)), R"(", "datasets": [)",
                      datasets, "]", limits.empty() ? "" : ", ", limits, "}");
}

// Frames of an agent that wait for their release.
class HeldFrames {
 public:
  explicit HeldFrames(FakeAgent* agent, bool is_holding = true) : is_holding_(is_holding) {
    agent->on_frame = [this](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
      if (is_holding_) {
        if (++count_ == 1) {
          begun_.Notify();
        }
        release_.WaitForNotification();
      }
      return PlayEmptyFrame(stream);
    };
  }
  void Hold() { is_holding_ = true; }
  bool AwaitOne() { return begun_.WaitForNotificationWithTimeout(kLimit); }
  // Frames that come later are not held.
  void Release() {
    is_holding_ = false;
    release_.Notify();
  }

 private:
  std::atomic<bool> is_holding_;
  std::atomic<int> count_{0};
  absl::Notification begun_;
  absl::Notification release_;
};

// One export, which a test reads chunk by chunk.
class Export {
 public:
  explicit Export(v1::IsosurfaceService::Stub* stub, const std::string& token = "",
                  const v1::ExportIsosurfaceRequest& request = ExportRequest()) {
    rpc::SendToken(token, &context_);
    reader_ = stub->ExportIsosurface(&context_, request);
  }
  ~Export() {
    if (!is_finished_) {
      context_.TryCancel();
      Finish().IgnoreError();
    }
  }
  // Reads chunk(); false at the end.
  bool Read() {
    if (!reader_->Read(&chunk_)) {
      return false;
    }
    triangle_bytes_ += chunk_.triangles().size();
    return true;
  }
  absl::Status Finish() {
    while (Read()) {
    }
    is_finished_ = true;
    return rpc::ToAbslStatus(reader_->Finish());
  }
  [[nodiscard]] const v1::ExportIsosurfaceResponse& chunk() const { return chunk_; }
  // How many triangles came so far.
  [[nodiscard]] std::size_t triangle_count() const {
    return triangle_bytes_ / (3 * sizeof(std::int64_t));
  }

 private:
  grpc::ClientContext context_;
  std::unique_ptr<grpc::ClientReader<v1::ExportIsosurfaceResponse>> reader_;
  v1::ExportIsosurfaceResponse chunk_;
  std::size_t triangle_bytes_ = 0;
  bool is_finished_ = false;
};

// Agents that have nothing to draw unless a test says otherwise.
class FakeClusterTest : public ::testing::Test {
 protected:
  // Ends the cluster before what the scripts of its agents refer to: an agent may still play a call
  // that nobody waits for.
  class [[nodiscard]] Running {
   public:
    explicit Running(FakeClusterTest* test) : test_(*test) {}
    ~Running() { test_.Stop(); }
    Running(const Running&) = delete;
    Running& operator=(const Running&) = delete;

   private:
    FakeClusterTest& test_;
  };

  FakeClusterTest() { options_.poll_interval = absl::Hours(1); }

  FakeAgent* AddAgent(std::vector<internal::v1::ShardDescription> shards) {
    agents_.push_back(std::make_unique<FakeAgent>(std::move(shards)));
    FakeAgent* const agent = agents_.back().get();
    agent->on_frame = [](grpc::ServerContext*, FakeAgent::FrameStream* stream) {
      return PlayEmptyFrame(stream);
    };
    agent->on_surface = [](grpc::ServerContext*, FakeAgent::SurfaceWriter*) {
      return grpc::Status::OK;
    };
    return agent;
  }

  // Runs the cluster until the end of the scope, which has to be after the scripts' variables.
  Running Start(bool waits = true) {
    StartAll(waits);
    return Running(this);
  }
  void StartAll(bool waits) {
    options_.agents.clear();
    for (const std::unique_ptr<FakeAgent>& agent : agents_) {
      agent->Start();
      options_.agents.push_back({agent->address(), nullptr});
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(coordinator_, server::CoordinatorServer::Start(options_));
    if (waits) {
      ISOSCOPE_ASSERT_OK(coordinator_->WaitUntilReady(base::MonotonicNow() + 3 * kLimit));
    }
    channel_ = coordinator_->InProcessChannel();
    frames_ = v1::IsosurfaceService::NewStub(channel_);
    datasets_ = v1::DatasetService::NewStub(channel_);
    cluster_ = v1::ClusterService::NewStub(channel_);
  }

  void Stop() {
    cluster_.reset();
    datasets_.reset();
    frames_.reset();
    channel_.reset();
    coordinator_.reset();
    for (const std::unique_ptr<FakeAgent>& agent : agents_) {
      agent->Stop();
    }
  }

  void WriteTokens(const std::vector<std::string>& entries) {
    options_.token_file = folder_.Sub("tokens.json");
    ReplaceFile(options_.token_file,
                absl::StrCat(R"({"tokens": [)", absl::StrJoin(entries, ","), "]}"));
  }

  // Makes one unary call: Call(frames_, &v1::IsosurfaceService::Stub::PickSurface, request).
  template <typename Stub, typename Request, typename Response>
  static absl::StatusOr<Response> Call(const std::unique_ptr<Stub>& stub,
                                       grpc::Status (Stub::*method)(grpc::ClientContext*,
                                                                    const Request&, Response*),
                                       const Request& request, const std::string& token = "",
                                       absl::Duration timeout = 3 * kLimit) {
    grpc::ClientContext context;
    context.set_deadline(base::MonotonicNow() + timeout);
    rpc::SendToken(token, &context);
    Response response;
    const absl::Status status =
        rpc::ToAbslStatus((stub.get()->*method)(&context, request, &response));
    return status.ok() ? absl::StatusOr<Response>(std::move(response)) : status;
  }
  absl::StatusOr<v1::RenderIsosurfaceResponse> Render(const v1::RenderIsosurfaceRequest& request,
                                                      absl::Duration timeout = kLimit,
                                                      const std::string& token = "") {
    return Call(frames_, &v1::IsosurfaceService::Stub::RenderIsosurface, request, token, timeout);
  }
  absl::StatusOr<v1::GetClusterStatusResponse> Status(
      const std::string& token = "", const v1::GetClusterStatusRequest& request = {}) {
    return Call(cluster_, &v1::ClusterService::Stub::GetClusterStatus, request, token);
  }
  absl::StatusOr<v1::ListDatasetsResponse> List(int page_size = 0,
                                                const std::string& page_token = "",
                                                const std::string& token = "") {
    v1::ListDatasetsRequest request;
    request.set_page_size(page_size);
    request.set_page_token(page_token);
    return Call(datasets_, &v1::DatasetService::Stub::ListDatasets, request, token);
  }

  // Returns the value of a metric, of the sample with this label value if one is given.
  double Metric(const std::string& name, const std::string& label = "") {
    for (const base::MetricFamily& family : coordinator_->CollectMetrics()) {
      for (const base::MetricSample& sample : family.samples) {
        const bool is_wanted =
            label.empty() || std::any_of(sample.labels.begin(), sample.labels.end(),
                                         [&](const auto& one) { return one.second == label; });
        if (family.name == name && is_wanted) {
          return sample.value;
        }
      }
    }
    ADD_FAILURE() << "no metric " << name << " " << label;
    return -1;
  }

  TempDir folder_;
  std::vector<std::unique_ptr<FakeAgent>> agents_;
  server::CoordinatorServerOptions options_;
  std::unique_ptr<server::CoordinatorServer> coordinator_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<v1::IsosurfaceService::Stub> frames_;
  std::unique_ptr<v1::DatasetService::Stub> datasets_;
  std::unique_ptr<v1::ClusterService::Stub> cluster_;
};

// Two agents with a shard of "head" each.
class TwoAgentsTest : public FakeClusterTest {
 protected:
  FakeAgent& first_ = *AddAgent({MakeShard("head", 0, 2)});
  FakeAgent& second_ = *AddAgent({MakeShard("head", 1, 2)});
};

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_UNIT_SERVER_FAKE_CLUSTER_H_
