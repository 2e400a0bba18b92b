#ifndef ISOSCOPE_CORE_BASE_SHA256_H_
#define ISOSCOPE_CORE_BASE_SHA256_H_

#include <string>

#include "absl/strings/string_view.h"

namespace isoscope::base {

// Returns the SHA-256 of `bytes` (FIPS 180-4) as 64 lower-case hexadecimal digits. Thread-safe.
std::string Sha256Hex(absl::string_view bytes);

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_SHA256_H_
