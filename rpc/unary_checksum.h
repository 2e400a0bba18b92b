// The checksum of a unary call between coordinator and agents, in the answer's trailing metadata:
//
//   isoscope-crc32c: 8 lower-case hex digits, the CRC-32C of the request as the server read it,
//                    followed by the answer (nothing, if the call failed)
//
// Both sides serialize the messages again. That gives the same bytes: the protos have no maps, and
// a new field's number is above the older ones of its message. The streams between them have
// checksums of another kind: proto/message_checksum.h.

#ifndef ISOSCOPE_RPC_UNARY_CHECKSUM_H_
#define ISOSCOPE_RPC_UNARY_CHECKSUM_H_

#include "absl/status/status.h"
#include "google/protobuf/message.h"
#include <grpcpp/client_context.h>
#include <grpcpp/server_context.h>

namespace isoscope::rpc {

// Adds the checksum to the answer. Once, before the call is finished. `status`: that of the call.
void AnswerChecksum(const google::protobuf::Message& request, const absl::Status& status,
                    const google::protobuf::Message& response, grpc::ServerContextBase* context);

// Returns `status`, that of an ended call. UNAVAILABLE in place of OK if the checksum is missing or
// differs, and in place of INVALID_ARGUMENT if it differs: the server may have read another request
// then.
absl::Status CheckAnswer(const google::protobuf::Message& request, const absl::Status& status,
                         const google::protobuf::Message& response,
                         const grpc::ClientContext& context);

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_RPC_UNARY_CHECKSUM_H_
