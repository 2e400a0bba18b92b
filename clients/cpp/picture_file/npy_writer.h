// Planes as NumPy arrays: files of format version 1.0 (numpy.lib.format).

#ifndef ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_NPY_WRITER_H_
#define ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_NPY_WRITER_H_

#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace isoscope::client {

// Returns what precedes the elements in the file: magic, version, and the header, padded to a
// multiple of 64 bytes.
//
// type:  NumPy's name: "<f4", "|u1"
// shape: C order, at least one axis
std::string MakeNpyHeader(absl::string_view type, const std::vector<int>& shape);

// Writes an array; the file appears complete or not at all. `elements`: in C order, of `type`.
// DATA_LOSS if the number of bytes does not match `shape` and `element_bytes`.
absl::Status WriteNpy(const std::string& path, absl::string_view type, int element_bytes,
                      const std::vector<int>& shape, absl::string_view elements);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_NPY_WRITER_H_
