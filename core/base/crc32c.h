// CRC-32C (Castagnoli; RFC 3720, appendix B.4), the checksum of every file and page.

#ifndef ISOSCOPE_CORE_BASE_CRC32C_H_
#define ISOSCOPE_CORE_BASE_CRC32C_H_

#include <cstddef>
#include <cstdint>

#include "absl/strings/string_view.h"

namespace isoscope::base {

// Extends `crc`, the CRC-32C of the bytes so far (0 for none), by `data[0, size)`. Hardware
// instructions where the processor has them. Thread-safe.
std::uint32_t ExtendCrc32c(std::uint32_t crc, const void* data, std::size_t size);

inline std::uint32_t Crc32c(absl::string_view bytes) {
  return ExtendCrc32c(0, bytes.data(), bytes.size());
}

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_CRC32C_H_
