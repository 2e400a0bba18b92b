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

// Makes `vector` at least `size` long.
template <typename V>
void Grow(std::size_t size, std::vector<V>* vector) {
  if (vector->size() < size) {
    vector->resize(size);
  }
}

// 57 or more bits of `bits`, the lowest one being bit `position`.
inline std::uint64_t LoadBits(const std::uint64_t* bits, std::size_t position) {
  std::uint64_t word;
  std::memcpy(&word, reinterpret_cast<const char*>(bits) + position / 8, sizeof(word));
  return word >> position % 8;
}

// How many of the bits of `words` words are set.
inline std::size_t CountBits(const std::uint64_t* bits, std::size_t words) {
  std::size_t count = 0;
  for (std::size_t i = 0; i < words; ++i) {
    count += static_cast<std::size_t>(std::popcount(bits[i]));
  }
  return count;
}

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_BIT_ROW_H_
