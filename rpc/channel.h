// Gives all channels and servers the same settings: TLS, message limits, keepalive, reconnect
// back-off.
//
// A client with a call in work pings after 10 s of silence, and gives the connection up 5 s later.
// So it notices within 15 s that a machine has vanished. Servers do the same. They allow a ping
// every 5 s, so that they refuse no client of ours for pinging.

#ifndef ISOSCOPE_RPC_CHANNEL_H_
#define ISOSCOPE_RPC_CHANNEL_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include <grpcpp/channel.h>
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>
#include <grpcpp/server_context.h>
#include <grpcpp/support/channel_arguments.h>

#include "core/base/monotonic_time.h"
#include "core/base/units.h"
#include "rpc/transport.h"

namespace isoscope::rpc {

// The largest message that clients and agents take, and that any program sends: a PNG of the
// largest viewport, a band of pixels (composite::kMaxBandBytes), the active blocks of a shard.
// Reported by GetCapabilities.
inline constexpr int kMaxMessageBytes = 256 * base::kMiB;
// The largest request that a public service takes. The largest one that is valid, a pick of all the
// pixels that one call may have, has less than a tenth of it.
inline constexpr int kMaxPublicRequestBytes = base::kMiB;

// Keepalive, limits, reconnect back-off of 50 ms to 1 s; never a proxy.
grpc::ChannelArguments MakeChannelArguments();
// A channel to any gRPC target.
std::shared_ptr<grpc::Channel> MakeChannel(const std::string& target, const Dialing& dialing = {});
// Does the same on a connection of its own, which dials at once, even if earlier channels to the
// target have failed.
std::shared_ptr<grpc::Channel> MakeFreshChannel(const std::string& target,
                                                const Dialing& dialing = {});
// Does the same for a coordinator's agents, which are near and many: a stream reads 4 MiB ahead at
// most, so that the coordinator needs no more memory than it reserves.
std::shared_ptr<grpc::Channel> MakeAgentChannel(const std::string& target, const Dialing& dialing);
// The same for exports, which hold a stream of each agent for as long as the slowest client reads:
// a stream reads 256 KiB ahead at most.
std::shared_ptr<grpc::Channel> MakeExportChannel(const std::string& target, const Dialing& dialing);

// Switches on health and reflection for all servers built later. Call before a ServerBuilder is
// made. Thread-safe; any number of times.
void EnableServerPlugins();
// Takes reflection away from one server.
void RemoveReflection(grpc::ServerBuilder* builder);
// Sets the limits of a server. `max_request_bytes`: of one message that it takes.
void ConfigureServer(grpc::ServerBuilder* builder, int max_request_bytes = kMaxMessageBytes);

// A server that was started, and the port it is bound to (0: none, in-process channels only).
struct RunningServer {
  std::unique_ptr<grpc::Server> server;
  int port = 0;
};
// Starts `builder` on `listen_address` ("HOST:PORT", port 0 takes a free one; empty: no port).
// `credentials`: null for plaintext. UNAVAILABLE if the address can't be bound.
absl::StatusOr<RunningServer> StartServer(
    grpc::ServerBuilder* builder, const std::string& listen_address,
    const std::shared_ptr<grpc::ServerCredentials>& credentials = nullptr);

// Returns the deadline of a call; InfiniteFuture if it has none.
base::MonotonicTime DeadlineOf(const grpc::ServerContextBase& context);

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_RPC_CHANNEL_H_
