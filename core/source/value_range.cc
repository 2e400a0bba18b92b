#include "core/source/value_range.h"

#include <algorithm>
#include <cstddef>
#include <memory>

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/volume/min_max.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kPortionBytes = 8 * base::kMiB;

}  // namespace

absl::StatusOr<volume::ScalarSpan> FindValueRange(
    VolumeSource* source, const std::function<void(std::int64_t, std::int64_t)>& progress,
    const base::Cancellation& cancellation) {
  const math::Index3& dims = source->geometry().sample_dims;
  const std::int64_t row_count = dims.y * dims.z;
  const auto row_bytes = dims.x * static_cast<std::int64_t>(volume::SizeOf(source->scalar_type()));
  const std::int64_t portion_rows =
      std::clamp<std::int64_t>(kPortionBytes / row_bytes, 1, row_count);
  const auto portion =
      std::make_unique_for_overwrite<char[]>(static_cast<std::size_t>(portion_rows * row_bytes));
  return volume::VisitScalarType(
      source->scalar_type(), [&]<typename T>() -> absl::StatusOr<volume::ScalarSpan> {
        volume::MinMax<T> min_max;
        for (std::int64_t row = 0; row < row_count;) {
          ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
          const std::int64_t end = std::min(row + portion_rows, row_count);
          ISOSCOPE_RETURN_IF_ERROR(source->ReadRows(row, end, portion.get()));
          min_max.AddRow(portion.get(), static_cast<std::size_t>((end - row) * dims.x));
          row = end;
          if (progress) {
            progress(row * row_bytes, row_count * row_bytes);
          }
        }
        return min_max.Get();
      });
}

}  // namespace isoscope::source
