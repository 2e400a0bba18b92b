// The checksum in front of every message of the streams between coordinator and agents. TCP's
// checksum misses one damaged packet in some 65 000, and gRPC has none.
//
//   on the wire   CRC-32C of the message, 4 bytes, little-endian | the message
//
// The generated stubs of these streams include this file (CMakeLists.txt), so that every program
// writes and checks it. gRPC's unary calls serialize messages without knowing their type, so they
// use rpc/unary_checksum.h.

#ifndef ISOSCOPE_PROTO_MESSAGE_CHECKSUM_H_
#define ISOSCOPE_PROTO_MESSAGE_CHECKSUM_H_

#include "absl/status/status.h"
#include "google/protobuf/message.h"
#include <grpcpp/impl/codegen/proto_utils.h>
#include <grpcpp/impl/codegen/serialization_traits.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/proto_buffer_reader.h>
#include <grpcpp/support/proto_buffer_writer.h>
#include <grpcpp/support/status.h>

#include "isoscope/internal/v1/partition_agent_service.pb.h"

namespace isoscope::proto {

// Puts the checksum of all bytes in front of them. Copies none.
void PrependChecksum(grpc::ByteBuffer* buffer);

// Parses the bytes after the checksum. A message that is cut, altered, without a checksum or
// malformed becomes an empty one that CheckIntact refuses. An error from here would make gRPC end
// the stream without a reason.
void ParseChecked(grpc::ByteBuffer* buffer, google::protobuf::Message* message);

// UNAVAILABLE if ParseChecked found that the message was damaged on its way. The receiver calls it
// before it uses the message.
absl::Status CheckIntact(const google::protobuf::Message& message);

// UNAVAILABLE: a message was damaged.
absl::Status DamagedError();

// How gRPC reads and writes a message with a checksum.
template <typename Message>
class ChecksummedTraits {
 public:
  static grpc::Status Serialize(const google::protobuf::MessageLite& message,
                                grpc::ByteBuffer* buffer, bool* own_buffer) {
    grpc::Status status =
        grpc::GenericSerialize<grpc::ProtoBufferWriter, Message>(message, buffer, own_buffer);
    if (status.ok()) {
      PrependChecksum(buffer);
    }
    return status;
  }
  static grpc::Status Deserialize(grpc::ByteBuffer* buffer, Message* message) {
    ParseChecked(buffer, message);
    return grpc::Status::OK;
  }
};

}  // namespace isoscope::proto

namespace grpc {

template <>
class SerializationTraits<isoscope::internal::v1::RenderFrameRequest>
    : public isoscope::proto::ChecksummedTraits<isoscope::internal::v1::RenderFrameRequest> {};
template <>
class SerializationTraits<isoscope::internal::v1::RenderFrameResponse>
    : public isoscope::proto::ChecksummedTraits<isoscope::internal::v1::RenderFrameResponse> {};
template <>
class SerializationTraits<isoscope::internal::v1::ExtractSurfaceRequest>
    : public isoscope::proto::ChecksummedTraits<isoscope::internal::v1::ExtractSurfaceRequest> {};
template <>
class SerializationTraits<isoscope::internal::v1::ExtractSurfaceResponse>
    : public isoscope::proto::ChecksummedTraits<isoscope::internal::v1::ExtractSurfaceResponse> {};

}  // namespace grpc

#endif  // ISOSCOPE_PROTO_MESSAGE_CHECKSUM_H_
