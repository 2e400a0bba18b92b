// The settings of all channels and servers, in one place because both ends must agree:
//
//   keepalive   a client pings after 10 s of a call and waits 5 s; servers allow pings twice as
//               often, because clocks and queues jitter
//   sizes       HTTP/2 windows and frames for messages of up to 1 MiB from the first frame on
//   agents      a channel for frames reads 4 MiB ahead of each stream, one for exports 256 KiB;
//               without the bandwidth probe, which would widen that
//   limits      metadata, streams of a connection, idle time, handshake time
//
// A fresh channel has connections of its own: gRPC else shares them between channels.

#include "rpc/channel.h"

#include <memory>
#include <mutex>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include <grpc/grpc.h>
#include <grpcpp/create_channel.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/health_check_service_interface.h>
#include <grpcpp/impl/server_builder_option.h>
#include <grpcpp/impl/server_builder_plugin.h>
#include <grpcpp/security/credentials.h>
#include <grpcpp/security/server_credentials.h>

#include "rpc/grpc_time.h"

namespace isoscope::rpc {
namespace {

constexpr int kKeepaliveTimeMs = 10'000;
constexpr int kKeepaliveTimeoutMs = 5'000;
constexpr int kConnectTimeoutMs = 5'000;
// Servers allow pings twice as often as our clients send them, because clocks and queues jitter.
constexpr int kMinPingIntervalMs = kKeepaliveTimeMs / 2;

// Limits of the memory that a peer may hold. Our status messages and tokens fit the metadata; a
// gateway puts the streams of all its viewers on one connection.
constexpr int kMaxMetadataBytes = 8 * 1024;
constexpr int kMaxStreamsOfConnection = 512;
constexpr int kMaxIdleMs = 10 * 60 * 1000;
constexpr int kHandshakeTimeoutMs = 10'000;
constexpr int kMaxPingStrikes = 2;

// Sets sizes for messages of up to 1 MiB. gRPC would begin with windows of 64 KiB and frames of 16
// KiB, and read 8 KiB at a time. It widens them over time, which is too late for the first frame.
template <typename SetFn>
void SetTransferSizes(const SetFn& set) {
  constexpr int kMessageBytes = 1 << 20;
  set(GRPC_ARG_HTTP2_STREAM_LOOKAHEAD_BYTES, kMessageBytes);
  set(GRPC_ARG_HTTP2_MAX_FRAME_SIZE, kMessageBytes);
  set(GRPC_ARG_TCP_READ_CHUNK_SIZE, kMessageBytes / 4);
  set(GRPC_ARG_TCP_MIN_READ_CHUNK_SIZE, kMessageBytes / 16);
}

// gRPC's library of reflection gives it to every server as soon as it is linked.
class ReflectionRemover final : public grpc::ServerBuilderOption {
 public:
  void UpdateArguments(grpc::ChannelArguments* /*arguments*/) override {}
  void UpdatePlugins(std::vector<std::unique_ptr<grpc::ServerBuilderPlugin>>* plugins) override {
    std::erase_if(*plugins, [](const std::unique_ptr<grpc::ServerBuilderPlugin>& plugin) {
      return plugin->name() == "proto_server_reflection";
    });
  }
};

std::shared_ptr<grpc::Channel> Dial(const std::string& target, const Dialing& dialing,
                                    grpc::ChannelArguments arguments) {
  if (dialing.credentials == nullptr) {
    return grpc::CreateCustomChannel(target, grpc::InsecureChannelCredentials(), arguments);
  }
  if (!dialing.server_name.empty()) {
    arguments.SetSslTargetNameOverride(dialing.server_name);
  }
  return grpc::CreateCustomChannel(target, dialing.credentials, arguments);
}

grpc::ChannelArguments FreshChannelArguments() {
  grpc::ChannelArguments arguments = MakeChannelArguments();
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  return arguments;
}

std::shared_ptr<grpc::Channel> DialAgent(const std::string& target, const Dialing& dialing,
                                         std::size_t lookahead_bytes) {
  grpc::ChannelArguments arguments = FreshChannelArguments();
  // With the probe each stream may read 16 MiB ahead, or more.
  arguments.SetInt(GRPC_ARG_HTTP2_BDP_PROBE, 0);
  arguments.SetInt(GRPC_ARG_HTTP2_STREAM_LOOKAHEAD_BYTES, static_cast<int>(lookahead_bytes));
  return Dial(target, dialing, arguments);
}

}  // namespace

grpc::ChannelArguments MakeChannelArguments() {
  grpc::ChannelArguments arguments;
  arguments.SetMaxReceiveMessageSize(kMaxMessageBytes);
  arguments.SetMaxSendMessageSize(kMaxMessageBytes);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepaliveTimeMs);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, kKeepaliveTimeoutMs);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 0);
  // A frame can be silent for long while agents work, so pings must not run out.
  arguments.SetInt(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 50);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 1000);
  // Despite its name, this limits the time of one attempt to connect, handshake included.
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, kConnectTimeoutMs);
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  SetTransferSizes([&](const char* name, int bytes) { arguments.SetInt(name, bytes); });
  return arguments;
}

