#include "rpc/peer.h"

#include <string>

#include "gtest/gtest.h"

#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::rpc {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::IsOk;
using ::testing::Not;
using testing::StatusIs;

TEST(PeerTest, RolesAreTheUrisWithOurPrefix) {
  EXPECT_THAT(
      RolesOf({"spiffe://x/y", "isoscope:role:agent", "isoscope:role:", "isoscope:role:client"}),
      ElementsAre("agent", "client"));
  // Text in a foreign authority's certificate never breaks a log line.
  EXPECT_THAT(RolesOf({"isoscope:role:a\nb"}), ElementsAre("a\\nb"));
}

TEST(PeerTest, DescriptionsNameWhatCame) {
  EXPECT_THAT(Describe({}), HasSubstr("no certificate"));
  Peer peer;
  peer.has_certificate = true;
  peer.name = "x\n";
  EXPECT_THAT(Describe(peer), HasSubstr("no role"));
  peer.roles = {"client"};
  EXPECT_THAT(Describe(peer), HasSubstr("\"x\\n\", has the role client"));
}

TEST(PeerTest, TokensAreWhatHeadersMayCarry) {
  EXPECT_THAT(CheckTokenText("aZ09-._~+/="), IsOk());
  EXPECT_THAT(CheckTokenText(std::string(kMaxTokenBytes, 'a')), IsOk());
  for (const std::string& token :
       {std::string(), std::string(kMaxTokenBytes + 1, 'a'), std::string("a b"), std::string("a\n"),
        std::string("a\0b", 3), std::string("\xc3\xa9"), std::string("\x7f")}) {
    const absl::Status status = CheckTokenText(token);
    EXPECT_THAT(status, StatusIs(absl::StatusCode::kInvalidArgument));
    if (token.size() > 1) {
      EXPECT_THAT(std::string(status.message()), Not(HasSubstr(token))) << "tokens stay secret";
    }
  }
}

TEST(PeerTest, ATokenFileMayEndInALineFeed) {
  const testing::TempDir folder;
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(folder.Sub("t"), "  secret\n"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string token, ReadTokenFile(folder.Sub("t")));
  EXPECT_EQ(token, "secret");
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(folder.Sub("u"), "two words\n"));
  EXPECT_THAT(ReadTokenFile(folder.Sub("u")),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(folder.Sub("u"))));
  EXPECT_THAT(ReadTokenFile(folder.Sub("absent")), StatusIs(absl::StatusCode::kNotFound));
}

}  // namespace
}  // namespace isoscope::rpc
