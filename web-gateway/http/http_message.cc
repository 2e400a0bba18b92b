#include "web-gateway/http/http_message.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include <nlohmann/json.hpp>

#include "core/base/printable.h"
#include "core/base/retry_delay.h"
#include "rpc/grpc_status.h"

namespace isoscope::gateway {

int HttpStatusOf(absl::StatusCode code) {
  switch (code) {
    case absl::StatusCode::kOk:
      return 200;
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kOutOfRange:
      return 400;
    case absl::StatusCode::kUnauthenticated:
      return 401;
    case absl::StatusCode::kPermissionDenied:
      return 403;
    case absl::StatusCode::kNotFound:
      return 404;
    case absl::StatusCode::kFailedPrecondition:
    case absl::StatusCode::kAlreadyExists:
    case absl::StatusCode::kAborted:
      return 409;
    case absl::StatusCode::kResourceExhausted:
      return 429;
    case absl::StatusCode::kCancelled:
      return 499;
    case absl::StatusCode::kUnimplemented:
      return 501;
    case absl::StatusCode::kUnavailable:
      return 503;
    case absl::StatusCode::kDeadlineExceeded:
      return 504;
    default:
      return 500;
  }
}

HttpResponse ErrorResponse(const absl::Status& status) {
  return ErrorResponse(status, HttpStatusOf(status.code()));
}

HttpResponse ErrorResponse(const absl::Status& status, int http_status) {
  nlohmann::ordered_json json = {{"code", absl::StatusCodeToString(status.code())},
                                 {"message", rpc::BoundedMessage(status.message())}};
  const std::optional<absl::Duration> delay = base::RetryDelayOf(status);
  if (delay.has_value()) {
    json["retry_delay_ms"] = absl::ToInt64Milliseconds(*delay);
  }
  constexpr int kOneLine = -1;
  HttpResponse response =
      JsonResponse(absl::StrCat(base::PrintableJson(json.dump(kOneLine)), "\n"));
  response.status = http_status;
  if (delay.has_value()) {
    const std::int64_t seconds = absl::ToInt64Seconds(absl::Ceil(*delay, absl::Seconds(1)));
    response.headers.emplace_back("Retry-After", absl::StrCat(std::max(seconds, std::int64_t{1})));
  }
  if (http_status == 401) {
    response.headers.emplace_back("WWW-Authenticate", "Bearer");
  }
  return response;
}

void RemoveTemporaryFile(const std::string& path) {
  std::error_code ignored;
  std::filesystem::remove(path, ignored);
  std::filesystem::remove(std::filesystem::path(path).parent_path(), ignored);
}

HttpResponse JsonResponse(std::string json) {
  HttpResponse response;
  response.content_type = "application/json";
  response.body = std::move(json);
  response.headers.emplace_back("Cache-Control", "no-store");
  return response;
}

}  // namespace isoscope::gateway
