#include "tests/support/memory_source.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "absl/status/status.h"

#include "core/base/check.h"

namespace isoscope::testing {
namespace {

class MemorySource final : public source::VolumeSource {
 public:
  MemorySource(const volume::GridGeometry& geometry, volume::ScalarType type, std::string samples,
               std::string name)
      : geometry_(geometry), type_(type), samples_(std::move(samples)), name_(std::move(name)) {
    ISOSCOPE_CHECK_EQ(
        samples_.size(),
        static_cast<std::size_t>(math::Volume(geometry.sample_dims)) * volume::SizeOf(type));
  }

  [[nodiscard]] const volume::GridGeometry& geometry() const override { return geometry_; }
  [[nodiscard]] volume::ScalarType scalar_type() const override { return type_; }
  [[nodiscard]] const std::string& name() const override { return name_; }

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const math::Index3& dims = geometry_.sample_dims;
    ISOSCOPE_CHECK(begin_row >= 0 && begin_row < end_row && end_row <= dims.y * dims.z);
    const std::size_t row_bytes = static_cast<std::size_t>(dims.x) * volume::SizeOf(type_);
    std::copy_n(samples_.data() + static_cast<std::size_t>(begin_row) * row_bytes,
                static_cast<std::size_t>(end_row - begin_row) * row_bytes, out);
    return absl::OkStatus();
  }

 private:
  const volume::GridGeometry geometry_;
  const volume::ScalarType type_;
  const std::string samples_;
  const std::string name_;
};

}  // namespace

std::unique_ptr<source::VolumeSource> MakeMemorySource(const volume::GridGeometry& geometry,
                                                       volume::ScalarType type, std::string samples,
                                                       std::string name) {
  return std::make_unique<MemorySource>(geometry, type, std::move(samples), std::move(name));
}

}  // namespace isoscope::testing
