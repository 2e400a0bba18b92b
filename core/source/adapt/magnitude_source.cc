#include "core/source/adapt/magnitude_source.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kPortionSamples = 256 * base::kKiB;

template <typename T>
void AddSquares(std::size_t count, const char* samples, double* sums) {
  for (std::size_t i = 0; i < count; ++i) {
    const auto value = static_cast<double>(base::LoadLittleEndian<T>(samples + i * sizeof(T)));
    sums[i] += value * value;
  }
}

template <typename T>
void StoreRoots(std::size_t count, const double* sums, char* out) {
  for (std::size_t i = 0; i < count; ++i) {
    const double root = std::sqrt(sums[i]);
    base::StoreLittleEndian(
        std::isnan(root) ? std::numeric_limits<T>::quiet_NaN() : static_cast<T>(root),
        out + i * sizeof(T));
  }
}

bool FitsFloat32(volume::ScalarType type) {
  return volume::SizeOf(type) <= 2 || type == volume::ScalarType::kFloat32;
}

class MagnitudeSource final : public VolumeSource {
 public:
  explicit MagnitudeSource(std::vector<std::unique_ptr<VolumeSource>> components)
      : components_(std::move(components)) {
    std::vector<volume::ScalarType> types;
    for (const auto& component : components_) {
      ISOSCOPE_CHECK(component->geometry() == geometry());
      types.push_back(component->scalar_type());
    }
    type_ = MagnitudeType(types);
  }

  [[nodiscard]] const volume::GridGeometry& geometry() const override {
    return components_.front()->geometry();
  }
  [[nodiscard]] volume::ScalarType scalar_type() const override { return type_; }
  [[nodiscard]] std::optional<volume::PatientFrame> patient_frame() const override {
    return components_.front()->patient_frame();
  }
  [[nodiscard]] const std::string& name() const override { return components_.front()->name(); }
  [[nodiscard]] bool is_seekable() const override {
    return std::all_of(components_.begin(), components_.end(),
                       [](const auto& component) { return component->is_seekable(); });
  }
  [[nodiscard]] std::int64_t memory_bytes() const override {
    const math::Index3& dims = geometry().sample_dims;
    constexpr auto kBytesPerSample = static_cast<std::int64_t>(2 * sizeof(double));
    std::int64_t bytes = rows_at_once() * dims.x * kBytesPerSample;
    for (const auto& component : components_) {
      bytes += component->memory_bytes();
    }
    return bytes;
  }

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const math::Index3& dims = geometry().sample_dims;
    ISOSCOPE_CHECK(begin_row >= 0 && begin_row < end_row && end_row <= dims.y * dims.z);
    while (begin_row < end_row) {
      const std::int64_t rows = std::min(rows_at_once(), end_row - begin_row);
      ISOSCOPE_RETURN_IF_ERROR(ReadPortion(begin_row, begin_row + rows, out));
      out += rows * dims.x * static_cast<std::int64_t>(volume::SizeOf(type_));
      begin_row += rows;
    }
    return absl::OkStatus();
  }

 private:
  [[nodiscard]] std::int64_t rows_at_once() const {
    const math::Index3& dims = geometry().sample_dims;
    return std::clamp<std::int64_t>(kPortionSamples / dims.x, 1, dims.y * dims.z);
  }

  absl::Status ReadPortion(std::int64_t begin_row, std::int64_t end_row, char* out) {
    const auto count = static_cast<std::size_t>((end_row - begin_row) * geometry().sample_dims.x);
    sums_.assign(count, 0);
    for (const auto& component : components_) {
      samples_.resize(count * volume::SizeOf(component->scalar_type()));
      ISOSCOPE_RETURN_IF_ERROR(component->ReadRows(begin_row, end_row, samples_.data()));
      volume::VisitScalarType(component->scalar_type(), [&]<typename T>() {
        AddSquares<T>(count, samples_.data(), sums_.data());
      });
    }
    if (type_ == volume::ScalarType::kFloat32) {
      StoreRoots<float>(count, sums_.data(), out);
    } else {
      StoreRoots<double>(count, sums_.data(), out);
    }
    return absl::OkStatus();
  }

  const std::vector<std::unique_ptr<VolumeSource>> components_;
  volume::ScalarType type_ = volume::ScalarType::kFloat64;
  std::vector<double> sums_;   // of squares, of a portion
  std::vector<char> samples_;  // of one component, of a portion
};

}  // namespace

volume::ScalarType MagnitudeType(const std::vector<volume::ScalarType>& components) {
  ISOSCOPE_CHECK(!components.empty());
  return std::all_of(components.begin(), components.end(), FitsFloat32)
             ? volume::ScalarType::kFloat32
             : volume::ScalarType::kFloat64;
}

std::unique_ptr<VolumeSource> MakeMagnitudeSource(
    std::vector<std::unique_ptr<VolumeSource>> components) {
  ISOSCOPE_CHECK(!components.empty());
  return std::make_unique<MagnitudeSource>(std::move(components));
}

}  // namespace isoscope::source
