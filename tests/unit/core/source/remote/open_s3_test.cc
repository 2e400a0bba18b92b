// S3 by an endpoint of the test's own: which URL a key has, what is signed, and what errors say. Known
// signatures are in sigv4_test.

#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/base/mutex.h"
#include "core/source/remote/open_address.h"
#include "core/source/remote/remote_client.h"
#include "core/source/remote/transfer_engine.h"
#include "tests/support/scripted_server.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/core/source/remote/remote_test.h"

namespace isoscope::source {
namespace {

using ::testing::AllOf;
using testing::Answer;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::ScriptedServer;
using testing::ServedConnection;
using testing::ServedRequest;
using ::testing::StartsWith;
using testing::StatusIs;

class OpenS3Test : public ::testing::Test {
 protected:
  OpenS3Test()
      : server_([this](const ServedRequest& request, ServedConnection* connection) {
          // A client may have an answer before Send returns: the next one takes another string.
          const std::string answer = GetAnswer();
          if (answer.empty()) {
            testing::ServeObject({.bytes = "0123456789"}, request, connection);
          } else {
            connection->Send(answer);
          }
        }),
        options_(QuickOptions()) {
    options_.s3.endpoint = server_.origin();
    options_.s3.region = "eu-test-1";
    options_.s3.credentials = AwsCredentials{.access_key_id = "AKIDTEST",
                                             .secret_access_key = Secret("S3cr3tKey"),
                                             .session_token = Secret("S3cr3tSession")};
  }

  void SetAnswer(std::string answer) {
    const base::MutexLock lock(&mutex_);
    answer_ = std::move(answer);
  }
  std::string GetAnswer() {
    const base::MutexLock lock(&mutex_);
    return answer_;
  }

