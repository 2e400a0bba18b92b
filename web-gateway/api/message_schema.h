// JSON Schemas (2020-12) of protobuf messages, as their JSON mapping writes and reads them.

#ifndef ISOSCOPE_WEB_GATEWAY_API_MESSAGE_SCHEMA_H_
#define ISOSCOPE_WEB_GATEWAY_API_MESSAGE_SCHEMA_H_

#include <string>

#include <nlohmann/json_fwd.hpp>

namespace google::protobuf {
class Descriptor;
}  // namespace google::protobuf

namespace isoscope::gateway {

// Returns the name of a message's schema: "Dataset", "OutputOptions.ImageFormat" of what is inside
// another message.
std::string SchemaName(const google::protobuf::Descriptor& message);

// Returns {"$ref": "#/components/schemas/NAME"}, and adds to `*schemas`, an object, the schema of the
// message and those of the messages and enums that it refers to.
nlohmann::ordered_json AddMessageSchema(const google::protobuf::Descriptor& message,
                                        nlohmann::ordered_json* schemas);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_API_MESSAGE_SCHEMA_H_
