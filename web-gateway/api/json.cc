#include "web-gateway/api/json.h"

#include "absl/strings/str_cat.h"
#include "google/protobuf/stubs/common.h"
#include "google/protobuf/util/json_util.h"
#include <nlohmann/json.hpp>

#include "core/base/check.h"
#include "core/base/printable.h"

namespace isoscope::gateway {

std::string ToJson(const google::protobuf::Message& message) {
  std::string json;
  const auto status = google::protobuf::util::MessageToJsonString(message, &json);
  ISOSCOPE_CHECK(status.ok());  // all messages are known, and have no Any
  return json;
}

std::string ToAsciiJson(const google::protobuf::Message& message) {
  constexpr int kOneLine = -1;
  return nlohmann::ordered_json::parse(ToJson(message)).dump(kOneLine, ' ', /*ensure_ascii=*/true);
}

std::string ToJson(double number) { return nlohmann::json(number).dump(); }

absl::Status FromJson(absl::string_view json, google::protobuf::Message* message) {
  const auto status = google::protobuf::util::JsonStringToMessage(
      google::protobuf::StringPiece(json.data(), json.size()), message);
  if (status.ok()) {
    return absl::OkStatus();
  }
  return absl::InvalidArgumentError(
      absl::StrCat("this is no JSON of a ", message->GetDescriptor()->name(), ": ",
                   base::Printable(base::CutText(status.message().as_string()))));
}

}  // namespace isoscope::gateway
