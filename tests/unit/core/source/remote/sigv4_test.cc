// Published examples: AWS, "Signature calculations for the authorization header", of S3, and AWS's
// test suite of Signature Version 4.

#include "core/source/remote/sigv4.h"

#include <string>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::source {
namespace {

using ::testing::EndsWith;

// The keys of the documents, which open nothing.
const AwsCredentials& ExampleOfS3() {
  static const AwsCredentials credentials{
      .access_key_id = "AKIAIOSFODNN7EXAMPLE",
      .secret_access_key = Secret("wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY")};
  return credentials;
}

const AwsCredentials& ExampleOfSuite() {
  static const AwsCredentials credentials{
      .access_key_id = "AKIDEXAMPLE",
      .secret_access_key = Secret("wJalrXUtnFEMI/K7MDENG+bPxRfiCYEXAMPLEKEY")};
  return credentials;
}

RequestToSign RequestOfS3() {
  return {.method = "GET",
          .path = "/",
          .headers = {{"Host", "examplebucket.s3.amazonaws.com"},
                      {"x-amz-content-sha256", kEmptyPayloadHash},
                      {"x-amz-date", "20130524T000000Z"}}};
}

std::string SignS3(const RequestToSign& request) {
  return SignRequest(request, {.timestamp = "20130524T000000Z", .region = "us-east-1"},
                     ExampleOfS3())
      .Reveal();
}

TEST(SigV4Test, SignsAnObjectsRange) {
  RequestToSign request = RequestOfS3();
  request.path = "/test.txt";
  request.headers.emplace_back("Range", "bytes=0-9");
  EXPECT_EQ(CanonicalRequest(request),
            "GET\n/test.txt\n\n"
            "host:examplebucket.s3.amazonaws.com\n"
            "range:bytes=0-9\n"
            "x-amz-content-sha256:"
            "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855\n"
            "x-amz-date:20130524T000000Z\n\n"
            "host;range;x-amz-content-sha256;x-amz-date\n"
            "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(SignS3(request),
            "AWS4-HMAC-SHA256 Credential=AKIAIOSFODNN7EXAMPLE/20130524/us-east-1/s3/aws4_request,"
            "SignedHeaders=host;range;x-amz-content-sha256;x-amz-date,"
            "Signature=f0e8bdb87c964420e857bd35b5d6ed310bd44f0170aba48dd91039c6036bdb41");
}

TEST(SigV4Test, SignsQueries) {
  RequestToSign request = RequestOfS3();
  request.query = {{"lifecycle", ""}};
  EXPECT_THAT(SignS3(request),
              EndsWith("Signature=fea454ca298b7da1c68078a5d1bdbfbbe0d65c699e0f91ac7"
                       "a200a0136783543"));
  request.query = {{"prefix", "J"}, {"max-keys", "2"}};
  EXPECT_EQ(CanonicalQuery(request.query), "max-keys=2&prefix=J");
  EXPECT_THAT(SignS3(request),
              EndsWith("Signature=34b48302e7b5fa45bde8084f4b7868a86f0a534bc59db6670"
                       "ed5711ef69dc6f7"));
}

TEST(SigV4Test, SignsABody) {
  const RequestToSign request{
      .method = "PUT",
      .path = "/test%24file.text",
      .headers = {{"Date", "Fri, 24 May 2013 00:00:00 GMT"},
                  {"Host", "examplebucket.s3.amazonaws.com"},
                  {"x-amz-content-sha256",
                   "44ce7dd67c959e0d3524ffac1771dfbba87d2b6b4b4e99e42034a8b803f8b072"},
                  {"x-amz-date", "20130524T000000Z"},
                  {"x-amz-storage-class", "REDUCED_REDUNDANCY"}},
      .payload_hash = "44ce7dd67c959e0d3524ffac1771dfbba87d2b6b4b4e99e42034a8b803f8b072"};
  EXPECT_THAT(SignS3(request),
              EndsWith("Signature=98ad721746da40c64f1a55b78f14c238d841ea1380cd77a1b"
                       "5971af0ece108bd"));
}

TEST(SigV4Test, AgreesWithTheSuite) {
  const struct {
    const char* path;
    std::vector<std::pair<std::string, std::string>> query;
    const char* signature;
  } rows[] = {
      {"/", {}, "5fa00fa31553b73ebf1942676e86291e8372ff2a2260956d9b8aae1d763fbf31"},
      {"/",
       {{"Param2", "value2"}, {"Param1", "value1"}},
       "b97d918cfa904a5beff61c982a1b6f458b799221646efd99d3219ec94cdf2500"},
      {"/-._~0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz",
       {},
       "07ef7494c76fa4850883e2b006601f940f8a34d404d0cfa977f52a65bbf5f24f"},
      {"/%E1%88%B4", {}, "8318018e0b0f223aa2bbf98705b62bb787dc9c0e678f255a891fd03141be5d85"},
  };
  for (const auto& row : rows) {
    const RequestToSign request{
        .method = "GET",
        .path = row.path,
        .query = row.query,
        .headers = {{"Host", "example.amazonaws.com"}, {"X-Amz-Date", "20150830T123600Z"}}};
    EXPECT_THAT(
        SignRequest(request,
                    {.timestamp = "20150830T123600Z", .region = "us-east-1", .service = "service"},
                    ExampleOfSuite())
            .Reveal(),
        EndsWith(absl::StrCat("Signature=", row.signature)))
        << row.path;
  }
}

// RFC 3986 in capitals; sorted after encoding: '=' (%3D) comes before letters, but '~' behind them.
TEST(SigV4Test, EncodesBeforeItSorts) {
  EXPECT_EQ(
      CanonicalQuery({{"a~", "1"}, {"a b", "+/="}, {"a", "\xC3\xA9"}, {"a", "%"}, {"a=", ""}}),
      "a=%25&a=%C3%A9&a%20b=%2B%2F%3D&a%3D=&a~=1");
}

TEST(SigV4Test, HeadersAreTrimmedAndSorted) {
  RequestToSign request = RequestOfS3();
  request.headers.emplace_back("My-Header1", "   a   b   c  ");
  EXPECT_THAT(CanonicalRequest(request), ::testing::HasSubstr("\nmy-header1:a b c\nx-amz-"));
}

}  // namespace
}  // namespace isoscope::source
