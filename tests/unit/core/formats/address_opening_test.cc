#include "core/formats/address_opening.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>

#include "absl/status/status.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using testing::StatusIs;

constexpr std::size_t kMost = 100;
const ObjectRead kRead{.key = "zarr.json", .max_size = 50};

TEST(AddressOpeningTest, KeepsBytesAndThatNothingIsThere) {
  KeptAnswers kept;
  EXPECT_FALSE(kept.Find("a", kRead).has_value());
  kept.Keep("a", kRead, std::string("{}"), kMost);
  EXPECT_EQ(**kept.Find("a", kRead), "{}");
  EXPECT_FALSE(kept.Find("b", kRead).has_value());
  EXPECT_FALSE(kept.Find("a", {.key = "zarr.json", .offset = 1, .max_size = 50}).has_value());
  EXPECT_FALSE(kept.Find("a", {.key = "zarr.json", .size = 1, .max_size = 50}).has_value());
  // A reader with a limit gets its own error.
  EXPECT_FALSE(kept.Find("a", {.key = "zarr.json", .max_size = 1}).has_value());

  kept.Keep("a", {.key = "none"}, absl::NotFoundError("none"), kMost);
  kept.Keep("a", {.key = "closed"}, absl::PermissionDeniedError("closed"), kMost);
  kept.Keep("a", {.key = "away"}, absl::UnavailableError("away"), kMost);
  EXPECT_THAT(*kept.Find("a", {.key = "none"}), StatusIs(absl::StatusCode::kNotFound));
  EXPECT_THAT(*kept.Find("a", {.key = "closed"}), StatusIs(absl::StatusCode::kPermissionDenied));
  EXPECT_FALSE(kept.Find("a", {.key = "away"}).has_value());
}

TEST(AddressOpeningTest, KeepsWithinItsBounds) {
  KeptAnswers kept;
  const auto is_kept = [&kept](const std::string& key) {
    return kept.Find("a", {.key = key, .max_size = std::int64_t{1} << 40}).has_value();
  };
  kept.Keep("a", {.key = "large"}, std::string(kMost + 1, 'x'), kMost);
  EXPECT_FALSE(is_kept("large"));
  kept.Keep("a", {.key = "first"}, std::string(kMaxKeptAnswerBytes - 10, 'x'), kMaxKeptAnswerBytes);
  kept.Keep("a", {.key = "second"}, std::string(11, 'x'), kMost);
  kept.Keep("a", {.key = "third"}, std::string(10, 'x'), kMost);
  EXPECT_TRUE(is_kept("first"));
  EXPECT_FALSE(is_kept("second"));
  EXPECT_TRUE(is_kept("third"));
}

TEST(AddressOpeningTest, KeepsNothingOnceItHasEnded) {
  EXPECT_EQ(KeptAnswers::OfThread(), nullptr);
  std::shared_ptr<KeptAnswers> kept;
  {
    const AddressOpening opening;
    kept = KeptAnswers::OfThread();
    ASSERT_NE(kept, nullptr);
    kept->Keep("a", kRead, std::string("{}"), kMost);
    {
      const AddressOpening inner;
      EXPECT_EQ(KeptAnswers::OfThread(), kept);
    }
    EXPECT_TRUE(kept->Find("a", kRead).has_value());
    std::thread([] { EXPECT_EQ(KeptAnswers::OfThread(), nullptr); }).join();
  }
  EXPECT_EQ(KeptAnswers::OfThread(), nullptr);
  EXPECT_FALSE(kept->Find("a", kRead).has_value());
  kept->Keep("a", kRead, std::string("{}"), kMost);
  EXPECT_FALSE(kept->Find("a", kRead).has_value());
}

}  // namespace
}  // namespace isoscope::source
