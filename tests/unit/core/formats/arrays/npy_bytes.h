// NumPy arrays of known values.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_FORMATS_ARRAYS_NPY_BYTES_H_
#define ISOSCOPE_TESTS_UNIT_CORE_FORMATS_ARRAYS_NPY_BYTES_H_

#include <cstdint>
#include <string>

#include "absl/strings/str_cat.h"

#include "core/base/coding.h"

namespace isoscope::testing {

// An array whose dictionary is that text.
inline std::string NpyWithText(std::string text, const std::string& samples, int version = 1) {
  while ((text.size() + (version == 1 ? 11 : 13)) % 64 != 0) {
    text += ' ';
  }
  text += '\n';
  std::string file("\x93NUMPY", 6);
  file += static_cast<char>(version);
  file += '\0';
  if (version == 1) {
    base::AppendLittleEndian(static_cast<std::uint16_t>(text.size()), &file);
  } else {
    base::AppendLittleEndian(static_cast<std::uint32_t>(text.size()), &file);
  }
  return file + text + samples;
}

// As numpy.save writes it.
inline std::string NpyBytes(const std::string& descr, const std::string& shape,
                            const std::string& samples, bool is_fortran = false, int version = 1) {
  return NpyWithText(absl::StrCat("{'descr': '", descr, "', 'fortran_order': ",
                                  is_fortran ? "True" : "False", ", 'shape': ", shape, ", }"),
                     samples, version);
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_UNIT_CORE_FORMATS_ARRAYS_NPY_BYTES_H_
