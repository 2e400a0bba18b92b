// Rows of the result are read from runs of whole rows of the volume, within one plane. Example, the
// crop 2:9 with stride 3 of an axis of 10 samples:
//
//   volume   0 1 2 3 4 5 6 7 8 9
//   result       0     1     2
//
// Rows that a stride skips within a plane are read, too, because one long read is faster than many
// short ones. Planes that it skips are read only if the volume can only be read forwards.

#include "core/source/adapt/adjusted_source.h"

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <limits>
#include <type_traits>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/source/grid/affine_grid.h"
#include "core/source/grid/straight_grid.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kAdjustedRunBytes = 4 * base::kMiB;
// Of samples of the volume that a box takes at once, or one plane.
constexpr std::int64_t kMaxBoxBytes = 16 * base::kMiB;

volume::ScalarType FilledType(volume::ScalarType type, bool has_fill) {
  switch (type) {
    case volume::ScalarType::kFloat32:
    case volume::ScalarType::kFloat64:
      return type;
    case volume::ScalarType::kUint32:
    case volume::ScalarType::kInt32:
      return has_fill ? volume::ScalarType::kFloat64 : type;
    default:
      return has_fill ? volume::ScalarType::kFloat32 : type;
  }
}

// As float32 the fill value of the file may differ from the decimal number that was given.
template <typename T>
bool IsFill(T value, double fill) {
  if constexpr (std::is_same_v<T, float>) {
    return value == static_cast<float>(fill);
  }
  return static_cast<double>(value) == fill;
}

// Takes every `stride`th of `count` samples of a row.
template <typename In, typename Out>
void TakeSamples(const char* in, std::int64_t count, std::int64_t stride,
                 const std::optional<double>& fill, char* out) {
  for (std::int64_t i = 0; i < count; ++i) {
    const auto value =
        base::LoadLittleEndian<In>(in + i * stride * static_cast<std::int64_t>(sizeof(In)));
    auto result = static_cast<Out>(value);
    if constexpr (std::is_floating_point_v<Out>) {
      if (fill.has_value() && IsFill(value, *fill)) {
        result = std::numeric_limits<Out>::quiet_NaN();
      }
    }
    base::StoreLittleEndian(result, out + i * static_cast<std::int64_t>(sizeof(Out)));
  }
}

// Rows of the volume that are read at once.
std::int64_t RunRows(const SourceInfo& volume) {
  return std::clamp<std::int64_t>(kAdjustedRunBytes / volume.row_bytes(), 1,
                                  volume.geometry.sample_dims.y);
}

