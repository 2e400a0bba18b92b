// Rows of the result are read from runs of whole rows of the volume, within one plane. Example, the
// crop 2:9 with stride 3 of an axis of 10 samples:
//
//   volume   0 1 2 3 4 5 6 7 8 9
//   result       0     1     2
//
// Rows that a stride skips within a plane are read, too, because one long read is faster than many
// short ones; planes that it skips are not, unless the volume can only be read forwards.

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

class AdjustedSource final : public VolumeSource {
 public:
  AdjustedSource(std::unique_ptr<VolumeSource> source, const volume::GridGeometry& geometry,
                 const SampleBox& box, std::int64_t stride, std::optional<double> fill,
                 std::string note)
      : source_(std::move(source)),
        geometry_(geometry),
        box_(box),
        stride_(stride),
        fill_(fill),
        note_(std::move(note)),
        type_(FilledType(source_->scalar_type(), fill.has_value())) {}

  [[nodiscard]] const volume::GridGeometry& geometry() const override { return geometry_; }
  [[nodiscard]] volume::ScalarType scalar_type() const override { return type_; }
  [[nodiscard]] std::optional<volume::PatientFrame> patient_frame() const override {
    return source_->patient_frame();
  }
  [[nodiscard]] const std::string& name() const override { return source_->name(); }
  [[nodiscard]] std::string note() const override { return note_; }
  [[nodiscard]] bool is_resampled() const override { return source_->is_resampled(); }
  [[nodiscard]] bool is_seekable() const override { return source_->is_seekable(); }
  [[nodiscard]] std::int64_t memory_bytes() const override {
    return source_->memory_bytes() + run_rows() * row_bytes();
  }

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const std::int64_t plane_rows = geometry_.sample_dims.y;
    const std::int64_t source_rows = source_->geometry().sample_dims.y;
    ISOSCOPE_CHECK(begin_row >= 0 && begin_row < end_row &&
                   end_row <= plane_rows * geometry_.sample_dims.z);
    const std::int64_t out_bytes =
        geometry_.sample_dims.x * static_cast<std::int64_t>(volume::SizeOf(type_));
    while (begin_row < end_row) {
      const std::int64_t z = begin_row / plane_rows;
      const std::int64_t y = begin_row % plane_rows;
      // As many rows of this plane as a run holds, with those between them.
      const std::int64_t rows =
          std::min({end_row - begin_row, plane_rows - y, (run_rows() - 1) / stride_ + 1});
      const std::int64_t first =
          (box_.begin.z + z * stride_) * source_rows + box_.begin.y + y * stride_;
      const std::int64_t count = (rows - 1) * stride_ + 1;
      run_.resize(static_cast<std::size_t>(count * row_bytes()));
      ISOSCOPE_RETURN_IF_ERROR(source_->ReadRows(first, first + count, run_.data()));
      for (std::int64_t row = 0; row < rows; ++row) {
        TakeRow(run_.data() + row * stride_ * row_bytes(), out);
        out += out_bytes;
      }
      begin_row += rows;
    }
    return absl::OkStatus();
  }

 private:
  // In samples of the volume.
  [[nodiscard]] std::int64_t row_bytes() const {
    return source_->geometry().sample_dims.x *
           static_cast<std::int64_t>(volume::SizeOf(source_->scalar_type()));
  }
  [[nodiscard]] std::int64_t run_rows() const {
    return std::clamp<std::int64_t>(kAdjustedRunBytes / row_bytes(), 1,
                                    source_->geometry().sample_dims.y);
  }

  void TakeRow(const char* row, char* out) const {
    volume::VisitScalarType(source_->scalar_type(), [&]<typename In>() {
      const char* first = row + box_.begin.x * static_cast<std::int64_t>(sizeof(In));
      const std::int64_t count = geometry_.sample_dims.x;
      if (type_ == source_->scalar_type()) {
        TakeSamples<In, In>(first, count, stride_, fill_, out);
      } else if (type_ == volume::ScalarType::kFloat32) {
        TakeSamples<In, float>(first, count, stride_, fill_, out);
      } else {
        TakeSamples<In, double>(first, count, stride_, fill_, out);
      }
    });
  }

  const std::unique_ptr<VolumeSource> source_;
  const volume::GridGeometry geometry_;
  const SampleBox box_;
  const std::int64_t stride_;
  const std::optional<double> fill_;
  const std::string note_;
  const volume::ScalarType type_;
  std::vector<char> run_;
};

