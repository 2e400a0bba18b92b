#include "core/io/expect_read.h"

#include <fcntl.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "core/base/units.h"

namespace isoscope::io {

void ExpectRead(const FileRead& read) {
  // Linux reads no more than this for one advice, whatever its size.
  constexpr std::size_t kMaxAdvisedBytes = 128 * static_cast<std::size_t>(base::kKiB);
  const int descriptor = read.file->descriptor();
  for (std::size_t begin = 0; descriptor >= 0 && begin < read.size; begin += kMaxAdvisedBytes) {
    // This is advice. It changes no byte, so an error does not matter.
    static_cast<void>(posix_fadvise(
        descriptor, read.offset + static_cast<std::int64_t>(begin),
        static_cast<off_t>(std::min(kMaxAdvisedBytes, read.size - begin)), POSIX_FADV_WILLNEED));
  }
}

absl::Status AwaitExpectedRead(const FileRead& read) {
  char last = 0;
  return read.file->ReadAt(read.offset + static_cast<std::int64_t>(read.size) - 1, 1, &last);
}

}  // namespace isoscope::io