  base::Mutex mutex_;
  std::string answer_ ABSL_GUARDED_BY(mutex_);
  ScriptedServer server_;
  RemoteOptions options_;
  base::Cancellation never_;
};

// The signature of a request as the server got it, computed from what it got.
TEST_F(OpenS3Test, SignsWhatItSends) {
  EXPECT_EQ(*ReadAddress("s3://bucket/a b/c=d+e%/\xC3\xA9?#~", options_), "0123456789");
  ASSERT_EQ(server_.request_count(), 2);
  for (const ServedRequest& request : server_.requests()) {
    EXPECT_EQ(request.target, "/bucket/a%20b/c%3Dd%2Be%25/%C3%A9%3F%23~");
    EXPECT_EQ(request.Header("x-amz-security-token"), "S3cr3tSession");
    EXPECT_EQ(request.Header("x-amz-content-sha256"), kEmptyPayloadHash);
    const std::string timestamp = request.Header("x-amz-date");
    RequestToSign seen{.method = request.method, .path = request.target};
    for (const char* const name :
         {"host", "range", "x-amz-content-sha256", "x-amz-date", "x-amz-security-token"}) {
      seen.headers.emplace_back(name, request.Header(name));
    }
    EXPECT_EQ(
        request.Header("authorization"),
        SignRequest(seen, {.timestamp = timestamp, .region = "eu-test-1"}, *options_.s3.credentials)
            .Reveal());
    EXPECT_THAT(request.Header("authorization"),
                AllOf(HasSubstr("SignedHeaders=host;range;x-amz-content-sha256;x-amz-date;"
                                "x-amz-security-token,"),
                      Not(HasSubstr("S3cr3t"))));
  }
}

TEST_F(OpenS3Test, AnonymousRequestsAreNotSigned) {
  options_.s3.credentials.reset();
  EXPECT_EQ(*ReadAddress("s3://bucket/key", options_), "0123456789");
  EXPECT_EQ(server_.requests()[0].Header("authorization"), "");
  EXPECT_EQ(server_.requests()[0].Header("x-amz-date"), "");
}

// Where AWS's own buckets are.
TEST_F(OpenS3Test, UrlsOfBuckets) {
  const auto url = [&](const std::string& bucket, const S3Options& s3) {
    RemoteOptions options = QuickOptions();
    options.s3 = s3;
    RemoteClient client(options, TransferEngine::OfProcess());
    const auto request =
        client.Prepare({.address = {.is_s3 = true, .bucket = bucket, .key = "a/b c"}});
    return request.ok() ? request->transfer.url.Reveal() : request.status().ToString();
  };
  using Addressing = S3Options::Addressing;
  const AwsCredentials credentials{.access_key_id = "A", .secret_access_key = Secret("s")};
  EXPECT_EQ(url("bucket", {}), "https://bucket.s3.amazonaws.com/a/b%20c");
  EXPECT_EQ(url("bucket", {.credentials = credentials}),
            "https://bucket.s3.us-east-1.amazonaws.com/a/b%20c");
  EXPECT_EQ(url("bucket", {.region = "eu-west-1"}),
            "https://bucket.s3.eu-west-1.amazonaws.com/a/b%20c");
  EXPECT_EQ(url("bucket", {.region = "cn-north-1"}),
            "https://bucket.s3.cn-north-1.amazonaws.com.cn/a/b%20c");
  EXPECT_EQ(url("b.c.d", {.region = "eu-west-1"}),
            "https://s3.eu-west-1.amazonaws.com/b.c.d/a/b%20c");
  EXPECT_EQ(url("bucket", {.region = "eu-west-1", .addressing = Addressing::kPath}),
            "https://s3.eu-west-1.amazonaws.com/bucket/a/b%20c");
  EXPECT_EQ(url("bucket", {.endpoint = "http://h:9000"}), "http://h:9000/bucket/a/b%20c");
  EXPECT_EQ(url("bucket", {.endpoint = "http://h:9000", .addressing = Addressing::kVirtual}),
            "http://bucket.h:9000/a/b%20c");
}

TEST_F(OpenS3Test, LearnsTheRegionOfABucket) {
  RemoteOptions options = QuickOptions();
  RemoteClient client(options, TransferEngine::OfProcess());
  EXPECT_TRUE(client.LearnRegion("bucket", "eu-west-1"));
  EXPECT_FALSE(client.LearnRegion("bucket", "eu-west-1"));
  EXPECT_FALSE(client.LearnRegion("bucket", "evil.example/"));
  EXPECT_FALSE(client.LearnRegion("bucket", ""));
  const Address address{.is_s3 = true, .bucket = "bucket", .key = "k"};
  EXPECT_EQ(client.Prepare({.address = address})->transfer.url.Reveal(),
            "https://bucket.s3.eu-west-1.amazonaws.com/k");
  options.s3.endpoint = "http://h";
  RemoteClient with_endpoint(options, TransferEngine::OfProcess());
  EXPECT_FALSE(with_endpoint.LearnRegion("bucket", "eu-west-1"));
}

TEST_F(OpenS3Test, ErrorsSayTheCodeAndNoMore) {
  const auto error = [&](int status, const std::string& headers, const std::string& body) {
    SetAnswer(Answer(status, headers, body));
    return ReadAddress("s3://bucket/key", options_).status();
  };
  const std::string body =
      "<Error><Code>SignatureDoesNotMatch</Code><AWSAccessKeyId>AKIDTEST</AWSAccessKeyId>"
      "<StringToSign>x-amz-security-token:S3cr3tSession</StringToSign></Error>";
  EXPECT_THAT(error(403, "", body),
              StatusIs(absl::StatusCode::kPermissionDenied,
                       AllOf(StartsWith("s3://bucket/key"), HasSubstr("SignatureDoesNotMatch"),
                             HasSubstr("missing objects, too"), Not(HasSubstr("AKIDTEST")),
                             Not(HasSubstr("S3cr3t")))));
  EXPECT_THAT(error(404, "", "<Code>NoSuchKey</Code>"),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("(NoSuchKey)")));
  EXPECT_THAT(error(404, "", "<Code>S3cr3t=word</Code>"),
              StatusIs(absl::StatusCode::kNotFound, Not(HasSubstr("S3cr3t"))));
  EXPECT_THAT(error(301, "Location: http://127.0.0.1:1/\r\n", "<Code>PermanentRedirect</Code>"),
              StatusIs(absl::StatusCode::kPermissionDenied, HasSubstr("AWS_REGION")));
  EXPECT_THAT(error(301, "", ""),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("AWS_REGION")));
}

TEST_F(OpenS3Test, StoresHaveKeysBelowTheirPrefix) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto store, OpenAddressStore("s3://bucket/a/", options_));
  const ObjectRead read{.key = "c/0", .max_size = 100};
  EXPECT_EQ(*store->Read({&read, 1}, never_)[0], "0123456789");
  EXPECT_EQ(server_.requests()[0].target, "/bucket/a/c/0");
  SetAnswer(Answer(403, "", "<Code>AccessDenied</Code>"));
  EXPECT_THAT(store->Read({&read, 1}, never_)[0],
              StatusIs(absl::StatusCode::kPermissionDenied, HasSubstr("AccessDenied")));
}

TEST_F(OpenS3Test, ProblemsOfSettingsAreErrorsOfS3Alone) {
  options_.s3.problem = absl::InvalidArgumentError("/home/x/.aws/config: line 3 has no '='");
  EXPECT_THAT(ReadAddress("s3://bucket/key", options_),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("line 3")));
  // Symptom: "there is no such object", because a file of settings was missing.
  options_.s3.problem = absl::NotFoundError("AWS_PROFILE: there is no profile");
  EXPECT_THAT(ReadAddress("s3://bucket/key", options_),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("AWS_PROFILE")));
  EXPECT_EQ(*ReadAddress(server_.origin() + "/a", options_), "0123456789");
  EXPECT_THAT(ReadAddress("s3://bucket/", QuickOptions()),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("names a bucket")));
}

}  // namespace
}  // namespace isoscope::source
