// Channels and servers made the same way everywhere: message limits, keepalive, reconnect back-off.
//
// A client that has a call in work pings after 10 s of silence and gives the connection up 5 s
// later, so that a machine that vanished is noticed within 15 s; servers do the same, and allow
// pings as often as every 5 s, so that no client of ours is sent away for pinging.

#ifndef ISOSCOPE_CORE_RPC_CHANNEL_H_
#define ISOSCOPE_CORE_RPC_CHANNEL_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include <grpcpp/channel.h>
#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>
#include <grpcpp/server_context.h>
#include <grpcpp/support/channel_arguments.h>

#include "core/base/units.h"

namespace isoscope::rpc {

// The largest message sent or received: a PNG of the largest viewport, a band of pixels
// (composite::kMaxBandBytes), the active blocks of a shard. Reported by GetCapabilities.
inline constexpr int kMaxMessageBytes = 256 * base::kMiB;

// Keepalive, limits, reconnect back-off of 50 ms to 1 s; never a proxy.
grpc::ChannelArguments MakeChannelArguments();
// An insecure channel to any gRPC target.
std::shared_ptr<grpc::Channel> MakeChannel(const std::string& target);
// The same, but on a connection of its own: it dials at once, whatever earlier channels to the same
// target have met.
std::shared_ptr<grpc::Channel> MakeFreshChannel(const std::string& target);

// Switches on health and reflection for all servers built later. Call before a ServerBuilder is
// made. Thread-safe; any number of times.
void EnableServerPlugins();
// The same limits for a server.
void ConfigureServer(grpc::ServerBuilder* builder);

// A server that was started, and the port it is bound to (0: none, in-process channels only).
struct RunningServer {
  std::unique_ptr<grpc::Server> server;
  int port = 0;
};
// Starts `builder` on `listen_address` ("HOST:PORT", port 0 takes a free one; empty: no port).
// UNAVAILABLE if the address can't be bound.
absl::StatusOr<RunningServer> StartServer(grpc::ServerBuilder* builder,
                                          const std::string& listen_address);

// The deadline of a call; InfiniteFuture if it has none.
absl::Time DeadlineOf(const grpc::ServerContextBase& context);

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_CORE_RPC_CHANNEL_H_
