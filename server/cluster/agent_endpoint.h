// An agent as the command line names it.

#ifndef ISOSCOPE_SERVER_CLUSTER_AGENT_ENDPOINT_H_
#define ISOSCOPE_SERVER_CLUSTER_AGENT_ENDPOINT_H_

#include <memory>
#include <string>

namespace grpc {  // NOLINT(readability-identifier-naming): theirs
class Channel;
}  // namespace grpc

namespace isoscope::server {

// The address of an agent, or a channel to it.
struct AgentEndpoint {
  // Any gRPC target. "dns:///NAME:PORT" stands for every address of the name. It is resolved at
  // each poll, because agents come and go.
  std::string target;
  // If set, it is used instead of the target: an embedded agent's in-process channel.
  std::shared_ptr<grpc::Channel> channel;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_CLUSTER_AGENT_ENDPOINT_H_
