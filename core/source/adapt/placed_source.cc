// PlaceSource changes the geometry of a source and passes its samples on:
//
// 1. Validate checks the numbers of the user. A direction has columns of length 1 at right angles.
// 2. PlacedGrid replaces spacing, origin or direction, and checks the whole grid.
// 3. The note names each member that has changed: "the grid is not that of the file: spacing 1, 1,
//    4 in place of 1, 1, 1".
//
// Sample dimensions never change. MoveSource leaves the note as it is, for files without a grid.

#include "core/source/adapt/placed_source.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/source/grid/affine_grid.h"

namespace isoscope::source {
namespace {

class PlacedSource final : public VolumeSource {
 public:
  PlacedSource(SourceInfo info, std::unique_ptr<VolumeSource> source)
      : VolumeSource(std::move(info)), source_(std::move(source)) {}
  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    return source_->ReadRows(begin_row, end_row, out);
  }
  absl::Status ReadBand(std::int64_t begin_z, std::int64_t end_z, std::int64_t begin_y,
                        std::int64_t end_y, char* out) override {
    return source_->ReadBand(begin_z, end_z, begin_y, end_y, out);
  }
  void HeedCancellation(const base::Cancellation* cancellation) override {
    source_->HeedCancellation(cancellation);
  }
  [[nodiscard]] std::optional<BoxGrid> box_grid() const override { return source_->box_grid(); }
  [[nodiscard]] std::int64_t decoding_factor() const override { return source_->decoding_factor(); }
  [[nodiscard]] absl::Status ReadBox(const math::IndexBox& box, char* out,
                                     const base::Cancellation& cancellation) const override {
    return source_->ReadBox(box, out, cancellation);
  }

 private:
  const std::unique_ptr<VolumeSource> source_;
};

class PlacedSeries final : public VolumeSeries {
 public:
  PlacedSeries(std::unique_ptr<VolumeSeries> series, const GridOverride& grid)
      : VolumeSeries(series->info()), series_(std::move(series)), grid_(grid) {}

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> source,
                              series_->Open(field, component, step));
    return PlaceSource(std::move(source), grid_);
  }
  absl::StatusOr<std::optional<std::vector<std::string>>> FilesOfStep(int step) override {
    return series_->FilesOfStep(step);
  }

 private:
  const std::unique_ptr<VolumeSeries> series_;
  const GridOverride grid_;
};

std::string TextOf(const math::Vec3d& v) { return absl::StrFormat("%g, %g, %g", v.x, v.y, v.z); }

// Rows, as --direction takes them.
std::string TextOf(const math::Mat3d& matrix) {
  const auto& [x, y, z] = matrix.columns;
  return absl::StrFormat("%g, %g, %g; %g, %g, %g; %g, %g, %g", x.x, y.x, z.x, x.y, y.y, z.y, x.z,
                         y.z, z.z);
}

// "spacing 1, 1, 4 in place of 1, 1, 1", for people.
template <typename T>
void AddChange(const char* what, const T& given, const T& of_file, std::string* note) {
  absl::StrAppend(note, note->empty() ? "the grid is not that of the file: " : "; ", what, " ",
                  TextOf(given), " in place of ", TextOf(of_file));
}

absl::Status CheckDirection(const math::Mat3d& direction) {
  constexpr double kTolerance = 0.0003;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double length = math::Length(direction.columns[axis]);
    if (!(std::abs(length - 1) <= kTolerance)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "--direction: axis %c has a direction of length %g; expected 1: the distances of samples "
          "are for --spacing",
          "xyz"[axis], length));
    }
  }
  if (const std::optional<Shear> shear = FindShear(direction); shear.has_value()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("--direction: axes %c and %c meet at %.2f degrees; expected 90",
                        "xyz"[shear->first_axis], "xyz"[shear->second_axis], DegreesOf(*shear)));
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status Validate(const GridOverride& grid) {
  const auto& [spacing, origin, direction] = grid;
  if (spacing.has_value() &&
      (!math::IsFinite(*spacing) || !(spacing->x > 0 && spacing->y > 0 && spacing->z > 0))) {
    return absl::InvalidArgumentError(
        absl::StrCat("--spacing: ", TextOf(*spacing), ": each must be finite and greater than 0"));
  }
  if (origin.has_value() && !math::IsFinite(*origin)) {
    return absl::InvalidArgumentError(
        absl::StrCat("--origin: ", TextOf(*origin), ": each must be finite"));
  }
  return direction.has_value() ? CheckDirection(*direction) : absl::OkStatus();
}

absl::StatusOr<volume::GridGeometry> PlacedGrid(const volume::GridGeometry& geometry,
                                                const GridOverride& grid, const std::string& name) {
  ISOSCOPE_RETURN_IF_ERROR(Validate(grid));
  volume::GridGeometry placed = geometry;
  placed.spacing = grid.spacing.value_or(placed.spacing);
  placed.origin = grid.origin.value_or(placed.origin);
  placed.direction = grid.direction.value_or(placed.direction);
  if (const absl::Status valid = volume::Validate(placed); !valid.ok()) {
    return absl::Status(
        valid.code(),
        absl::StrCat(name, ": after --spacing, --origin and --direction: ", valid.message()));
  }
  return placed;
}

std::unique_ptr<VolumeSource> MoveSource(std::unique_ptr<VolumeSource> source,
                                         const volume::GridGeometry& geometry) {
  SourceInfo info = source->info();
  info.geometry = geometry;
  return std::make_unique<PlacedSource>(std::move(info), std::move(source));
}

absl::StatusOr<std::unique_ptr<VolumeSource>> PlaceSource(std::unique_ptr<VolumeSource> source,
                                                          const GridOverride& grid) {
  if (grid.is_none()) {
    return source;
  }
  SourceInfo info = source->info();
  if (grid.spacing.has_value() && info.is_resampled) {
    return absl::InvalidArgumentError(
        absl::StrCat(info.name, ": --spacing: ", info.note,
                     ": the distances are those of the file; leave --spacing out, or --resample"));
  }
  const volume::GridGeometry& of_file = source->info().geometry;
  ISOSCOPE_ASSIGN_OR_RETURN(info.geometry, PlacedGrid(of_file, grid, info.name));
  const volume::GridGeometry& placed = info.geometry;
  std::string note;
  if (grid.spacing.has_value() && placed.spacing != of_file.spacing) {
    AddChange("spacing", placed.spacing, of_file.spacing, &note);
  }
  if (grid.origin.has_value() && placed.origin != of_file.origin) {
    AddChange("origin", placed.origin, of_file.origin, &note);
  }
  if (grid.direction.has_value() && !(placed.direction == of_file.direction)) {
    AddChange("direction", placed.direction, of_file.direction, &note);
  }
  absl::StrAppend(&info.note, info.note.empty() || note.empty() ? "" : "; ", note);
  return std::make_unique<PlacedSource>(std::move(info), std::move(source));
}

std::unique_ptr<VolumeSeries> PlaceSeries(std::unique_ptr<VolumeSeries> series,
                                          const GridOverride& grid) {
  if (grid.is_none()) {
    return series;
  }
  return std::make_unique<PlacedSeries>(std::move(series), grid);
}

}  // namespace isoscope::source
