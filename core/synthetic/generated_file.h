// Writers of generated files share this: rows made in parallel and written in order, and the
// question of free space.

#ifndef ISOSCOPE_CORE_SYNTHETIC_GENERATED_FILE_H_
#define ISOSCOPE_CORE_SYNTHETIC_GENERATED_FILE_H_

#include <cstdint>
#include <functional>
#include <string>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/strings/string_view.h"

#include "core/base/cancellation.h"

namespace isoscope::source {

struct RowSource {
  std::int64_t row_count = 0;
  std::int64_t row_bytes = 0;
  // Writes rows [begin, end) to `out`; called by many threads at once. `begin` is a multiple of 4.
  std::function<void(std::int64_t begin, std::int64_t end, char* out)> fill;
};

// Fills rows in parallel and appends them in order, in constant memory: 2 MiB or four rows, twice
// each thread of the arena that the caller is in. `append` is called by one thread at a time; its
// first error ends the work and is returned. Otherwise errors as Cancellation::Check.
absl::Status AppendRows(const RowSource& rows,
                        absl::FunctionRef<absl::Status(absl::string_view)> append,
                        const base::Cancellation& cancellation);

// RESOURCE_EXHAUSTED if the file system of `path` has less than `bytes` left; the message ends in
// `advice`, what to change. OK if the system does not say.
absl::Status CheckFreeSpace(const std::string& path, std::int64_t bytes, const std::string& advice);

// FAILED_PRECONDITION if `path` is a folder.
absl::Status CheckNoFolder(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SYNTHETIC_GENERATED_FILE_H_
