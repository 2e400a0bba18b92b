#include "core/source/remote/address.h"

#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using testing::StatusIs;

TEST(AddressTest, ParsesHttp) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Address plain,
                                ParseAddress("https://Data.Example.org/a/b c.nii.gz"));
  EXPECT_EQ(
      plain,
      (Address{
          .is_https = true, .host = "data.example.org", .port = 443, .path = "/a/b%20c.nii.gz"}));
  EXPECT_EQ(UrlOf(plain), "https://data.example.org/a/b%20c.nii.gz");
  EXPECT_EQ(LastPartOf(plain), "b c.nii.gz");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Address port,
                                ParseAddress("HTTP://[::1]:8080/%C3%A9?a=1&sig=x"));
  EXPECT_EQ(port, (Address{.is_https = false,
                           .host = "[::1]",
                           .port = 8080,
                           .path = "/%C3%A9",
                           .query = "a=1&sig=x"}));
  EXPECT_EQ(OriginOf(port), "http://[::1]:8080");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Address bare, ParseAddress("http://h:80"));
  EXPECT_EQ(UrlOf(bare), "http://h/");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Address unicode, ParseAddress("http://h/\xC3\xA9"));
  EXPECT_EQ(unicode.path, "/%C3%A9");
}

TEST(AddressTest, ParsesS3) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Address object, ParseAddress("s3://my-bucket/a/b=c +%?#.x"));
  EXPECT_EQ(object, (Address{.is_s3 = true, .bucket = "my-bucket", .key = "a/b=c +%?#.x"}));
  EXPECT_EQ(NameOf(object), "s3://my-bucket/a/b=c +%?#.x");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Address bucket, ParseAddress("s3://my-bucket"));
  EXPECT_EQ(bucket.key, "");
}

TEST(AddressTest, RefusesByName) {
  const struct {
    const char* text;
    const char* reason;
  } rows[] = {
      {"/a/b", "no scheme"},
      {"C:/a", "no scheme"},
      {"file:///etc/passwd", "local file"},
      {"ftp://h/a", "unknown scheme"},
      {"gs://bucket/a", "unknown scheme"},
      {"https://user:pass@h/a", "user name or a password"},
      {"https://user@h/a", "user name or a password"},
      {"https:///a", "no host name"},
      {"https://h%41/a", "no host name"},
      {"https://h\xC3\xA9/a", "no host name"},
      {"https://h:/a", "port"},
      {"https://h:0/a", "port"},
      {"https://h:65536/a", "port"},
      {"https://h:12x/a", "port"},
      {"https://[::1/a", "no host name"},
      {"https://[::1]x/a", "no host name"},
      {"https://h/a#b", "fragment"},
      {"https://h/a%2", "no %XX"},
      {"https://h/a?b=%zz", "no %XX"},
      {"https://h/a/../b", "\"..\""},
      {"https://h/a/%2e%2E/b", "\"..\""},
      {"https://h/a/.", "\"..\""},
      {"https://h/a%2f..", "\"..\""},
      {"https://h/a\nHost: b", "control character"},
      {"https://h/a%0d%0ab", "control character"},
      {"s3://", "no bucket"},
      {"s3://ab/c", "no bucket"},
      {"s3://a..b/c", "no bucket"},
      {"s3://bucket/../c", "\"..\""},
  };
  for (const auto& row : rows) {
    EXPECT_THAT(ParseAddress(row.text),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(row.reason)))
        << row.text;
  }
  EXPECT_THAT(ParseAddress("https://h/" + std::string(10000, 'a')),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("at most 8192")));
}

TEST(AddressTest, NoSecretIsShown) {
  const char* const kSecret = "S3cr3tValue";
  for (const char* const text :
       {"https://me:S3cr3tValue@h/a", "https://me:pa/S3cr3tValue@h/a", "https://S3cr3tValue@h:x/a",
        "ftp://me:S3cr3tValue@h/a", "me:S3cr3tValue@h/a", "s3://KEY:S3cr3tValue@bucket/a",
        "s3://KEY:a/S3cr3tValue@bucket/a", "https://h/a?X-Amz-Signature=S3cr3tValue#x",
        "https://h/a?sig=S3cr3tValue&b=%z", "https://h:x/a?access_token=S3cr3tValue",
        "https://h/..?b=1&api_key=S3cr3tValue", "https://h/a?Password=S3cr3tValue%",
        "https://h/a%?b=S3cr3tValueS3cr3tValueS3cr3tValueS3cr3tValueS3cr3tValue",
        "https://h/a%?S3cr3tValueS3cr3tValue", "//me:S3cr3tValue@h/a"}) {
    const auto parsed = ParseAddress(text);
    ASSERT_FALSE(parsed.ok()) << text;
    EXPECT_THAT(std::string(parsed.status().message()), Not(HasSubstr(kSecret)));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const Address address,
      ParseAddress("https://h/a.nrrd?file=b&X-Amz-Signature=S3cr3tValue&token=S3cr3tValue&v=2"));
  EXPECT_EQ(NameOf(address), "https://h/a.nrrd?file=b&X-Amz-Signature=...&token=...&v=2");
  EXPECT_THAT(UrlOf(address), HasSubstr("token=S3cr3tValue"));
}

TEST(AddressTest, ResolvesLocations) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Address from, ParseAddress("https://h:99/a/b?q=1"));
  const auto url = [&](absl::string_view location) {
    const auto next = ResolveLocation(from, location);
    return next.ok() ? UrlOf(*next) : "refused";
  };
  EXPECT_EQ(url("https://o/c"), "https://o/c");
  EXPECT_EQ(url("//o/c"), "https://o/c");
  EXPECT_EQ(url("/c?d"), "https://h:99/c?d");
  EXPECT_EQ(url("c"), "https://h:99/a/c");
  EXPECT_EQ(url("?d"), "https://h:99/a/b?d");
  EXPECT_EQ(url("../c"), "refused");
  EXPECT_EQ(url("file:///etc/passwd"), "refused");
  EXPECT_EQ(url("https://u:p@o/c"), "refused");
}

TEST(AddressTest, KeysGoBelowAPrefix) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Address http, ParseAddress("https://h/z.zarr/?sig=1"));
  EXPECT_EQ(UrlOf(AddressBelow(http, "c/0 +=/\xC3\xA9%?")),
            "https://h/z.zarr/c/0%20%2B%3D/%C3%A9%25%3F?sig=1");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Address s3, ParseAddress("s3://bucket/z.zarr"));
  EXPECT_EQ(AddressBelow(s3, "c/0").key, "z.zarr/c/0");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Address bucket, ParseAddress("s3://bucket/"));
  EXPECT_EQ(AddressBelow(bucket, "c/0").key, "c/0");
}

TEST(AddressTest, KnowsAddressesAndLoopback) {
  for (const char* const text : {"http://h", "S3://b", "gs://b", "a+b.c-1://x"}) {
    EXPECT_TRUE(IsAddress(text)) << text;
  }
  for (const char* const text : {"/a://b", "a:b", "1a://b", "", "://", "a b://c", "./http://x"}) {
    EXPECT_FALSE(IsAddress(text)) << text;
  }
  for (const char* const host : {"localhost", "127.0.0.1", "127.255.0.9", "[::1]"}) {
    EXPECT_TRUE(IsLoopback(host)) << host;
  }
  for (const char* const host : {"127.0.0.1.example.org", "127.evil.com.x", "128.0.0.1",
                                 "localhost.x", "[::2]", "127.0.0"}) {
    EXPECT_FALSE(IsLoopback(host)) << host;
  }
}

}  // namespace
}  // namespace isoscope::source
