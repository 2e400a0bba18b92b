// A file that an earlier process began, and this one goes on with.

#ifndef ISOSCOPE_CORE_IO_CONTINUED_FILE_H_
#define ISOSCOPE_CORE_IO_CONTINUED_FILE_H_

#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/io/file.h"

namespace isoscope::io {

// Opens a file that is there, cuts it to `size_bytes`, and writes behind them. DATA_LOSS if it is
// shorter; FAILED_PRECONDITION as CheckIsRegularFile.
absl::StatusOr<std::unique_ptr<WritableFile>> ContinueWritableFile(const std::string& path,
                                                                   std::int64_t size_bytes);

}  // namespace isoscope::io

#endif  // ISOSCOPE_CORE_IO_CONTINUED_FILE_H_
