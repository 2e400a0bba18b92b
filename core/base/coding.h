// Bounds-checked little-endian encoding and decoding of fixed-width integers and IEEE floats: the
// only way bytes of files and messages become numbers.

#ifndef ISOSCOPE_CORE_BASE_CODING_H_
#define ISOSCOPE_CORE_BASE_CODING_H_

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <type_traits>

#include "absl/strings/string_view.h"

namespace isoscope::base {

static_assert(std::endian::native == std::endian::little,
              "Files and messages are little-endian and copied as they are.");

// Writes `value` to `out[0, sizeof(T))`, little-endian, unaligned.
template <typename T>
requires std::is_arithmetic_v<T>
void StoreLittleEndian(T value, void* out) { std::memcpy(out, &value, sizeof(T)); }

// Reads a T from `in[0, sizeof(T))`, little-endian, unaligned.
template <typename T>
requires std::is_arithmetic_v<T> T LoadLittleEndian(const void* in) {
  T value;
  std::memcpy(&value, in, sizeof(T));
  return value;
}

// Appends `value`, little-endian.
template <typename T>
requires std::is_arithmetic_v<T>
void AppendLittleEndian(T value, std::string* out) {
  out->append(reinterpret_cast<const char*>(&value), sizeof(T));
}

// Reads values one after the other from bytes that must outlive it. A read past the end returns
// false, leaves `value` as it was and makes every later read fail. Thread-compatible.
class Decoder {
 public:
  explicit Decoder(absl::string_view bytes) : rest_(bytes) {}

  template <typename T>
  requires std::is_arithmetic_v<T>
  [[nodiscard]] bool Read(T* value) {
    if (rest_.size() < sizeof(T)) {
      rest_ = {};
      failed_ = true;
      return false;
    }
    *value = LoadLittleEndian<T>(rest_.data());
    rest_.remove_prefix(sizeof(T));
    return true;
  }

  // Views the next `size` bytes in place.
  [[nodiscard]] bool ReadBytes(std::size_t size, absl::string_view* bytes) {
    if (failed_ || rest_.size() < size) {
      rest_ = {};
      failed_ = true;
      return false;
    }
    *bytes = rest_.substr(0, size);
    rest_.remove_prefix(size);
    return true;
  }

  [[nodiscard]] std::size_t remaining() const { return rest_.size(); }

 private:
  absl::string_view rest_;
  bool failed_ = false;
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_CODING_H_
