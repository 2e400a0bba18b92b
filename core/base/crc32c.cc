#include "core/base/crc32c.h"

#include <algorithm>
#include <limits>

#include <isa-l/crc.h>

namespace isoscope::base {

std::uint32_t ExtendCrc32c(std::uint32_t crc, const void* data, std::size_t size) {
  // ISA-L keeps the register uninverted, counts in int, and takes a pointer to non-const that it
  // does not write through.
  auto* bytes = const_cast<unsigned char*>(static_cast<const unsigned char*>(data));
  std::uint32_t state = ~crc;
  while (size > 0) {
    const auto length = static_cast<int>(
        std::min<std::size_t>(size, static_cast<std::size_t>(std::numeric_limits<int>::max())));
    state = crc32_iscsi(bytes, length, state);
    bytes += length;
    size -= static_cast<std::size_t>(length);
  }
  return ~state;
}

}  // namespace isoscope::base
