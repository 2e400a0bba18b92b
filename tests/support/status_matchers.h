// gMock matchers for absl::Status and absl::StatusOr, spelled as upstream spells them.

#ifndef ISOSCOPE_TESTS_SUPPORT_STATUS_MATCHERS_H_
#define ISOSCOPE_TESTS_SUPPORT_STATUS_MATCHERS_H_

#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "gmock/gmock.h"

namespace isoscope::testing {

inline const absl::Status& GetStatus(const absl::Status& status) { return status; }
template <typename T>
const absl::Status& GetStatus(const absl::StatusOr<T>& result) {
  return result.status();
}

MATCHER(IsOk, "is OK") {
  const absl::Status& status = GetStatus(arg);
  *result_listener << "whose status is " << status.ToString();
  return status.ok();
}

// The code, and a matcher on the message.
MATCHER_P2(StatusIs, code, message_matcher,
           "has code " + absl::StatusCodeToString(code) + " and a message that " +
               ::testing::DescribeMatcher<std::string>(message_matcher, negation)) {
  const absl::Status& status = GetStatus(arg);
  *result_listener << "whose status is " << status.ToString();
  return status.code() == code &&
         ::testing::ExplainMatchResult(message_matcher, std::string(status.message()),
                                       result_listener);
}
inline auto StatusIs(absl::StatusCode code) { return StatusIs(code, ::testing::_); }

}  // namespace isoscope::testing

#define ISOSCOPE_ASSERT_OK(expression) ASSERT_THAT(expression, ::isoscope::testing::IsOk())
#define ISOSCOPE_EXPECT_OK(expression) EXPECT_THAT(expression, ::isoscope::testing::IsOk())

// ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto value, MakeValue());
#define ISOSCOPE_ASSERT_OK_AND_ASSIGN(declaration, expression)                            \
  ISOSCOPE_ASSERT_OK_AND_ASSIGN_(ISOSCOPE_TEST_CONCAT_(statusor_, __LINE__), declaration, \
                                 expression)
#define ISOSCOPE_TEST_CONCAT_INNER_(a, b) a##b
#define ISOSCOPE_TEST_CONCAT_(a, b) ISOSCOPE_TEST_CONCAT_INNER_(a, b)
// NOLINTBEGIN(bugprone-macro-parentheses): a name and a declaration have none
#define ISOSCOPE_ASSERT_OK_AND_ASSIGN_(statusor, declaration, expression) \
  auto statusor = (expression);                                           \
  ASSERT_THAT(statusor, ::isoscope::testing::IsOk());                     \
  declaration = *std::move(statusor)
// NOLINTEND(bugprone-macro-parentheses)

#endif  // ISOSCOPE_TESTS_SUPPORT_STATUS_MATCHERS_H_
