// Server reflection of version 1, which today's tools ask for first. Debian's gRPC answers version
// 1alpha alone.

#ifndef ISOSCOPE_RPC_REFLECTION_V1_H_
#define ISOSCOPE_RPC_REFLECTION_V1_H_

#include <cstdint>

#include <grpcpp/server_builder.h>

namespace isoscope::rpc {

// The requests that one stream may have. A tool that describes a whole server needs some hundred.
inline constexpr std::int64_t kMaxReflectionRequests = 4096;

// Makes the server of `builder` answer grpc.reflection.v1.ServerReflection: to whoever may call
// grpc.reflection.v1alpha, and with the same answers. Both list both. Call once per builder.
void AddReflectionV1(grpc::ServerBuilder* builder);

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_RPC_REFLECTION_V1_H_
