#include "web-gateway/http/static_files.h"

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "absl/algorithm/container.h"
#include "absl/container/flat_hash_map.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"
#include "absl/strings/strip.h"

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

constexpr char kGzipSuffix[] = ".gz";

struct ServedFile {
  absl::string_view content;
  absl::string_view gzip;  // empty: not compressed
  std::string digest;      // of the content
};

// The files by name, each with its compressed form.
const absl::flat_hash_map<std::string, ServedFile>& ServedFiles() {
  static const auto files = [] {
    absl::flat_hash_map<std::string, ServedFile> made;
    for (const StaticFile& file : StaticFiles()) {
      absl::string_view name = file.name;
      if (absl::ConsumeSuffix(&name, kGzipSuffix)) {
        made[std::string(name)].gzip = file.content;
      } else {
        ServedFile& served = made[std::string(name)];
        served.content = file.content;
        served.digest = base::Sha256Hex(file.content).substr(0, kDigestDigits);
      }
    }
    return made;
  }();
  return files;
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

bool AcceptsGzip(absl::string_view accept_encoding) {
  for (const absl::string_view item : absl::StrSplit(accept_encoding, ',')) {
    const std::pair<absl::string_view, absl::string_view> parts =
        absl::StrSplit(item, absl::MaxSplits(';', 1));
    if (absl::EqualsIgnoreCase(absl::StripAsciiWhitespace(parts.first), "gzip")) {
      absl::string_view weight = absl::StripAsciiWhitespace(parts.second);
      double share = 1.0;
      return !absl::ConsumePrefix(&weight, "q=") || !absl::SimpleAtod(weight, &share) ||
             share > 0.0;
    }
  }
  return false;
}

HttpResponse ServeStaticFile(const HttpRequest& request, const std::string& policy) {
  const std::vector<std::string>& segments = request.target.segments;
  const std::string name = segments.empty() ? "index.html" : absl::StrJoin(segments, "/");
  const auto found = ServedFiles().find(name);
  if (found == ServedFiles().end()) {
    return ErrorResponse(absl::NotFoundError(
        absl::StrCat("there is no page ", Quoted(absl::StrCat("/", name)),
                     " here: '/' is the page, '/v1/datasets' lists the datasets")));
  }
  const ServedFile& file = found->second;
  const bool is_gzip = !file.gzip.empty() && AcceptsGzip(request.accept_encoding);
  // Other bytes have another strong tag.
  const std::string etag = absl::StrCat("\"", file.digest, is_gzip ? "-gzip" : "", "\"");
  HttpResponse response;
  response.headers = {{"ETag", etag},
                      {"Cache-Control", std::string(CachingOf(request.target, file.digest))},
                      {"Content-Security-Policy", policy}};
  if (!file.gzip.empty()) {
    response.headers.emplace_back("Vary", "Accept-Encoding, Origin");
  }
  if (MatchesEtag(request.if_none_match, etag)) {
    response.status = 304;
    return response;
  }
  if (is_gzip) {
    response.headers.emplace_back("Content-Encoding", "gzip");
  }
  response.content_type = ContentTypeOf(name);
  response.body = std::string(is_gzip ? file.gzip : file.content);
  return response;
}

}  // namespace isoscope::gateway
