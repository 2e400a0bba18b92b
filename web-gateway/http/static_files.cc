#include "web-gateway/http/static_files.h"

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "absl/algorithm/container.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/string_view.h"

#include "core/base/sha256.h"
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

// Digits of a digest: cmake/bundle_page.py writes as many into the addresses of index.html.
constexpr std::size_t kDigestDigits = 32;

// Digests of the files, in their order.
const std::vector<std::string>& Digests() {
  static const std::vector<std::string> digests = [] {
    std::vector<std::string> made;
    for (const StaticFile& file : StaticFiles()) {
      made.push_back(base::Sha256Hex(file.content).substr(0, kDigestDigits));
    }
    return made;
  }();
  return digests;
}

// Bytes at an address with their digest never change; elsewhere a browser asks whether they have.
absl::string_view CachingOf(const Target& target, const std::string& digest) {
  const std::pair<std::string, std::string> version("v", digest);
  return absl::c_linear_search(target.query, version) ? "public, max-age=31536000, immutable"
                                                      : "no-cache";
}

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
  for (std::size_t i = 0; i < StaticFiles().size(); ++i) {
    const StaticFile& file = StaticFiles()[i];
    if (file.name != name) {
      continue;
    }
    const std::string& digest = Digests()[i];
    HttpResponse response;
    const std::string etag = absl::StrCat("\"", digest, "\"");
    response.headers = {{"ETag", etag},
                        {"Cache-Control", std::string(CachingOf(request.target, digest))},
                        {"Content-Security-Policy", policy}};
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
