// An inline function whose copies can be told apart.

#ifndef ISOSCOPE_TESTS_UNIT_SUPPORT_LINK_ORDER_H_
#define ISOSCOPE_TESTS_UNIT_SUPPORT_LINK_ORDER_H_

namespace isoscope::testing {

// Who compiled the copy that the program has: "product" or "test".
[[gnu::noinline]] inline const char* WhoCompiledIt() { return ISOSCOPE_COMPILED_AS; }

// The same, called by the library.
const char* WhoCompiledItForTheProduct();

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_UNIT_SUPPORT_LINK_ORDER_H_
