// Boxes of samples that lie row after row, as in a file without chunks.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_BOX_ROWS_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_BOX_ROWS_H_

#include <cstddef>
#include <cstdint>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"

#include "core/math/box.h"

namespace isoscope::source {

// The boxes of such a file: rows so long that a read pays, and few samples around a block.
inline constexpr math::Index3 kRowBoxDims{128, 32, 32};

// Reads a box of a volume of `whole` samples as [z][y][x] into `out`. `read` takes the number of the first
// sample of a run, counted x fastest, the number of samples, and where they go. Rows of a plane that lie
// close together are one run, with what lies between them: at most 4 times the bytes of the box's plane.
// Errors of `read`.
// REQUIRES: the box lies in the volume, and is not empty.
absl::Status ReadBoxRows(
    const math::Index3& whole, const math::IndexBox& box, std::size_t sample_bytes, char* out,
    absl::FunctionRef<absl::Status(std::int64_t first, std::size_t count, char* out)> read);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_BOX_ROWS_H_
