// Stands in for an agent (StartHoldingAgent in process_cluster.h): passes the streams of the
// coordinator on to a real one, and holds one kind of message back until SIGUSR1 or the end of the
// stream. A process of its own, so that a test can kill an agent in a step of its choice.
//
// Usage: holding-agent UPSTREAM begin|occluders|visible_blocks

#include <unistd.h>

#include <atomic>
#include <csignal>
#include <iostream>
#include <memory>
#include <string>

#include "absl/time/clock.h"
#include "absl/time/time.h"
#include <grpcpp/client_context.h>
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>
#include <grpcpp/server_context.h>

#include "core/base/log.h"
#include "isoscope/internal/v1/partition_agent_service.grpc.pb.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/request_context.h"
#include "rpc/server_flags.h"
#include "rpc/unary_checksum.h"

namespace isoscope {
namespace {

namespace v1 = isoscope::internal::v1;

std::atomic<bool> is_released{false};
static_assert(std::atomic<bool>::is_always_lock_free, "the signal handler writes it");

class HoldingAgent final : public v1::PartitionAgentService::Service {
 public:
  HoldingAgent(const std::string& upstream, v1::RenderFrameRequest::MessageCase held)
      : stub_(v1::PartitionAgentService::NewStub(rpc::MakeChannel(upstream))), held_(held) {}

  grpc::Status DescribeShards(grpc::ServerContext* context,
                              const v1::DescribeShardsRequest* request,
                              v1::DescribeShardsResponse* response) override {
    grpc::ClientContext upstream_context;
    upstream_context.set_wait_for_ready(true);
    grpc::Status status = stub_->DescribeShards(&upstream_context, *request, response);
    rpc::AnswerChecksum(*request, rpc::ToAbslStatus(status), *response, context);
    return status;
  }

  grpc::Status RenderFrame(
      grpc::ServerContext* context,
      grpc::ServerReaderWriter<v1::RenderFrameResponse, v1::RenderFrameRequest>* stream) override {
    const std::unique_ptr<grpc::ClientContext> upstream_context =
        grpc::ClientContext::FromServerContext(*context);
    rpc::SetTraceparent(rpc::TraceContextOf(*context), upstream_context.get());
    const auto upstream = stub_->RenderFrame(upstream_context.get());
    v1::RenderFrameRequest request;
    while (stream->Read(&request)) {
      if (request.message_case() == held_ && !Hold(*context)) {
        break;
      }
      if (!upstream->Write(request) || !PassAnswerOn(upstream.get(), stream)) {
        break;
      }
    }
    if (context->IsCancelled()) {
      upstream_context->TryCancel();
    }
    return upstream->Finish();
  }

 private:
  // False: the stream was cancelled meanwhile.
  static bool Hold(const grpc::ServerContext& context) {
    if (!is_released.load()) {
      base::LogInfo("holding");
    }
    while (!is_released.load()) {
      if (context.IsCancelled()) {
        base::LogInfo("cancelled");
        return false;
      }
      absl::SleepFor(absl::Milliseconds(5));
    }
    return true;
  }

  // All messages up to the one that ends the step. False: nothing more comes.
  template <typename Upstream, typename Stream>
  static bool PassAnswerOn(Upstream* upstream, Stream* stream) {
    v1::RenderFrameResponse response;
    while (upstream->Read(&response)) {
      stream->Write(response);
      if (response.has_frame_done()) {
        return false;
      }
      if (response.message_case() != v1::RenderFrameResponse::MESSAGE_NOT_SET) {
        return true;
      }
    }
    return false;
  }

  const std::unique_ptr<v1::PartitionAgentService::Stub> stub_;
  const v1::RenderFrameRequest::MessageCase held_;
};

int Main(const std::string& upstream, const std::string& held_name,
         const std::string& listen_address) {
  const google::protobuf::FieldDescriptor* held =
      v1::RenderFrameRequest::descriptor()->FindFieldByName(held_name);
  if (held == nullptr) {
    std::cerr << "no message " << held_name << "\n";
    return 2;
  }
  std::signal(SIGUSR1, [](int) { is_released.store(true); });
  HoldingAgent service(upstream, static_cast<v1::RenderFrameRequest::MessageCase>(held->number()));
  grpc::ServerBuilder builder;
  rpc::ConfigureServer(&builder);
  builder.RegisterService(&service);
  auto running = rpc::StartServer(&builder, listen_address);
  if (!running.ok()) {
    std::cerr << running.status() << "\n";
    return 1;
  }
  base::LogInfo("agent_started", {{"address", rpc::BoundAddress(listen_address, running->port)}});
  running->server->Wait();  // until it is killed
  return 0;
}

}  // namespace
}  // namespace isoscope

int main(int argc, char** argv) {
  if (argc != 4) {
    std::cerr << "usage: holding-agent UPSTREAM begin|occluders|visible_blocks LISTEN\n";
    return 2;
  }
  return isoscope::Main(argv[1], argv[2], argv[3]);
}
