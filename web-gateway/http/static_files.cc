#include "web-gateway/http/static_files.h"

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "web-gateway/http/etag.h"
#include "web-gateway/http/url.h"

namespace isoscope::gateway {
namespace {

// Scripts and styles come from the program alone: nothing inline, no eval, no blobs. Only workers
// may be blobs, because a module in one file has to start its worker from one.
constexpr char kContentSecurityPolicy[] =
    "default-src 'none'; script-src 'self'; worker-src 'self' blob:; style-src 'self'; "
    "img-src 'self' blob: data:; connect-src 'self'; font-src 'self'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'self'";

}  // namespace

std::string PagePolicy(const std::vector<std::string>& framing_origins) {
  std::string policy = kContentSecurityPolicy;
  for (const std::string& origin : framing_origins) {
    absl::StrAppend(&policy, " ", origin);
  }
  return policy;
}

std::string ContentTypeOf(absl::string_view name) {
  return absl::EndsWith(name, ".html")  ? "text/html; charset=utf-8"
         : absl::EndsWith(name, ".js")  ? "text/javascript; charset=utf-8"
         : absl::EndsWith(name, ".css") ? "text/css; charset=utf-8"
         : absl::EndsWith(name, ".svg") ? "image/svg+xml"
                                        : "application/octet-stream";
}

HttpResponse ServeStaticFile(const HttpRequest& request, const std::string& policy) {
  const std::vector<std::string>& segments = request.target.segments;
  const std::string name = segments.empty() ? "index.html" : absl::StrJoin(segments, "/");
  for (const StaticFile& file : StaticFiles()) {
    if (file.name != name) {
      continue;
    }
    HttpResponse response;
    const std::string etag = MakeEtag({file.content});
    response.headers = {
        {"ETag", etag}, {"Cache-Control", "no-cache"}, {"Content-Security-Policy", policy}};
    if (MatchesEtag(request.if_none_match, etag)) {
      response.status = 304;
      return response;
    }
    response.content_type = ContentTypeOf(file.name);
    response.body = std::string(file.content);
    return response;
  }
  return ErrorResponse(absl::NotFoundError(
      absl::StrCat("there is no page ", Quoted(absl::StrCat("/", name)),
                   " here: '/' is the page, '/v1/datasets' lists the datasets")));
}

}  // namespace isoscope::gateway
