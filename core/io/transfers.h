// Complete reads and writes on a descriptor. Linux moves at most 2^31 - 4096 bytes in one call, and
// may move less, or be interrupted.

#ifndef ISOSCOPE_CORE_IO_TRANSFERS_H_
#define ISOSCOPE_CORE_IO_TRANSFERS_H_

#include <cstddef>
#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace isoscope::io {

inline constexpr std::size_t kMaxTransferBytes = std::size_t{1} << 30;

// Reads the bytes [*done, size) of a range, and adds to *done. Returns 0, or the errno of a call
// that failed. If the file ends before, it returns 0 with *done < size.
int ReadFully(int descriptor, std::int64_t offset, std::size_t size, char* out, std::size_t* done,
              std::size_t max_transfer_bytes = kMaxTransferBytes);
// Writes all bytes; `path` is for the error.
absl::Status WriteFully(int descriptor, std::int64_t offset, absl::string_view bytes,
                        const std::string& path);

}  // namespace isoscope::io

#endif  // ISOSCOPE_CORE_IO_TRANSFERS_H_
