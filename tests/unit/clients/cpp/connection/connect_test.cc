#include "clients/cpp/connection/connect.h"

#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/io/atomic_file.h"
#include "isoscope/v1/dataset.pb.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::client {
namespace {

using isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(ConnectTest, WhatCanNotWorkIsRefusedAtOnce) {
  const auto refused = [](absl::string_view why) {
    return StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(std::string(why)));
  };
  EXPECT_THAT(Connect({.address = "nowhere:"}), refused("nowhere"));
  EXPECT_THAT(Connect({.address = "localhost:1", .transport = {.key_file = "a.key"}}),
              refused("belong together"));
  EXPECT_THAT(Connect({.address = "localhost:1", .token = "a", .token_file = "b"}),
              refused("exclude each other"));
  EXPECT_THAT(Connect({.address = "localhost:1", .token = "se cret"}),
              AllOf(refused("token"), Not(refused("se cret"))));
  EXPECT_THAT(Connect({.address = "localhost:1", .transport = {.ca_file = "/nowhere.pem"}}),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("/nowhere.pem")));
  EXPECT_THAT(Connect({.address = "localhost:1", .token_file = "/nowhere.token"}),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("/nowhere.token")));
}

TEST(ConnectTest, TokensLeaveThisMachineNotInPlaintext) {
  const testing::TempDir folder;
  const std::string file = folder.Sub("token");
  ISOSCOPE_ASSERT_OK(io::WriteFileAtomically(file, "secret\n"));
  for (const ConnectOptions& options :
       {ConnectOptions{.address = "example.org:1", .token = "secret"},
        ConnectOptions{.address = "example.org:1", .token_file = file}}) {
    EXPECT_THAT(Connect(options),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         AllOf(HasSubstr("example.org:1"), Not(HasSubstr("secret")))));
  }
  ISOSCOPE_EXPECT_OK(
      Connect({.address = "example.org:1", .transport = {.is_insecure = true}, .token_file = file})
          .status());
  ISOSCOPE_EXPECT_OK(Connect({.address = "127.0.0.1:1", .token_file = file}).status());
  EXPECT_TRUE(MaySendToken({.ca_file = "ca.pem"}, "example.org:1"));
}

TEST(ConnectTest, AServerThatIsNotThereIsAnErrorOfTheFirstCall) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto client, Connect({.address = "127.0.0.1:1"}));
  EXPECT_THAT(client->GetDataset("", absl::Seconds(10)),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr("127.0.0.1:1")));
  cli::Interrupt interrupt;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto interrupted,
                                Connect({.address = "127.0.0.1:1"}, &interrupt));
  interrupt.Trigger();
  EXPECT_THAT(interrupted->GetDataset("", absl::Seconds(10)),
              StatusIs(absl::StatusCode::kCancelled));
}

}  // namespace
}  // namespace isoscope::client
