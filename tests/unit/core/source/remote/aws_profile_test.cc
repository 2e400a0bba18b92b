#include "core/source/remote/aws_profile.h"

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

using AwsProfileTest = testing::FolderTest;

constexpr char kConfig[] =
    "# a comment\r\n"
    "[default]\r\n"
    "region = eu-central-1\r\n"
    "\n"
    "[profile lab one]\n"
    "Region=us-west-2\n"
    "s3 =\n"
    "    addressing_style = path\n"
    "    max_concurrent_requests = 20\n"
    "endpoint_url = https://s3.lab.example:9000\n"
    "; another\n"
    "[profile \"quoted\"]\n"
    "aws_access_key_id = FROMCONFIG\n";

TEST_F(AwsProfileTest, ParsesSections) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto sections, ParseAwsFile(kConfig, "c"));
  EXPECT_EQ(sections.size(), 3u);
  EXPECT_EQ(sections["default"]["region"], "eu-central-1");
  EXPECT_EQ(sections["lab one"]["region"], "us-west-2");
  EXPECT_EQ(sections["lab one"]["s3.addressing_style"], "path");
  EXPECT_EQ(sections["lab one"]["endpoint_url"], "https://s3.lab.example:9000");
  EXPECT_EQ(sections["quoted"]["aws_access_key_id"], "FROMCONFIG");
}

TEST_F(AwsProfileTest, CredentialsWin) {
  const std::string config = Write("config", kConfig);
  const std::string credentials =
      Write("credentials", "[quoted]\naws_access_key_id=OWN\naws_secret_access_key=a=b+/c\n");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(AwsProfile profile, ReadAwsProfile(config, credentials, "quoted"));
  EXPECT_TRUE(profile.is_found);
  EXPECT_EQ(profile.values["aws_access_key_id"], "OWN");
  EXPECT_EQ(profile.values["aws_secret_access_key"], "a=b+/c");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(profile, ReadAwsProfile(config, "", "none"));
  EXPECT_FALSE(profile.is_found);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(profile, ReadAwsProfile(dir_.Sub("no"), dir_.Sub("no"), "default"));
  EXPECT_FALSE(profile.is_found);
}

TEST_F(AwsProfileTest, FaultsNameTheLineAndNoText) {
  EXPECT_THAT(ParseAwsFile("[a]\nb=1\nS3cr3t\n", "path"),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("path: line 3"), Not(HasSubstr("S3cr3t")))));
  EXPECT_THAT(ParseAwsFile("S3cr3t=1", "path"),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("line 1 stands before"), Not(HasSubstr("S3cr3t")))));
  EXPECT_THAT(ParseAwsFile("[a\n", "path"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("']' is missing")));
  EXPECT_THAT(ReadAwsProfile(Write("large", std::string(1100000, '#')), "", "default"),
              StatusIs(absl::StatusCode::kInvalidArgument));
}

}  // namespace
}  // namespace isoscope::source
