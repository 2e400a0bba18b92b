// Numbers of a binary header, of either byte order.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_BINARY_HEADER_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_BINARY_HEADER_H_

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>

#include "absl/strings/string_view.h"

#include "core/base/check.h"
#include "core/base/coding.h"

namespace isoscope::source {

// Returns true if the header begins with that number in big-endian order.
inline bool BeginsBigEndian(absl::string_view bytes, std::uint32_t number) {
  std::uint32_t first = 0;
  for (std::size_t i = 0; i < sizeof(first) && i < bytes.size(); ++i) {
    first = first << 8 | static_cast<unsigned char>(bytes[i]);
  }
  return first == number;
}

class BinaryHeader {
 public:
  BinaryHeader(std::string bytes, bool is_big_endian)
      : bytes_(std::move(bytes)), is_big_endian_(is_big_endian) {}

  // The number at that byte. REQUIRES: it lies within the header.
  template <typename T>
  [[nodiscard]] T Load(std::size_t offset) const {
    ISOSCOPE_CHECK(offset + sizeof(T) <= bytes_.size());
    std::array<char, sizeof(T)> value;
    std::copy_n(bytes_.data() + offset, sizeof(T), value.begin());
    if (is_big_endian_) {
      std::reverse(value.begin(), value.end());
    }
    return base::LoadLittleEndian<T>(value.data());
  }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }
  [[nodiscard]] bool is_big_endian() const { return is_big_endian_; }

 private:
  const std::string bytes_;
  const bool is_big_endian_;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_BINARY_HEADER_H_