class AdjustedSeries final : public VolumeSeries {
 public:
  AdjustedSeries(std::unique_ptr<VolumeSeries> series, Adjustment adjustment)
      : series_(std::move(series)), adjustment_(std::move(adjustment)) {}

  [[nodiscard]] const std::string& name() const override { return series_->name(); }
  [[nodiscard]] const std::vector<SourceField>& fields() const override {
    return series_->fields();
  }
  [[nodiscard]] const std::vector<double>& times() const override { return series_->times(); }
  [[nodiscard]] const std::string& time_unit() const override { return series_->time_unit(); }
  [[nodiscard]] const std::string& length_unit() const override { return series_->length_unit(); }
  [[nodiscard]] std::vector<std::string> FieldsElsewhere() const override {
    return series_->FieldsElsewhere();
  }
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
  volume::GridGeometry whole = source->geometry();
  std::string note = source->note();
  const std::optional<Shear> shear =
      adjustment.ignores_shear ? FindShear(whole.direction) : std::nullopt;
  if (shear.has_value()) {
    const volume::GridGeometry straight = StraightGrid(whole);
    absl::StrAppend(&note, note.empty() ? "" : "; ",
                    DescribeStraightening(*shear, whole, straight));
    whole = straight;
  } else if (!adjustment.crop.has_value() && adjustment.stride == 1 && !adjustment.fill) {
    return source;
  }
  SampleBox box{.begin = {0, 0, 0}, .end = whole.sample_dims};
  if (adjustment.crop.has_value()) {
    box = *adjustment.crop;
  }
  volume::GridGeometry geometry = whole;
  for (int axis = 0; axis < 3; ++axis) {
    const std::int64_t size = whole.sample_dims[axis];
    if (box.end[axis] == std::numeric_limits<std::int64_t>::max()) {
      box.end[axis] = size;
    }
    if (box.begin[axis] >= box.end[axis] || box.end[axis] > size) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: --crop %d:%d on axis %c, which has %d samples, 0 to %d; expected a part of them",
          source->name(), box.begin[axis], box.end[axis], "xyz"[axis], size, size - 1));
    }
    geometry.sample_dims[axis] = (box.end[axis] - box.begin[axis] - 1) / adjustment.stride + 1;
    geometry.spacing[axis] = whole.spacing[axis] * static_cast<double>(adjustment.stride);
  }
  geometry.origin = math::TransformPoint(
      whole.world_from_index(), {static_cast<double>(box.begin.x), static_cast<double>(box.begin.y),
                                 static_cast<double>(box.begin.z)});
  const absl::Status valid = volume::Validate(geometry);
  if (!valid.ok()) {
    return absl::Status(
        valid.code(),
        absl::StrCat(source->name(), ": after --crop and --stride: ", valid.message()));
  }
  const std::optional<double> fill = source->is_resampled() ? std::nullopt : adjustment.fill;
  return std::make_unique<AdjustedSource>(std::move(source), geometry, box, adjustment.stride, fill,
                                          std::move(note));
}

std::unique_ptr<VolumeSeries> AdjustSeries(std::unique_ptr<VolumeSeries> series,
                                           const Adjustment& adjustment) {
  if (adjustment.is_none()) {
    return series;
  }
  return std::make_unique<AdjustedSeries>(std::move(series), adjustment);
}

}  // namespace isoscope::source