class AdjustedSource final : public VolumeSource {
 public:
  AdjustedSource(SourceInfo info, std::unique_ptr<VolumeSource> source, const SampleBox& box,
                 std::int64_t stride, std::optional<double> fill)
      : VolumeSource(std::move(info)),
        source_(std::move(source)),
        box_(box),
        stride_(stride),
        fill_(fill) {}

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const math::Index3& dims = info().geometry.sample_dims;
    const std::int64_t plane_rows = dims.y;
    const std::int64_t source_rows = source_->info().geometry.sample_dims.y;
    const std::int64_t row_bytes = source_->info().row_bytes();
    ISOSCOPE_CHECK(begin_row >= 0 && begin_row < end_row && end_row <= plane_rows * dims.z);
    while (begin_row < end_row) {
      const std::int64_t z = begin_row / plane_rows;
      const std::int64_t y = begin_row % plane_rows;
      // The rows of this plane that a run holds, with those between them.
      const std::int64_t rows = std::min(
          {end_row - begin_row, plane_rows - y, (RunRows(source_->info()) - 1) / stride_ + 1});
      const std::int64_t first =
          (box_.begin.z + z * stride_) * source_rows + box_.begin.y + y * stride_;
      const std::int64_t count = (rows - 1) * stride_ + 1;
      run_.resize(static_cast<std::size_t>(count * row_bytes));
      ISOSCOPE_RETURN_IF_ERROR(source_->ReadRows(first, first + count, run_.data()));
      for (std::int64_t row = 0; row < rows; ++row) {
        TakeRow(run_.data() + row * stride_ * row_bytes, out);
        out += info().row_bytes();
      }
      begin_row += rows;
    }
    return absl::OkStatus();
  }

  void HeedCancellation(const base::Cancellation* cancellation) override {
    source_->HeedCancellation(cancellation);
  }

  // A box holds the samples of one box of the volume, or some of them.
  [[nodiscard]] std::optional<BoxGrid> box_grid() const override {
    std::optional<BoxGrid> grid = source_->box_grid();
    for (int axis = 0; grid.has_value() && axis < 3; ++axis) {
      std::int64_t& size = grid->box_dims[axis];
      std::int64_t first = grid->origin[axis] - box_.begin[axis];  // of a box, in the volume
      if (size % stride_ != 0) {
        first = 0;
      }
      size = std::max<std::int64_t>(size / stride_, 1);
      first = first >= 0 ? (first + stride_ - 1) / stride_ : -(-first / stride_);
      grid->origin[axis] = first % size - (first % size > 0 ? size : 0);
    }
    return grid;
  }

  [[nodiscard]] std::int64_t decoding_factor() const override { return source_->decoding_factor(); }
  [[nodiscard]] absl::Status ReadBox(const math::IndexBox& box, char* out,
                                     const base::Cancellation& cancellation) const override {
    math::IndexBox whole;
    for (int axis = 0; axis < 3; ++axis) {
      whole.begin[axis] = box_.begin[axis] + box.begin[axis] * stride_;
      whole.end[axis] = box_.begin[axis] + (box.end[axis] - 1) * stride_ + 1;
    }
    if (stride_ == 1 && info().type == source_->info().type && !fill_.has_value()) {
      return source_->ReadBox(whole, out, cancellation);
    }
    // As many planes at once as the bound allows, one at least.
    const math::Index3 dims = box.dims();
    const auto sample_bytes = static_cast<std::int64_t>(volume::SizeOf(source_->info().type));
    const std::int64_t row_bytes = whole.dims().x * sample_bytes;
    const std::int64_t plane_bytes = whole.dims().y * row_bytes;
    const std::int64_t planes =
        std::clamp<std::int64_t>((kMaxBoxBytes / plane_bytes - 1) / stride_ + 1, 1, dims.z);
    std::vector<char> run;
    for (std::int64_t z = 0; z < dims.z; z += planes) {
      math::IndexBox part = whole;
      const std::int64_t count = std::min(planes, dims.z - z);
      part.begin.z = whole.begin.z + z * stride_;
      part.end.z = part.begin.z + (count - 1) * stride_ + 1;
      run.resize(static_cast<std::size_t>(part.dims().z * plane_bytes));
      ISOSCOPE_RETURN_IF_ERROR(source_->ReadBox(part, run.data(), cancellation));
      for (std::int64_t row = 0; row < count * dims.y; ++row) {
        TakePart(
            run.data() + row / dims.y * stride_ * plane_bytes + row % dims.y * stride_ * row_bytes,
            dims.x, out);
        out += dims.x * static_cast<std::int64_t>(volume::SizeOf(info().type));
      }
    }
    return absl::OkStatus();
  }

 private:
  void TakeRow(const char* row, char* out) const {
    TakePart(row + box_.begin.x * static_cast<std::int64_t>(volume::SizeOf(source_->info().type)),
             info().geometry.sample_dims.x, out);
  }
  // Takes `count` samples of a row, from `first` on.
  void TakePart(const char* first, std::int64_t count, char* out) const {
    volume::VisitScalarType(source_->info().type, [&]<typename In>() {
      if (info().type == source_->info().type) {
        TakeSamples<In, In>(first, count, stride_, fill_, out);
      } else if (info().type == volume::ScalarType::kFloat32) {
        TakeSamples<In, float>(first, count, stride_, fill_, out);
      } else {
        TakeSamples<In, double>(first, count, stride_, fill_, out);
      }
    });
  }

  const std::unique_ptr<VolumeSource> source_;
  const SampleBox box_;
  const std::int64_t stride_;
  const std::optional<double> fill_;
  std::vector<char> run_;
};

class AdjustedSeries final : public VolumeSeries {
 public:
  AdjustedSeries(std::unique_ptr<VolumeSeries> series, Adjustment adjustment)
      : VolumeSeries(series->info()),
        series_(std::move(series)),
        adjustment_(std::move(adjustment)) {}

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> source,
                              series_->Open(field, component, step));
    return AdjustSource(std::move(source), adjustment_);
  }
  absl::StatusOr<std::optional<std::vector<std::string>>> FilesOfStep(int step) override {
    return series_->FilesOfStep(step);
  }

 private:
  const std::unique_ptr<VolumeSeries> series_;
  const Adjustment adjustment_;
};

