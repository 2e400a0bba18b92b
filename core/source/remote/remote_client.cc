#include "core/source/remote/remote_client.h"

#include <algorithm>
#include <cstdint>
#include <optional>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/source/remote/core_files.h"
#include "core/source/remote/netrc.h"
#include "core/source/remote/sigv4.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxTokenFileBytes = 64 * base::kKiB;
constexpr std::int64_t kMaxNetrcBytes = base::kMiB;
// Where AWS signs requests whose region is not known; it then tells the region.
constexpr char kDefaultRegion[] = "us-east-1";

void AddHeader(absl::string_view name, absl::string_view value, TransferRequest* request) {
  request->headers.emplace_back(absl::StrCat(name, ": ", value));
}

std::string HostHeader(const Address& url) {
  const std::string origin = OriginOf(url);
  return origin.substr(origin.find("://") + 3);
}

// What is wrong with a setting says nothing of the object.
absl::Status AsSetting(absl::string_view variable, const absl::Status& status) {
  return status.ok() ? status
                     : absl::FailedPreconditionError(absl::StrCat(variable, status.message()));
}

// The headers of a signed request. Its date is the only one that this room reads.
void AddSignature(const RequestSpec& spec, const Address& url, const std::string& region,
                  const AwsCredentials& credentials, TransferRequest* transfer) {
  const std::string timestamp =
      absl::FormatTime("%Y%m%dT%H%M%SZ", absl::Now(), absl::UTCTimeZone());
  RequestToSign to_sign{.method = "GET", .path = url.path, .query = spec.query, .headers = {}};
  to_sign.headers.emplace_back("x-amz-content-sha256", kEmptyPayloadHash);
  to_sign.headers.emplace_back("x-amz-date", timestamp);
  if (!credentials.session_token.empty()) {
    to_sign.headers.emplace_back("x-amz-security-token", credentials.session_token.Reveal());
  }
  for (const auto& [name, value] : to_sign.headers) {
    AddHeader(name, value, transfer);
  }
  to_sign.headers.emplace_back("host", HostHeader(url));
  if (!spec.range.empty()) {
    to_sign.headers.emplace_back("range", spec.range);
  }
  const SigningScope scope{.timestamp = timestamp, .region = region};
  AddHeader("Authorization", SignRequest(to_sign, scope, credentials).Reveal(), transfer);
}

}  // namespace

std::string RemoteClient::RegionOf(const std::string& bucket) const {
  {
    const base::MutexLock lock(&mutex_);
    const auto found = region_of_bucket_.find(bucket);
    if (found != region_of_bucket_.end()) {
      return found->second;
    }
  }
  if (!options_.s3.region.empty()) {
    return options_.s3.region;
  }
  return options_.s3.credentials.has_value() ? kDefaultRegion : "";
}

bool RemoteClient::LearnRegion(const std::string& bucket, const std::string& region) {
  const bool is_region = !region.empty() && region.size() <= 32 &&
                         std::all_of(region.begin(), region.end(), [](char c) {
                           return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '-';
                         });
  if (!is_region || !options_.s3.endpoint.empty() || RegionOf(bucket) == region) {
    return false;
  }
  const base::MutexLock lock(&mutex_);
  region_of_bucket_[bucket] = region;
  return true;
}

absl::StatusOr<Address> RemoteClient::UrlOfS3(const Address& address,
                                              const std::string& region) const {
  const S3Options& s3 = options_.s3;
  std::string endpoint = s3.endpoint;
  if (endpoint.empty()) {
    endpoint = absl::StrCat("https://s3", region.empty() ? "" : ".", region, ".amazonaws.com",
                            absl::StartsWith(region, "cn-") ? ".cn" : "");
  }
  ISOSCOPE_ASSIGN_OR_RETURN(Address url, ParseAddress(endpoint));
  const bool has_dot = absl::StrContains(address.bucket, '.');
  const bool is_virtual =
      s3.addressing == S3Options::Addressing::kVirtual ||
      (s3.addressing == S3Options::Addressing::kAutomatic && s3.endpoint.empty() && !has_dot);
  if (is_virtual) {
    url.host = absl::StrCat(absl::AsciiStrToLower(address.bucket), ".", url.host);
    url.path = "/";
  } else {
    url.path = absl::StrCat("/", PercentEncode(address.bucket, /*keeps_slashes=*/false), "/");
  }
  absl::StrAppend(&url.path, PercentEncode(address.key, /*keeps_slashes=*/true));
  return url;
}

