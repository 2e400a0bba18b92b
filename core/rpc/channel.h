// Channels and servers made the same way everywhere: message limits, keepalive, reconnect back-off.

#ifndef ISOSCOPE_CORE_RPC_CHANNEL_H_
#define ISOSCOPE_CORE_RPC_CHANNEL_H_

#include <memory>
#include <string>

#include <grpcpp/channel.h>
#include <grpcpp/server_builder.h>
#include <grpcpp/support/channel_arguments.h>

#include "core/base/units.h"

namespace isoscope::rpc {

// The largest message sent or received: a PNG of the largest viewport, a band of pixels
// (composite::kMaxBandBytes), an occlusion map. Reported by GetCapabilities.
inline constexpr int kMaxMessageBytes = 256 * base::kMiB;

grpc::ChannelArguments MakeChannelArguments();
// An insecure channel to any gRPC target.
std::shared_ptr<grpc::Channel> MakeChannel(const std::string& target);
// The same limits for a server.
void ConfigureServer(grpc::ServerBuilder* builder);

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_CORE_RPC_CHANNEL_H_
