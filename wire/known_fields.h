// Finds fields of a request that this program does not know.

#ifndef ISOSCOPE_WIRE_KNOWN_FIELDS_H_
#define ISOSCOPE_WIRE_KNOWN_FIELDS_H_

#include "absl/status/status.h"
#include "google/protobuf/message.h"

namespace isoscope::wire {

// INVALID_ARGUMENT if `request`, or a message in it at any depth, has a field that this program's
// version of the schema lacks; names its number and its message. Protocol buffers would ignore the
// field, and the answer would silently belong to another request. O(size of the message).
absl::Status CheckKnownFields(const google::protobuf::Message& request);

// Builds the descriptors that CheckKnownFields needs for messages like `request`. Otherwise the
// first request of a program would wait for them, a millisecond or two.
void PrepareKnownFields(const google::protobuf::Message& request);

}  // namespace isoscope::wire

#endif  // ISOSCOPE_WIRE_KNOWN_FIELDS_H_
