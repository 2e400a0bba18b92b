// ISOSCOPE_RETURN_IF_ERROR and ISOSCOPE_ASSIGN_OR_RETURN, spelled as upstream spells them.

#ifndef ISOSCOPE_CORE_BASE_STATUS_MACROS_H_
#define ISOSCOPE_CORE_BASE_STATUS_MACROS_H_

#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

// Returns the error of `expression`, an absl::Status, from the enclosing function, if it has one.
#define ISOSCOPE_RETURN_IF_ERROR(expression)      \
  do {                                            \
    absl::Status isoscope_status_ = (expression); \
    if (!isoscope_status_.ok()) [[unlikely]] {    \
      return isoscope_status_;                    \
    }                                             \
  } while (false)

// The operands are names and declarations, which can't stand in parentheses.
// NOLINTBEGIN(bugprone-macro-parentheses): see above
// ISOSCOPE_ASSIGN_OR_RETURN(auto value, MakeValue()); returns the error of the StatusOr, if any.
#define ISOSCOPE_ASSIGN_OR_RETURN(declaration, expression)                                \
  ISOSCOPE_ASSIGN_OR_RETURN_(ISOSCOPE_CONCAT_(isoscope_statusor_, __LINE__), declaration, \
                             expression)

#define ISOSCOPE_CONCAT_INNER_(a, b) a##b
#define ISOSCOPE_CONCAT_(a, b) ISOSCOPE_CONCAT_INNER_(a, b)
#define ISOSCOPE_ASSIGN_OR_RETURN_(statusor, declaration, expression) \
  auto statusor = (expression);                                       \
  if (!statusor.ok()) [[unlikely]] {                                  \
    return std::move(statusor).status();                              \
  }                                                                   \
  declaration = *std::move(statusor)
// NOLINTEND(bugprone-macro-parentheses)

#endif  // ISOSCOPE_CORE_BASE_STATUS_MACROS_H_