absl::Status RemoteClient::AddHttpCredentials(PreparedRequest* request) const {
  const Address& url = request->url;
  const std::string origin = OriginOf(url);
  if (!options_.bearer.origin.empty() && options_.bearer.origin == origin) {
    Secret token = options_.bearer.token;
    if (token.empty()) {
      const auto text = io::ReadWholeFile(options_.bearer.file, kMaxTokenFileBytes);
      ISOSCOPE_RETURN_IF_ERROR(AsSetting("ISOSCOPE_BEARER_TOKEN_FILE: ", text.status()));
      token = Secret(std::string(absl::StripAsciiWhitespace(*text)));
      if (token.empty() || !std::all_of(token.Reveal().begin(), token.Reveal().end(), [](char c) {
            return absl::ascii_isgraph(static_cast<unsigned char>(c));
          })) {
        return absl::FailedPreconditionError(absl::StrCat(
            options_.bearer.file, ": holds no token; expected one line without spaces"));
      }
    }
    AddHeader("Authorization", absl::StrCat("Bearer ", token.Reveal()), &request->transfer);
    request->credentials = PreparedRequest::Credentials::kToken;
    return absl::OkStatus();
  }
  if (options_.netrc_file.empty() || !(url.is_https || IsLoopback(url.host))) {
    return absl::OkStatus();
  }
  ForbidCores();
  const auto text = io::ReadWholeFile(options_.netrc_file, kMaxNetrcBytes);
  ISOSCOPE_RETURN_IF_ERROR(AsSetting("NETRC: ", text.status()));
  const auto entry = FindInNetrc(*text, url.host);
  if (entry) {
    AddHeader("Authorization",
              absl::StrCat("Basic ", absl::Base64Escape(absl::StrCat(entry->login, ":",
                                                                     entry->password.Reveal()))),
              &request->transfer);
    request->credentials = PreparedRequest::Credentials::kPassword;
  }
  return absl::OkStatus();
}

absl::StatusOr<PreparedRequest> RemoteClient::Prepare(const RequestSpec& spec) const {
  PreparedRequest request;
  std::string region;
  if (spec.address.is_s3) {
    ISOSCOPE_RETURN_IF_ERROR(AsSetting("", options_.s3.problem));
    region = RegionOf(spec.address.bucket);
    ISOSCOPE_ASSIGN_OR_RETURN(request.url, UrlOfS3(spec.address, region));
    request.url.query = CanonicalQuery(spec.query);
  } else {
    request.url = spec.address;
  }
  TransferRequest& transfer = request.transfer;
  transfer.url = Secret(UrlOf(request.url));
  transfer.origin = OriginOf(request.url);
  transfer.max_per_origin = options_.max_requests_per_host;
  transfer.awaits_multiplexing = !spec.address.is_s3;  // S3 has HTTP/1.1
  transfer.connect_timeout = options_.connect_timeout;
  transfer.head_timeout = options_.head_timeout;
  transfer.stall_timeout = options_.stall_timeout;
  transfer.stall_bytes = options_.stall_bytes;
  transfer.ca_file = options_.ca_file;
  transfer.proxy = options_.proxy;
  AddHeader("User-Agent", "isoscope", &transfer);
  AddHeader("Accept-Encoding", "identity", &transfer);  // bytes as they are stored
  if (!spec.range.empty()) {
    AddHeader("Range", spec.range, &transfer);
  }
  if (!spec.if_match.empty()) {
    AddHeader("If-Match", spec.if_match, &transfer);
  }
  if (!spec.allows_credentials) {
    return request;
  }
  if (!spec.address.is_s3) {
    ISOSCOPE_RETURN_IF_ERROR(AddHttpCredentials(&request));
  } else if (options_.s3.credentials.has_value()) {
    // An endpoint of one's own has a region that means nothing, but a signature needs one.
    AddSignature(spec, request.url, region.empty() ? kDefaultRegion : region,
                 *options_.s3.credentials, &transfer);
    request.credentials = PreparedRequest::Credentials::kSignature;
  }
  return request;
}

}  // namespace isoscope::source