// "12", or "" for `fallback`.
bool ParseEnd(absl::string_view text, std::int64_t fallback, std::int64_t* end) {
  *end = fallback;
  return text.empty() || (absl::SimpleAtoi(text, end) && *end >= 0);
}

}  // namespace

absl::StatusOr<SampleBox> ParseSampleBox(absl::string_view text) {
  constexpr std::int64_t kLast = std::numeric_limits<std::int64_t>::max();
  const std::vector<absl::string_view> axes = absl::StrSplit(text, ',');
  SampleBox box;
  bool is_box = axes.size() == 3;
  for (int axis = 0; is_box && axis < 3; ++axis) {
    const std::vector<absl::string_view> ends =
        absl::StrSplit(axes[static_cast<std::size_t>(axis)], ':');
    is_box = ends.size() == 2 && ParseEnd(ends[0], 0, &box.begin[axis]) &&
             ParseEnd(ends[1], kLast, &box.end[axis]) && box.begin[axis] < box.end[axis];
  }
  if (!is_box) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", text,
                     "' is no box X0:X1,Y0:Y1,Z0:Z1 of samples, each from X0 up to X1 - 1; a "
                     "number may be left out, as in :,:,10:"));
  }
  return box;
}

absl::StatusOr<std::unique_ptr<VolumeSource>> AdjustSource(std::unique_ptr<VolumeSource> source,
                                                           const Adjustment& adjustment) {
  if (adjustment.is_none()) {
    return source;
  }
  SourceInfo info = source->info();
  volume::GridGeometry whole = info.geometry;
  const std::optional<Shear> shear =
      adjustment.ignores_shear ? FindShear(whole.direction) : std::nullopt;
  if (shear.has_value()) {
    const volume::GridGeometry straight = StraightGrid(whole);
    absl::StrAppend(&info.note, info.note.empty() ? "" : "; ",
                    DescribeStraightening(*shear, whole, straight));
    whole = straight;
  } else if (!adjustment.crop.has_value() && adjustment.stride == 1 && !adjustment.fill) {
    return source;
  }
  SampleBox box{.begin = {0, 0, 0}, .end = whole.sample_dims};
  if (adjustment.crop.has_value()) {
    box = *adjustment.crop;
  }
  volume::GridGeometry& geometry = info.geometry;
  geometry = whole;
  for (int axis = 0; axis < 3; ++axis) {
    const std::int64_t size = whole.sample_dims[axis];
    if (box.end[axis] == std::numeric_limits<std::int64_t>::max()) {
      box.end[axis] = size;
    }
    if (box.begin[axis] >= box.end[axis] || box.end[axis] > size) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: --crop %d:%d on axis %c, which has %d samples, 0 to %d; expected a part of them",
          info.name, box.begin[axis], box.end[axis], "xyz"[axis], size, size - 1));
    }
    geometry.sample_dims[axis] = (box.end[axis] - box.begin[axis] - 1) / adjustment.stride + 1;
    geometry.spacing[axis] = whole.spacing[axis] * static_cast<double>(adjustment.stride);
  }
  geometry.origin = math::TransformPoint(
      whole.world_from_index(), {static_cast<double>(box.begin.x), static_cast<double>(box.begin.y),
                                 static_cast<double>(box.begin.z)});
  const absl::Status valid = volume::Validate(geometry);
  if (!valid.ok()) {
    return absl::Status(valid.code(),
                        absl::StrCat(info.name, ": after --crop and --stride: ", valid.message()));
  }
  const std::optional<double> fill = info.is_resampled ? std::nullopt : adjustment.fill;
  info.type = FilledType(info.type, fill.has_value());
  info.memory_bytes += RunRows(source->info()) * source->info().row_bytes();
  info.planes_at_once = 1;  // planes are read one by one
  return std::make_unique<AdjustedSource>(std::move(info), std::move(source), box,
                                          adjustment.stride, fill);
}

std::unique_ptr<VolumeSeries> AdjustSeries(std::unique_ptr<VolumeSeries> series,
                                           const Adjustment& adjustment) {
  if (adjustment.is_none()) {
    return series;
  }
  return std::make_unique<AdjustedSeries>(std::move(series), adjustment);
}

}  // namespace isoscope::source
