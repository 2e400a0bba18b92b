// Rows of bits, one for each sample of a block.

#ifndef ISOSCOPE_CORE_EXTRACT_BIT_ROW_H_
#define ISOSCOPE_CORE_EXTRACT_BIT_ROW_H_

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

namespace isoscope::extract {

using BitRow = std::vector<std::uint64_t>;

// Makes `vector` at least `size` elements long. Never shrinks it.
template <typename V>
void Grow(std::size_t size, std::vector<V>* vector) {
  if (vector->size() < size) {
    vector->resize(size);
  }
}

// Returns the bits from `position` on, lowest first. At least 57 of the 64 are valid.
// REQUIRES: the 8 bytes from byte position / 8 on are readable.
inline std::uint64_t LoadBits(const std::uint64_t* bits, std::size_t position) {
  std::uint64_t word;
  std::memcpy(&word, reinterpret_cast<const char*>(bits) + position / 8, sizeof(word));
  return word >> position % 8;
}

// Counts the set bits of `words` words.
inline std::size_t CountBits(const std::uint64_t* bits, std::size_t words) {
  std::size_t count = 0;
  for (std::size_t i = 0; i < words; ++i) {
    count += static_cast<std::size_t>(std::popcount(bits[i]));
  }
  return count;
}

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_BIT_ROW_H_