std::shared_ptr<grpc::Channel> MakeChannel(const std::string& target, const Dialing& dialing) {
  return Dial(target, dialing, MakeChannelArguments());
}

std::shared_ptr<grpc::Channel> MakeFreshChannel(const std::string& target, const Dialing& dialing) {
  return Dial(target, dialing, FreshChannelArguments());
}

std::shared_ptr<grpc::Channel> MakeAgentChannel(const std::string& target, const Dialing& dialing) {
  return DialAgent(target, dialing, 4 * base::kMiB);
}

std::shared_ptr<grpc::Channel> MakeExportChannel(const std::string& target,
                                                 const Dialing& dialing) {
  return DialAgent(target, dialing, base::kMiB / 4);
}

void EnableServerPlugins() {
  static std::once_flag once;
  std::call_once(once, [] {
    grpc::EnableDefaultHealthCheckService(true);
    grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  });
}

void RemoveReflection(grpc::ServerBuilder* builder) {
  builder->SetOption(std::make_unique<ReflectionRemover>());
}

void ConfigureServer(grpc::ServerBuilder* builder, int max_request_bytes) {
  builder->SetMaxReceiveMessageSize(max_request_bytes);
  builder->SetMaxSendMessageSize(kMaxMessageBytes);
  builder->AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepaliveTimeMs);
  builder->AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, kKeepaliveTimeoutMs);
  builder->AddChannelArgument(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
  builder->AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS,
                              kMinPingIntervalMs);
  builder->AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  builder->AddChannelArgument(GRPC_ARG_HTTP2_MAX_PING_STRIKES, kMaxPingStrikes);
  builder->AddChannelArgument(GRPC_ARG_MAX_METADATA_SIZE, kMaxMetadataBytes);
  builder->AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS, kMaxStreamsOfConnection);
  builder->AddChannelArgument(GRPC_ARG_MAX_CONNECTION_IDLE_MS, kMaxIdleMs);
  builder->AddChannelArgument(GRPC_ARG_SERVER_HANDSHAKE_TIMEOUT_MS, kHandshakeTimeoutMs);
  // Two servers on one port would take turns. With 0 the second one fails to start.
  builder->AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
  SetTransferSizes([&](const char* name, int bytes) { builder->AddChannelArgument(name, bytes); });
}

absl::StatusOr<RunningServer> StartServer(
    grpc::ServerBuilder* builder, const std::string& listen_address,
    const std::shared_ptr<grpc::ServerCredentials>& credentials) {
  RunningServer running;
  if (!listen_address.empty()) {
    builder->AddListeningPort(
        listen_address, credentials == nullptr ? grpc::InsecureServerCredentials() : credentials,
        &running.port);
  }
  running.server = builder->BuildAndStart();
  if (running.server == nullptr || (!listen_address.empty() && running.port == 0)) {
    return absl::UnavailableError(
        absl::StrCat("can't listen on \"", listen_address,
                     "\": it is in use, not an address of this machine, or not HOST:PORT"));
  }
  return running;
}

base::MonotonicTime DeadlineOf(const grpc::ServerContextBase& context) {
  return FromGrpcTime(context.raw_deadline());
}

}  // namespace isoscope::rpc
