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
  SliceSource(const volume::GridGeometry& geometry, volume::ScalarType type, std::string name,
              std::unique_ptr<SliceReader> reader,
              std::optional<volume::PatientFrame> patient_frame)
      : geometry_(geometry),
        type_(type),
        name_(std::move(name)),
        reader_(std::move(reader)),
        patient_frame_(std::move(patient_frame)) {}

  [[nodiscard]] const volume::GridGeometry& geometry() const override { return geometry_; }
  [[nodiscard]] volume::ScalarType scalar_type() const override { return type_; }
  [[nodiscard]] std::optional<volume::PatientFrame> patient_frame() const override {
    return patient_frame_;
  }
  [[nodiscard]] const std::string& name() const override { return name_; }
  [[nodiscard]] bool is_seekable() const override { return false; }
  [[nodiscard]] std::int64_t memory_bytes() const override {
    return 2 * row_bytes() * geometry_.sample_dims.y + reader_->memory_bytes();
  }

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const math::Index3& dims = geometry_.sample_dims;
    ISOSCOPE_CHECK(begin_row >= 0 && begin_row < end_row && end_row <= dims.y * dims.z);
    while (begin_row < end_row) {
      const std::int64_t z = begin_row / dims.y;
      const std::int64_t y = begin_row % dims.y;
      const std::int64_t rows = std::min(dims.y - y, end_row - begin_row);
      if (rows == dims.y) {
        ISOSCOPE_RETURN_IF_ERROR(reader_->ReadSlice(z, out));
      } else {
        ISOSCOPE_RETURN_IF_ERROR(Hold(z));
        std::copy_n(slice_.data() + y * row_bytes(), rows * row_bytes(), out);
      }
      out += rows * row_bytes();
      begin_row += rows;
    }
    return absl::OkStatus();
  }

 private:
  [[nodiscard]] std::int64_t row_bytes() const {
    return geometry_.sample_dims.x * static_cast<std::int64_t>(volume::SizeOf(type_));
  }
  absl::Status Hold(std::int64_t z) {
    if (z == held_) {
      return absl::OkStatus();
    }
    held_ = -1;
    slice_.resize(static_cast<std::size_t>(row_bytes() * geometry_.sample_dims.y));
    ISOSCOPE_RETURN_IF_ERROR(reader_->ReadSlice(z, slice_.data()));
    held_ = z;
    return absl::OkStatus();
  }

  const volume::GridGeometry geometry_;
  const volume::ScalarType type_;
  const std::string name_;
  const std::unique_ptr<SliceReader> reader_;
  const std::optional<volume::PatientFrame> patient_frame_;
  std::vector<char> slice_;
  std::int64_t held_ = -1;  // the slice in slice_
};

}  // namespace

std::unique_ptr<VolumeSource> MakeSliceSource(const volume::GridGeometry& geometry,
                                              volume::ScalarType type, std::string name,
                                              std::unique_ptr<SliceReader> reader,
                                              std::optional<volume::PatientFrame> patient_frame) {
  return std::make_unique<SliceSource>(geometry, type, std::move(name), std::move(reader),
                                       std::move(patient_frame));
}

}  // namespace isoscope::source
