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
  MemorySource(source::SourceInfo info, std::string samples)
      : VolumeSource(std::move(info)), samples_(std::move(samples)) {
    ISOSCOPE_CHECK_EQ(samples_.size(),
                      static_cast<std::size_t>(math::Volume(this->info().geometry.sample_dims)) *
                          volume::SizeOf(this->info().type));
  }

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const math::Index3& dims = info().geometry.sample_dims;
    ISOSCOPE_CHECK(begin_row >= 0 && begin_row < end_row && end_row <= dims.y * dims.z);
    const std::size_t row_bytes = static_cast<std::size_t>(info().row_bytes());
    std::copy_n(samples_.data() + static_cast<std::size_t>(begin_row) * row_bytes,
                static_cast<std::size_t>(end_row - begin_row) * row_bytes, out);
    return absl::OkStatus();
  }

 private:
  const std::string samples_;
};

}  // namespace

std::unique_ptr<source::VolumeSource> MakeMemorySource(const volume::GridGeometry& geometry,
                                                       volume::ScalarType type, std::string samples,
                                                       std::string name) {
  return MakeMemorySource({.name = std::move(name), .geometry = geometry, .type = type},
                          std::move(samples));
}

std::unique_ptr<source::VolumeSource> MakeMemorySource(source::SourceInfo info,
                                                       std::string samples) {
  return std::make_unique<MemorySource>(std::move(info), std::move(samples));
}

}  // namespace isoscope::testing
