// The mapping (https://protobuf.dev/programming-guides/json):
//
//   message                  object with the fields' lowerCamelCase names, none of them required,
//                            because a field with its default value is left out
//   repeated, map            array, object
//   enum                     one of the names
//   int32, uint32            integer
//   int64, uint64            text of digits
//   float, double            number, or "NaN", "Infinity", "-Infinity"
//   bytes                    text, base64
//   Duration                 text such as "1.5s"
//
// Readers ignore members that they do not know: a later server may have more.

#include "web-gateway/api/message_schema.h"

#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include <google/protobuf/descriptor.h>
#include <nlohmann/json.hpp>

namespace isoscope::gateway {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::EnumDescriptor;
using google::protobuf::FieldDescriptor;
using Json = nlohmann::ordered_json;

// The full name without the package.
std::string NameWithoutPackage(const std::string& full_name, const std::string& package) {
  return std::string(absl::StripPrefix(full_name, absl::StrCat(package, ".")));
}

Json Reference(const std::string& name) {
  return {{"$ref", absl::StrCat("#/components/schemas/", name)}};
}

Json AddEnumSchema(const EnumDescriptor& type, Json* schemas) {
  const std::string name = NameWithoutPackage(type.full_name(), type.file()->package());
  if (!schemas->contains(name)) {
    Json names = Json::array();
    for (int i = 0; i < type.value_count(); ++i) {
      names.push_back(type.value(i)->name());
    }
    (*schemas)[name] = {{"type", "string"}, {"enum", std::move(names)}};
  }
  return Reference(name);
}

Json NumberSchema(const char* format) {
  const Json number = {{"type", "number"}, {"format", format}};
  const Json other = {{"type", "string"}, {"enum", {"NaN", "Infinity", "-Infinity"}}};
  return {{"oneOf", Json::array({number, other})}};
}

Json ValueSchema(const FieldDescriptor& field, Json* schemas) {
  switch (field.cpp_type()) {
    case FieldDescriptor::CPPTYPE_INT32:
      return {{"type", "integer"}, {"format", "int32"}};
    case FieldDescriptor::CPPTYPE_UINT32:
      return {{"type", "integer"}, {"minimum", 0}, {"maximum", 4294967295U}};
    case FieldDescriptor::CPPTYPE_INT64:
      return {{"type", "string"}, {"format", "int64"}, {"pattern", "^-?[0-9]+$"}};
    case FieldDescriptor::CPPTYPE_UINT64:
      return {{"type", "string"}, {"format", "uint64"}, {"pattern", "^[0-9]+$"}};
    case FieldDescriptor::CPPTYPE_DOUBLE:
      return NumberSchema("double");
    case FieldDescriptor::CPPTYPE_FLOAT:
      return NumberSchema("float");
    case FieldDescriptor::CPPTYPE_BOOL:
      return {{"type", "boolean"}};
    case FieldDescriptor::CPPTYPE_ENUM:
      return AddEnumSchema(*field.enum_type(), schemas);
    case FieldDescriptor::CPPTYPE_STRING:
      return field.type() == FieldDescriptor::TYPE_BYTES
                 ? Json{{"type", "string"}, {"contentEncoding", "base64"}}
                 : Json{{"type", "string"}};
    case FieldDescriptor::CPPTYPE_MESSAGE:
      break;
  }
  return AddMessageSchema(*field.message_type(), schemas);
}

Json FieldSchema(const FieldDescriptor& field, Json* schemas) {
  if (field.is_map()) {
    return {{"type", "object"},
            {"additionalProperties", ValueSchema(*field.message_type()->map_value(), schemas)}};
  }
  if (field.is_repeated()) {
    return {{"type", "array"}, {"items", ValueSchema(field, schemas)}};
  }
  return ValueSchema(field, schemas);
}

}  // namespace

std::string SchemaName(const Descriptor& message) {
  return NameWithoutPackage(message.full_name(), message.file()->package());
}

Json AddMessageSchema(const Descriptor& message, Json* schemas) {
  if (message.full_name() == "google.protobuf.Duration") {
    return {{"type", "string"},
            {"pattern", "^-?[0-9]+(\\.[0-9]{1,9})?s$"},
            {"examples", Json::array({"1.5s"})}};
  }
  const std::string name = SchemaName(message);
  if (!schemas->contains(name)) {
    (*schemas)[name] = Json::object();  // a message may refer to itself
    Json properties = Json::object();
    for (int i = 0; i < message.field_count(); ++i) {
      const FieldDescriptor& field = *message.field(i);
      properties[field.json_name()] = FieldSchema(field, schemas);
    }
    (*schemas)[name] = {{"type", "object"},
                        {"description", absl::StrCat("The message ", message.full_name(),
                                                     " of proto/", message.file()->name())},
                        {"properties", std::move(properties)}};
  }
  return Reference(name);
}

}  // namespace isoscope::gateway
