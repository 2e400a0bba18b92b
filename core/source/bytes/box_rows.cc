#include "core/source/bytes/box_rows.h"

#include <algorithm>
#include <vector>

#include "core/base/status_macros.h"
#include "core/base/units.h"

namespace isoscope::source {
namespace {

// Rows of a plane are read at once if that reads at most this many times their bytes.
constexpr std::int64_t kMaxRowOverhead = 4;

// Of boxes at an address.
constexpr std::int64_t kMaxFarBoxBytes = 4 * base::kMiB;
constexpr std::int64_t kFarRunBytes = 64 * base::kKiB;
constexpr std::int64_t kMinFarPlanes = 8;

bool IsDense(const math::Index3& whole, const math::Index3& dims) {
  return whole.x <= kMaxRowOverhead * dims.x;
}

}  // namespace

math::Index3 FarRowBoxDims(const math::Index3& whole, std::int64_t tuple_bytes) {
  math::Index3 dims = kRowBoxDims;
  if (whole.x > kMaxFarBoxBytes / tuple_bytes / dims.y / dims.z) {
    return dims;
  }
  dims.x = whole.x;
  while (dims.x * dims.y * tuple_bytes < kFarRunBytes && dims.z > kMinFarPlanes) {
    dims.y *= 2;
    dims.z /= 2;
  }
  return dims;
}

std::vector<RowRun> RunsOfBox(const math::Index3& whole, const math::IndexBox& box) {
  const math::Index3 dims = box.dims();
  std::vector<RowRun> runs;
  for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
    const std::int64_t first = (z * whole.y + box.begin.y) * whole.x + box.begin.x;
    if (IsDense(whole, dims)) {
      runs.push_back(
          {.first = first, .count = static_cast<std::size_t>((dims.y - 1) * whole.x + dims.x)});
      continue;
    }
    for (std::int64_t y = 0; y < dims.y; ++y) {
      runs.push_back({.first = first + y * whole.x, .count = static_cast<std::size_t>(dims.x)});
    }
  }
  return runs;
}

absl::Status ReadBoxRows(
    const math::Index3& whole, const math::IndexBox& box, std::size_t sample_bytes, char* out,
    const base::Cancellation& cancellation,
    absl::FunctionRef<absl::Status(std::int64_t first, std::size_t count, char* out)> read) {
  const math::Index3 dims = box.dims();
  const std::int64_t row_bytes = dims.x * static_cast<std::int64_t>(sample_bytes);
  const std::int64_t whole_row_bytes = whole.x * static_cast<std::int64_t>(sample_bytes);
  const bool has_gaps = IsDense(whole, dims) && dims.x < whole.x;
  std::vector<char> rows;
  for (const RowRun& run : RunsOfBox(whole, box)) {
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    if (!has_gaps) {
      ISOSCOPE_RETURN_IF_ERROR(read(run.first, run.count, out));
      out += run.count * sample_bytes;
      continue;
    }
    rows.resize(run.count * sample_bytes);
    ISOSCOPE_RETURN_IF_ERROR(read(run.first, run.count, rows.data()));
    for (std::int64_t y = 0; y < dims.y; ++y) {
      out = std::copy_n(rows.data() + y * whole_row_bytes, row_bytes, out);
    }
  }
  return absl::OkStatus();
}

}  // namespace isoscope::source
