// CHECK and DCHECK: invariants that the code itself guarantees. They print both operands and abort.
//
// Never for input, network, disk or configuration: those are absl::Status. Spelled as newer abseil
// spells them, with our prefix, so that a later abseil replaces this file.

#ifndef ISOSCOPE_CORE_BASE_CHECK_H_
#define ISOSCOPE_CORE_BASE_CHECK_H_

#include <sstream>
#include <string>

namespace isoscope::base {

// Prints "file:line: CHECK failed: what" to standard error and aborts.
[[noreturn]] void CheckFailed(const char* file, int line, const std::string& what);

template <typename A, typename B>
[[noreturn]] void CheckOpFailed(const char* file, int line, const char* expression, const A& a,
                                const B& b) {
  std::ostringstream out;
  out << expression << " (" << a << " vs. " << b << ")";
  CheckFailed(file, line, out.str());
}

}  // namespace isoscope::base

#define ISOSCOPE_CHECK(condition)                                    \
  do {                                                               \
    if (!(condition)) [[unlikely]] {                                 \
      ::isoscope::base::CheckFailed(__FILE__, __LINE__, #condition); \
    }                                                                \
  } while (false)

#define ISOSCOPE_CHECK_OP_(op, a, b)                                                      \
  do {                                                                                    \
    const auto& isoscope_a_ = (a);                                                        \
    const auto& isoscope_b_ = (b);                                                        \
    if (!(isoscope_a_ op isoscope_b_)) [[unlikely]] {                                     \
      ::isoscope::base::CheckOpFailed(__FILE__, __LINE__, #a " " #op " " #b, isoscope_a_, \
                                      isoscope_b_);                                       \
    }                                                                                     \
  } while (false)

#define ISOSCOPE_CHECK_EQ(a, b) ISOSCOPE_CHECK_OP_(==, a, b)
#define ISOSCOPE_CHECK_NE(a, b) ISOSCOPE_CHECK_OP_(!=, a, b)
#define ISOSCOPE_CHECK_LT(a, b) ISOSCOPE_CHECK_OP_(<, a, b)
#define ISOSCOPE_CHECK_LE(a, b) ISOSCOPE_CHECK_OP_(<=, a, b)
#define ISOSCOPE_CHECK_GT(a, b) ISOSCOPE_CHECK_OP_(>, a, b)
#define ISOSCOPE_CHECK_GE(a, b) ISOSCOPE_CHECK_OP_(>=, a, b)

#ifdef NDEBUG
#define ISOSCOPE_DCHECK(condition) \
  do {                             \
    if (false) {                   \
      ISOSCOPE_CHECK(condition);   \
    }                              \
  } while (false)
#else
#define ISOSCOPE_DCHECK(condition) ISOSCOPE_CHECK(condition)
#endif

#endif  // ISOSCOPE_CORE_BASE_CHECK_H_
