#include "rpc/certificate_watch.h"

#include <cmath>
#include <string>

#include "gtest/gtest.h"

#include "tests/support/certificates.h"
#include "tests/support/status_matchers.h"

namespace isoscope::rpc {
namespace {

TEST(CertificateWatchTest, DaysAreThoseOfTheFileAsItIsNow) {
  const testing::TestAuthority authority;
  const std::string file =
      authority.Issue({.name = "agent", .role = "agent", .days = 2}).certificate_file;
  CertificateWatch watch(file);
  EXPECT_NEAR(watch.DaysLeft(), 2, 0.2);
  authority.Issue({.name = "agent", .role = "agent", .days = 40});
  EXPECT_NEAR(watch.DaysLeft(), 40, 0.2);
  EXPECT_EQ(watch.failures(), 0);
}

TEST(CertificateWatchTest, AFileThatCannotBeReadIsZeroAndCountedOnceUntilItIsBack) {
  const testing::TestAuthority authority;
  const std::string file =
      authority.Issue({.name = "agent", .role = "agent", .days = 2}).certificate_file;
  CertificateWatch watch(file);
  for (int round = 1; round <= 2; ++round) {
    testing::ReplaceFile(file, "no certificate");
    EXPECT_EQ(watch.DaysLeft(), 0);
    EXPECT_EQ(watch.DaysLeft(), 0);
    EXPECT_EQ(watch.failures(), round);
    authority.Issue({.name = "agent", .role = "agent", .days = 2});
    EXPECT_GT(watch.DaysLeft(), 1);
  }
  EXPECT_THAT(CertificateExpiry("/nonexistent"), testing::StatusIs(absl::StatusCode::kNotFound));
}

TEST(CertificateWatchTest, WithoutAFileNothingExpires) {
  CertificateWatch watch("");
  EXPECT_TRUE(std::isinf(watch.DaysLeft()));
  EXPECT_EQ(watch.failures(), 0);
}

}  // namespace
}  // namespace isoscope::rpc
