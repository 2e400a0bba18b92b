#include "core/source/bytes/box_rows.h"

#include <algorithm>
#include <vector>

#include "core/base/status_macros.h"

namespace isoscope::source {
namespace {

// Rows of a plane are read at once if that reads at most this many times their bytes.
constexpr std::int64_t kMaxRowOverhead = 4;

}  // namespace

absl::Status ReadBoxRows(
    const math::Index3& whole, const math::IndexBox& box, std::size_t sample_bytes, char* out,
    absl::FunctionRef<absl::Status(std::int64_t first, std::size_t count, char* out)> read) {
  const math::Index3 dims = box.dims();
  const std::int64_t row_bytes = dims.x * static_cast<std::int64_t>(sample_bytes);
  const std::int64_t whole_row_bytes = whole.x * static_cast<std::int64_t>(sample_bytes);
  const bool is_dense = whole.x <= kMaxRowOverhead * dims.x;
  std::vector<char> rows;
  for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
    const std::int64_t first = (z * whole.y + box.begin.y) * whole.x + box.begin.x;
    const auto run = static_cast<std::size_t>((dims.y - 1) * whole.x + dims.x);
    if (dims.x == whole.x) {
      ISOSCOPE_RETURN_IF_ERROR(read(first, run, out));
      out += dims.y * row_bytes;
      continue;
    }
    if (is_dense) {
      rows.resize(run * sample_bytes);
      ISOSCOPE_RETURN_IF_ERROR(read(first, run, rows.data()));
    }
    for (std::int64_t y = 0; y < dims.y; ++y) {
      if (is_dense) {
        std::copy_n(rows.data() + y * whole_row_bytes, row_bytes, out);
      } else {
        ISOSCOPE_RETURN_IF_ERROR(read(first + y * whole.x, static_cast<std::size_t>(dims.x), out));
      }
      out += row_bytes;
    }
  }
  return absl::OkStatus();
}

}  // namespace isoscope::source
