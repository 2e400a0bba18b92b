// AWS Signature Version 4: requests that show the knowledge of a secret key without sending it.
//
//   canonical request   method, path, query, headers, hash of the body, one a line
//   string to sign      the algorithm, the time, the scope, the hash of the canonical request
//   signature           HMAC-SHA256 of it by a key made of secret, day, region and service
//
// Source: AWS, "Signature Version 4 signing process",
// https://docs.aws.amazon.com/AmazonS3/latest/API/sig-v4-header-based-auth.html.

#ifndef ISOSCOPE_CORE_SOURCE_REMOTE_SIGV4_H_
#define ISOSCOPE_CORE_SOURCE_REMOTE_SIGV4_H_

#include <string>
#include <utility>
#include <vector>

#include "core/source/remote/secret.h"

namespace isoscope::source {

struct AwsCredentials {
  std::string access_key_id;  // no secret, but no message shows it
  Secret secret_access_key;
  Secret session_token = {};  // of temporary credentials; else empty
};

// The hash of no bytes: the body of GET and HEAD.
inline constexpr char kEmptyPayloadHash[] =
    "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";

struct RequestToSign {
  std::string method;
  std::string path;                                             // percent-encoded; begins with '/'
  std::vector<std::pair<std::string, std::string>> query = {};  // not encoded
  // All are signed. Names in any case; "host" and "x-amz-date" must be among them, and of S3
  // "x-amz-content-sha256".
  std::vector<std::pair<std::string, std::string>> headers = {};
  std::string payload_hash = kEmptyPayloadHash;
};

struct SigningScope {
  std::string timestamp;  // "20130524T000000Z"
  std::string region;     // "us-east-1"
  std::string service = "s3";
};

// The query as it is signed and sent: names and values encoded, then sorted.
std::string CanonicalQuery(const std::vector<std::pair<std::string, std::string>>& query);

// Returns the value of the header Authorization. REQUIRES: the timestamp has 16 letters.
Secret SignRequest(const RequestToSign& request, const SigningScope& scope,
                   const AwsCredentials& credentials);

// For tests.
std::string CanonicalRequest(const RequestToSign& request);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_REMOTE_SIGV4_H_
