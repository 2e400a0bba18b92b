// Swaps the byte order of samples.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_BYTE_ORDER_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_BYTE_ORDER_H_

#include <cstddef>

namespace isoscope::source {

// Reverses the bytes of each of `count` samples of `sample_size` (1, 2, 4 or 8) bytes, in place.
void SwapBytes(std::size_t sample_size, std::size_t count, char* samples);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_BYTE_ORDER_H_
