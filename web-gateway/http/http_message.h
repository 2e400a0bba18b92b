// Requests and answers of HTTP without a transport, and the status codes of errors.

#ifndef ISOSCOPE_WEB_GATEWAY_HTTP_HTTP_MESSAGE_H_
#define ISOSCOPE_WEB_GATEWAY_HTTP_HTTP_MESSAGE_H_

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

#include "web-gateway/http/url.h"

namespace isoscope::gateway {

struct HttpRequest {
  std::string method = "GET";  // GET (also for HEAD) or POST
  bool is_head = false;
  Target target = {};       // without the token
  std::string token = {};   // for the coordinator; empty: none
  std::string caller = {};  // identity of the caller, by token or address
  std::string if_none_match = {};
  std::string accept_encoding = {};  // the header; empty: none
  std::string body = {};
};

struct HttpResponse {
  int status = 200;
  std::string content_type = {};
  std::string body = {};
  // A file in place of `body`, alone in its folder. The sender opens it and calls
  // RemoveTemporaryFile.
  std::string file_path = {};
  // True if the length of the body is not known, as for the HEAD of an output that is not made for
  // it.
  bool has_unknown_length = false;
  // Lives until the answer is sent.
  std::shared_ptr<void> hold = nullptr;
  std::vector<std::pair<std::string, std::string>> headers = {};
};

// The HTTP status of an error code: INVALID_ARGUMENT 400, UNAUTHENTICATED 401, PERMISSION_DENIED
// 403, NOT_FOUND 404, FAILED_PRECONDITION 409, RESOURCE_EXHAUSTED 429, CANCELLED 499, UNIMPLEMENTED
// 501, UNAVAILABLE 503, DEADLINE_EXCEEDED 504; 500 for all others.
int HttpStatusOf(absl::StatusCode code);

// Returns the answer for an error: {"code": "INVALID_ARGUMENT", "message": "..."}, not cacheable.
// The retry delay of a refusal is the member "retry_delay_ms", and, in whole seconds of at least 1,
// the header Retry-After.
HttpResponse ErrorResponse(const absl::Status& status);
// Returns the same with another HTTP status, such as 405.
HttpResponse ErrorResponse(const absl::Status& status, int http_status);

// Removes a file, and its folder if that is empty then. Processes that have the file open keep it.
void RemoveTemporaryFile(const std::string& path);

// Returns an answer with JSON that is made anew for each request.
HttpResponse JsonResponse(std::string json);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_HTTP_HTTP_MESSAGE_H_
