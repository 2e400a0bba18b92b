#include "web-gateway/known_tokens.h"

#include <string>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "gtest/gtest.h"

#include "core/base/monotonic_time.h"

namespace isoscope::gateway {
namespace {

TEST(KnownTokensTest, ATokenIsKnownFromItsAcceptanceOnForAWhile) {
  KnownTokens tokens;
  const base::MonotonicTime now = base::MonotonicNow();
  EXPECT_FALSE(tokens.Knows("a", now));
  tokens.Learn("a", now);
  EXPECT_TRUE(tokens.Knows("a", now));
  EXPECT_FALSE(tokens.Knows("b", now));
  EXPECT_TRUE(tokens.Knows("a", now + KnownTokens::kMaxAge - absl::Seconds(1)));
  EXPECT_FALSE(tokens.Knows("a", now + KnownTokens::kMaxAge));
  tokens.Learn("a", now + absl::Minutes(5));
  EXPECT_TRUE(tokens.Knows("a", now + KnownTokens::kMaxAge)) << "it was accepted again";
}

TEST(KnownTokensTest, NoTokenIsNeverKnown) {
  KnownTokens tokens;
  tokens.Learn("");
  EXPECT_FALSE(tokens.Knows(""));
}

TEST(KnownTokensTest, TheOldestAreForgotten) {
  KnownTokens tokens;
  const base::MonotonicTime now = base::MonotonicNow();
  for (std::size_t i = 0; i <= KnownTokens::kMaxCount; ++i) {
    tokens.Learn(absl::StrCat(i), now + absl::Milliseconds(i));
  }
  const base::MonotonicTime later = now + absl::Minutes(1);
  EXPECT_FALSE(tokens.Knows("0", later));
  EXPECT_TRUE(tokens.Knows("1", later));
  EXPECT_TRUE(tokens.Knows(absl::StrCat(KnownTokens::kMaxCount), later));
}

}  // namespace
}  // namespace isoscope::gateway
