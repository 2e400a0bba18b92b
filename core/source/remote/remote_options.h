// How addresses are read: waits, retries, credentials. RemoteOptionsFromEnvironment says which
// variables and files decide it.

#ifndef ISOSCOPE_CORE_SOURCE_REMOTE_REMOTE_OPTIONS_H_
#define ISOSCOPE_CORE_SOURCE_REMOTE_REMOTE_OPTIONS_H_

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "core/base/units.h"
#include "core/source/remote/range_plan.h"
#include "core/source/remote/retry_policy.h"
#include "core/source/remote/secret.h"
#include "core/source/remote/sigv4.h"

namespace isoscope::source {

struct S3Options {
  // None: requests are not signed, which public buckets allow.
  std::optional<AwsCredentials> credentials = {};
  std::string region = {};    // empty: the bucket's own, as AWS tells it
  std::string endpoint = {};  // "https://host[:port]"; empty: AWS's own
  // Where the bucket's name stands: in the path, or before the host's name. Automatic: of AWS before
  // the host, unless it has a '.', which certificates do not cover; of other endpoints in the path.
  enum class Addressing { kAutomatic, kPath, kVirtual };
  Addressing addressing = Addressing::kAutomatic;
  // Why nothing of S3 can be read: a broken ~/.aws/config. Other addresses do not mind.
  absl::Status problem = {};
};

// A token of OAuth or of a service, sent as `Authorization: Bearer` to one origin only. A file is
// read again at each use, because tokens expire.
struct BearerToken {
  std::string origin;  // "https://host[:port]", as OriginOf; empty: there is no token
  Secret token = {};
  std::string file = {};  // instead of `token`
};

struct RemoteOptions {
  RetryRules retry;
  // A gap costs less than a round trip; a piece lasts seconds, so that one that breaks off is cheap,
  // and some of them fill a fast line.
  RangeRules ranges = {.max_gap_bytes = 256 * base::kKiB, .max_piece_bytes = 8 * base::kMiB};
  int max_requests_per_host = 32;  // at a time; all others wait

  absl::Duration connect_timeout = absl::Seconds(10);  // until TLS is there
  absl::Duration head_timeout = absl::Seconds(60);     // from the request to the end of the headers
  // A body that brings fewer than stall_bytes in stall_timeout is broken off, and retried.
  absl::Duration stall_timeout = absl::Seconds(30);
  std::int64_t stall_bytes = 4 * base::kKiB;

  // Redirects to other hosts are followed where a request has no credentials. False: never.
  bool follows_to_other_hosts = true;

  std::string ca_file;               // PEM; empty: the system's authorities
  std::optional<std::string> proxy;  // none: http_proxy, https_proxy, no_proxy; empty: no proxy
  BearerToken bearer;
  std::string netrc_file;  // empty: none
  S3Options s3;
};

// Options of the environment of this process:
//
//   ISOSCOPE_BEARER_TOKEN, ISOSCOPE_BEARER_TOKEN_FILE   a token, or a file that holds one
//   ISOSCOPE_BEARER_TOKEN_ORIGIN                        https://host[:port] that may see it: needed
//   NETRC, else ~/.netrc                                user names and passwords by host
//   ISOSCOPE_CA_FILE, AWS_CA_BUNDLE, CURL_CA_BUNDLE, SSL_CERT_FILE   authorities; the first one set
//   http_proxy, https_proxy, all_proxy, no_proxy        as curl reads them
//   AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN
//   AWS_PROFILE (or AWS_DEFAULT_PROFILE), AWS_CONFIG_FILE, AWS_SHARED_CREDENTIALS_FILE
//   AWS_REGION, AWS_DEFAULT_REGION, AWS_ENDPOINT_URL_S3, AWS_ENDPOINT_URL
//   ISOSCOPE_S3_ANONYMOUS=1      no signatures, whatever credentials there are
//   ISOSCOPE_S3_ADDRESSING       path or virtual
//
// Variables win over the profile, as in AWS's tools. Tokens and passwords go over https only, or to
// this machine. INVALID_ARGUMENT names a variable that is wrong, and no secret. What is wrong with S3
// is s3.problem.
absl::StatusOr<RemoteOptions> RemoteOptionsFromEnvironment();
// The same of other variables: `get` returns null for one that is not set.
using EnvironmentFunction = std::function<const char*(const char* name)>;
absl::StatusOr<RemoteOptions> RemoteOptionsFrom(const EnvironmentFunction& get);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_REMOTE_REMOTE_OPTIONS_H_
