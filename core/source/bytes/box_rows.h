// Boxes of samples that lie row after row, as in a file without chunks.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_BOX_ROWS_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_BOX_ROWS_H_

#include <cstddef>
#include <cstdint>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"

#include "core/base/cancellation.h"
#include "core/math/box.h"

namespace isoscope::source {

// The boxes of such a file: rows so long that a read pays, and few samples around a block.
inline constexpr math::Index3 kRowBoxDims{128, 32, 32};

// The same of such a file at an address, where a request costs a round trip: whole rows, and many of a
// plane, if they are not too large for a few blocks. tuple_bytes: of a sample, as it is stored
math::Index3 FarRowBoxDims(const math::Index3& whole, std::int64_t tuple_bytes);

// Samples that lie one behind the other, counted x fastest.
struct RowRun {
  std::int64_t first = 0;
  std::size_t count = 0;
};
// Returns the runs of a box of a volume of `whole` samples, ascending: rows, or planes whose rows lie
// close together, with what lies between them. So at most 4 times the box's samples are read.
// REQUIRES: the box lies in the volume, and is not empty.
std::vector<RowRun> RunsOfBox(const math::Index3& whole, const math::IndexBox& box);

// Reads a box as [z][y][x] into `out`. `read` writes the samples of one run of RunsOfBox. Its errors,
// or that of `cancellation`. REQUIRES: as of RunsOfBox.
absl::Status ReadBoxRows(
    const math::Index3& whole, const math::IndexBox& box, std::size_t sample_bytes, char* out,
    const base::Cancellation& cancellation,
    absl::FunctionRef<absl::Status(std::int64_t first, std::size_t count, char* out)> read);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_BOX_ROWS_H_
