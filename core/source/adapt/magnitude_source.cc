#include "core/source/adapt/magnitude_source.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"

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
void StoreRootsAs(std::size_t count, const double* sums, char* out) {
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
      : VolumeSource(InfoOf(components)), components_(std::move(components)) {}

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const math::Index3& dims = info().geometry.sample_dims;
    ISOSCOPE_CHECK(begin_row >= 0 && begin_row < end_row && end_row <= dims.y * dims.z);
    while (begin_row < end_row) {
      const std::int64_t rows = std::min(RowsAtOnce(dims), end_row - begin_row);
      ISOSCOPE_RETURN_IF_ERROR(ReadPortion(begin_row, begin_row + rows, out));
      out += rows * info().row_bytes();
      begin_row += rows;
    }
    return absl::OkStatus();
  }

  [[nodiscard]] std::optional<BoxGrid> box_grid() const override {
    std::optional<BoxGrid> grid = components_.front()->box_grid();
    for (const auto& component : components_) {
      const std::optional<BoxGrid> other = component->box_grid();
      if (!grid.has_value() || !other.has_value()) {
        return std::nullopt;
      }
      for (int axis = 0; axis < 3; ++axis) {
        if (other->box_dims[axis] > grid->box_dims[axis]) {
          grid->box_dims[axis] = other->box_dims[axis];
          grid->origin[axis] = other->origin[axis];
        }
      }
    }
    return grid;
  }
  [[nodiscard]] std::int64_t decoding_factor() const override {
    std::int64_t factor = 1;
    for (const auto& component : components_) {
      factor = std::max(factor, component->decoding_factor());
    }
    return factor + 1;  // sums and samples beside what a component decodes
  }
  [[nodiscard]] absl::Status ReadBox(const math::IndexBox& box, char* out,
                                     const base::Cancellation& cancellation) const override {
    const auto count = static_cast<std::size_t>(math::Volume(box.dims()));
    std::vector<double> sums(count);
    std::vector<char> samples;
    for (const auto& component : components_) {
      samples.resize(count * volume::SizeOf(component->info().type));
      ISOSCOPE_RETURN_IF_ERROR(component->ReadBox(box, samples.data(), cancellation));
      Add(component->info().type, count, samples.data(), sums.data());
    }
    StoreRoots(count, sums.data(), out);
    return absl::OkStatus();
  }

  void HeedCancellation(const base::Cancellation* cancellation) override {
    for (const auto& component : components_) {
      component->HeedCancellation(cancellation);
    }
  }

 private:
  static SourceInfo InfoOf(const std::vector<std::unique_ptr<VolumeSource>>& components) {
    SourceInfo info = components.front()->info();
    std::vector<volume::ScalarType> types;
    info.is_seekable = true;
    info.memory_bytes = 0;
    info.planes_at_once = 1;  // rows are read portion by portion
    for (const auto& component : components) {
      ISOSCOPE_CHECK(component->info().geometry == info.geometry);
      types.push_back(component->info().type);
      info.is_seekable = info.is_seekable && component->info().is_seekable;
      info.memory_bytes += component->info().memory_bytes;
    }
    info.type = MagnitudeType(types);
    const math::Index3& dims = info.geometry.sample_dims;
    constexpr auto kBytesPerSample = static_cast<std::int64_t>(2 * sizeof(double));
    info.memory_bytes += RowsAtOnce(dims) * dims.x * kBytesPerSample;
    return info;
  }
  static std::int64_t RowsAtOnce(const math::Index3& dims) {
    return std::clamp<std::int64_t>(kPortionSamples / dims.x, 1, dims.y * dims.z);
  }

  absl::Status ReadPortion(std::int64_t begin_row, std::int64_t end_row, char* out) {
    const auto count =
        static_cast<std::size_t>((end_row - begin_row) * info().geometry.sample_dims.x);
    sums_.assign(count, 0);
    for (const auto& component : components_) {
      samples_.resize(count * volume::SizeOf(component->info().type));
      ISOSCOPE_RETURN_IF_ERROR(component->ReadRows(begin_row, end_row, samples_.data()));
      Add(component->info().type, count, samples_.data(), sums_.data());
    }
    StoreRoots(count, sums_.data(), out);
    return absl::OkStatus();
  }

  static void Add(volume::ScalarType type, std::size_t count, const char* samples, double* sums) {
    volume::VisitScalarType(type, [&]<typename T>() { AddSquares<T>(count, samples, sums); });
  }
  void StoreRoots(std::size_t count, const double* sums, char* out) const {
    if (info().type == volume::ScalarType::kFloat32) {
      StoreRootsAs<float>(count, sums, out);
    } else {
      StoreRootsAs<double>(count, sums, out);
    }
  }

  const std::vector<std::unique_ptr<VolumeSource>> components_;
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

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenComponent(VolumeSeries& series, int field,
                                                            int component, int step) {
  const SourceField& named = series.info().field(field);
  const auto count = static_cast<int>(named.components.size());
  if (component < count) {
    return series.Open(field, component, step);
  }
  std::vector<std::unique_ptr<VolumeSource>> components;
  for (int i = 0; i < count; ++i) {
    ISOSCOPE_ASSIGN_OR_RETURN(components.emplace_back(), series.Open(field, i, step));
    if (components.back()->info().geometry != components.front()->info().geometry) {
      return absl::InvalidArgumentError(
          absl::StrCat(series.info().name, ": field \"", named.name, "\", component ",
                       named.components[static_cast<std::size_t>(i)], ", step ", step,
                       ": has another grid than the component before"));
    }
  }
  return MakeMagnitudeSource(std::move(components));
}

}  // namespace isoscope::source
