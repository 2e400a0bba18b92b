#include "core/source/remote/remote_options.h"

#include <map>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/folder_test.h"
#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::StatusIs;

class RemoteOptionsTest : public testing::FolderTest {
 protected:
  RemoteOptionsTest() { variables_["HOME"] = dir_.path(); }

  absl::StatusOr<RemoteOptions> Options() {
    return RemoteOptionsFrom([this](const char* name) {
      const auto found = variables_.find(name);
      return found == variables_.end() ? nullptr : found->second.c_str();
    });
  }

  std::map<std::string, std::string> variables_;
};

TEST_F(RemoteOptionsTest, NothingIsSet) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RemoteOptions options, Options());
  ISOSCOPE_EXPECT_OK(options.s3.problem);
  EXPECT_FALSE(options.s3.credentials.has_value());
  EXPECT_EQ(options.s3.region, "");
  EXPECT_EQ(options.netrc_file, "");
  EXPECT_EQ(options.bearer.origin, "");
  EXPECT_EQ(options.proxy, std::nullopt);
}

TEST_F(RemoteOptionsTest, VariablesWinOverTheProfile) {
  Write(".aws/config", "[default]\nregion=eu-west-1\nendpoint_url=https://a:1\n");
  Write(".aws/credentials", "[default]\naws_access_key_id=FILE\naws_secret_access_key=s\n");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(RemoteOptions options, Options());
  EXPECT_EQ(options.s3.credentials->access_key_id, "FILE");
  EXPECT_EQ(options.s3.region, "eu-west-1");
  EXPECT_EQ(options.s3.endpoint, "https://a:1");
  variables_["AWS_ACCESS_KEY_ID"] = "VARIABLE";
  variables_["AWS_SECRET_ACCESS_KEY"] = "t";
  variables_["AWS_SESSION_TOKEN"] = "u";
  variables_["AWS_DEFAULT_REGION"] = "eu-west-2";
  variables_["AWS_ENDPOINT_URL"] = "http://b";
  variables_["ISOSCOPE_S3_ADDRESSING"] = "virtual";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(options, Options());
  EXPECT_EQ(options.s3.credentials->access_key_id, "VARIABLE");
  EXPECT_EQ(options.s3.credentials->session_token.Reveal(), "u");
  EXPECT_EQ(options.s3.region, "eu-west-2");
  EXPECT_EQ(options.s3.endpoint, "http://b");
  EXPECT_EQ(options.s3.addressing, S3Options::Addressing::kVirtual);
  variables_["AWS_REGION"] = "eu-west-3";
  variables_["AWS_ENDPOINT_URL_S3"] = "https://c:443/";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(options, Options());
  EXPECT_EQ(options.s3.region, "eu-west-3");
  EXPECT_EQ(options.s3.endpoint, "https://c");
  variables_["ISOSCOPE_S3_ANONYMOUS"] = "1";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(options, Options());
  EXPECT_FALSE(options.s3.credentials.has_value());
}

TEST_F(RemoteOptionsTest, NamedProfilesAndFiles) {
  variables_["AWS_PROFILE"] = "lab";
  variables_["AWS_CONFIG_FILE"] = Write("c", "[profile lab]\ns3=\n  addressing_style=path\n");
  variables_["AWS_SHARED_CREDENTIALS_FILE"] =
      Write("k", "[lab]\naws_access_key_id=LAB\naws_secret_access_key=s\n");
  variables_["NETRC"] = "/n";
  variables_["CURL_CA_BUNDLE"] = "/curl";
  variables_["SSL_CERT_FILE"] = "/ssl";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(RemoteOptions options, Options());
  EXPECT_EQ(options.s3.credentials->access_key_id, "LAB");
  EXPECT_EQ(options.s3.addressing, S3Options::Addressing::kPath);
  EXPECT_EQ(options.netrc_file, "/n");
  EXPECT_EQ(options.ca_file, "/curl");
  variables_["AWS_PROFILE"] = "other";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(options, Options());
  EXPECT_THAT(options.s3.problem,
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("no profile \"other\"")));
}

TEST_F(RemoteOptionsTest, FaultsOfS3StayWithS3) {
  const auto problem = [this] {
    const auto options = Options();
    return options.ok() ? options->s3.problem : absl::UnknownError("no options");
  };
  variables_["AWS_ACCESS_KEY_ID"] = "A";
  EXPECT_THAT(problem(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("is missing")));
  variables_["AWS_SECRET_ACCESS_KEY"] = "s";
  variables_["AWS_SESSION_TOKEN"] = "S3cr3t\nX: y";
  EXPECT_THAT(problem(), StatusIs(absl::StatusCode::kInvalidArgument, Not(HasSubstr("S3cr3t"))));
  variables_["AWS_SESSION_TOKEN"] = "";
  variables_["AWS_REGION"] = "evil.org/";
  EXPECT_THAT(problem(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("AWS_REGION")));
  variables_["AWS_REGION"] = "";
  variables_["AWS_ENDPOINT_URL"] = "https://u:S3cr3t@h";
  EXPECT_THAT(problem(), StatusIs(absl::StatusCode::kInvalidArgument,
                                  AllOf(HasSubstr("AWS_ENDPOINT_URL"), Not(HasSubstr("S3cr3t")))));
  variables_["AWS_ENDPOINT_URL"] = "https://h/path";
  EXPECT_THAT(problem(), StatusIs(absl::StatusCode::kInvalidArgument));
  variables_["AWS_ENDPOINT_URL"] = "";
  variables_["ISOSCOPE_S3_ANONYMOUS"] = "maybe";
  EXPECT_THAT(problem(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("0 or 1")));
  variables_.clear();
  variables_["HOME"] = dir_.path();
  Write(".aws/config", "[default]\nsso_start_url=https://x\n");
  EXPECT_THAT(problem(),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("export-credentials")));
}

TEST_F(RemoteOptionsTest, ATokenHasAnOrigin) {
  variables_["ISOSCOPE_BEARER_TOKEN"] = "S3cr3t";
  EXPECT_THAT(Options(), StatusIs(absl::StatusCode::kInvalidArgument,
                                  AllOf(HasSubstr("TOKEN_ORIGIN"), Not(HasSubstr("S3cr3t")))));
  variables_["ISOSCOPE_BEARER_TOKEN_ORIGIN"] = "https://h:8443";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RemoteOptions options, Options());
  EXPECT_EQ(options.bearer.origin, "https://h:8443");
  variables_["ISOSCOPE_BEARER_TOKEN_ORIGIN"] = "http://127.0.0.1:1";
  ISOSCOPE_EXPECT_OK(Options());
  variables_["ISOSCOPE_BEARER_TOKEN_ORIGIN"] = "http://h";
  EXPECT_THAT(Options(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("https://")));
  variables_["ISOSCOPE_BEARER_TOKEN_ORIGIN"] = "https://h";
  variables_["ISOSCOPE_BEARER_TOKEN_FILE"] = "/f";
  EXPECT_THAT(Options(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("both set")));
  variables_.erase("ISOSCOPE_BEARER_TOKEN_FILE");
  variables_["ISOSCOPE_BEARER_TOKEN"] = "S3cr3t\r\nX: y";
  EXPECT_THAT(Options(), StatusIs(absl::StatusCode::kInvalidArgument, Not(HasSubstr("S3cr3t"))));
}

}  // namespace
}  // namespace isoscope::source
