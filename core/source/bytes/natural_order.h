// The order of files with numbers in their names.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_NATURAL_ORDER_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_NATURAL_ORDER_H_

#include <string>

namespace isoscope::source {

// "slice9" before "slice10": runs of digits are compared as numbers. A strict order.
bool NaturalLess(const std::string& a, const std::string& b);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_NATURAL_ORDER_H_
