#include "core/source/adapt/slice_source.h"

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "core/base/check.h"
#include "core/base/status_macros.h"

namespace isoscope::source {
namespace {

class SliceSource final : public VolumeSource {
 public:
  SliceSource(SourceInfo info, std::unique_ptr<SliceReader> reader)
      : VolumeSource(std::move(info)), reader_(std::move(reader)) {}

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const math::Index3& dims = info().geometry.sample_dims;
    const std::int64_t row_bytes = info().row_bytes();
    ISOSCOPE_CHECK(begin_row >= 0 && begin_row < end_row && end_row <= dims.y * dims.z);
    while (begin_row < end_row) {
      const std::int64_t z = begin_row / dims.y;
      const std::int64_t y = begin_row % dims.y;
      const std::int64_t rows = std::min(dims.y - y, end_row - begin_row);
      if (rows == dims.y) {
        ISOSCOPE_RETURN_IF_ERROR(reader_->ReadSlice(z, out));
      } else {
        ISOSCOPE_RETURN_IF_ERROR(Hold(z));
        std::copy_n(slice_.data() + y * row_bytes, rows * row_bytes, out);
      }
      out += rows * row_bytes;
      begin_row += rows;
    }
    return absl::OkStatus();
  }

 private:
  absl::Status Hold(std::int64_t z) {
    if (z == held_) {
      return absl::OkStatus();
    }
    held_ = -1;
    slice_.resize(static_cast<std::size_t>(info().row_bytes() * info().geometry.sample_dims.y));
    ISOSCOPE_RETURN_IF_ERROR(reader_->ReadSlice(z, slice_.data()));
    held_ = z;
    return absl::OkStatus();
  }

  const std::unique_ptr<SliceReader> reader_;
  std::vector<char> slice_;
  std::int64_t held_ = -1;  // the slice in slice_
};

}  // namespace

std::unique_ptr<VolumeSource> MakeSliceSource(SourceInfo info,
                                              std::unique_ptr<SliceReader> reader) {
  info.is_seekable = false;
  info.memory_bytes = 2 * info.row_bytes() * info.geometry.sample_dims.y + reader->memory_bytes();
  return std::make_unique<SliceSource>(std::move(info), std::move(reader));
}

}  // namespace isoscope::source
