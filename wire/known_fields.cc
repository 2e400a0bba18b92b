#include "wire/known_fields.h"

#include <set>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "google/protobuf/descriptor.h"
#include "google/protobuf/unknown_field_set.h"

#include "core/base/status_macros.h"
#include "core/base/version.h"

namespace isoscope::wire {
namespace {

absl::Status Check(const google::protobuf::Message& message, const std::string& path) {
  const google::protobuf::Reflection& reflection = *message.GetReflection();
  const google::protobuf::UnknownFieldSet& unknown = reflection.GetUnknownFields(message);
  if (!unknown.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(path.empty() ? message.GetDescriptor()->name() : path, " has a field number ",
                     unknown.field(0).number(), ", which this server (version ", base::Version(),
                     ") does not know: use a newer server, or leave the field out"));
  }
  std::vector<const google::protobuf::FieldDescriptor*> fields;
  reflection.ListFields(message, &fields);
  for (const google::protobuf::FieldDescriptor* field : fields) {
    if (field->cpp_type() != google::protobuf::FieldDescriptor::CPPTYPE_MESSAGE) {
      continue;
    }
    const std::string name =
        path.empty() ? std::string(field->name()) : absl::StrCat(path, ".", field->name());
    if (!field->is_repeated()) {
      ISOSCOPE_RETURN_IF_ERROR(Check(reflection.GetMessage(message, field), name));
      continue;
    }
    for (int i = 0; i < reflection.FieldSize(message, field); ++i) {
      ISOSCOPE_RETURN_IF_ERROR(
          Check(reflection.GetRepeatedMessage(message, field, i), absl::StrCat(name, "[", i, "]")));
    }
  }
  return absl::OkStatus();
}

void Prepare(const google::protobuf::Message& message,
             std::set<const google::protobuf::Descriptor*>* prepared) {
  const google::protobuf::Descriptor& descriptor = *message.GetDescriptor();
  if (!prepared->insert(&descriptor).second) {
    return;
  }
  const google::protobuf::Reflection& reflection = *message.GetReflection();
  for (int i = 0; i < descriptor.field_count(); ++i) {
    const google::protobuf::Descriptor* const type = descriptor.field(i)->message_type();
    if (type != nullptr) {
      Prepare(*reflection.GetMessageFactory()->GetPrototype(type), prepared);
    }
  }
}

}  // namespace

void PrepareKnownFields(const google::protobuf::Message& request) {
  std::set<const google::protobuf::Descriptor*> prepared;
  Prepare(request, &prepared);
}

absl::Status CheckKnownFields(const google::protobuf::Message& request) {
  return Check(request, "");
}

}  // namespace isoscope::wire
