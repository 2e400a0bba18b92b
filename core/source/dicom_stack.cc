#include "core/source/dicom_stack.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"

namespace isoscope::source {
namespace {

bool IsNear(const math::Vec3d& a, const math::Vec3d& b, double tolerance) {
  return math::Length(a - b) <= tolerance;
}

// Checks that two slices can be of one volume, apart from their positions.
absl::Status CheckAlike(const DicomSlice& slice, const DicomSlice& first) {
  if (slice.width != first.width || slice.height != first.height || slice.type != first.type) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: %d x %d samples of %s, but %s has %d x %d of %s: expected slices of one size and "
        "type",
        slice.path, slice.width, slice.height, volume::NameOf(slice.type), first.path, first.width,
        first.height, volume::NameOf(first.type)));
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    if (!IsNear(slice.direction.columns[axis], first.direction.columns[axis], 1e-3)) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: its orientation differs from that of %s: expected parallel slices",
                          slice.path, first.path));
    }
  }
  if (std::abs(slice.spacing.x - first.spacing.x) > 1e-3 * first.spacing.x ||
      std::abs(slice.spacing.y - first.spacing.y) > 1e-3 * first.spacing.y) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: pixels of %g x %g, but %s has %g x %g: expected slices of one spacing", slice.path,
        slice.spacing.x, slice.spacing.y, first.path, first.spacing.x, first.spacing.y));
  }
  return absl::OkStatus();
}

// The line on which the first pixels of sorted slices lie.
struct SliceLine {
  math::Vec3d direction{};  // of length 1
  double length = 0;        // from the first to the last one
  // Along the line, from the first one on; none if they are even (within 1 %).
  std::vector<double> distances{};
};

// The line is the normal of the slices, or leans away from it where all of them do (a tilted
// gantry).
absl::StatusOr<SliceLine> LineOf(const std::vector<DicomSlice>& slices) {
  const DicomSlice& first = slices.front();
  const DicomSlice& last = slices.back();
  const double height = last.position - first.position;
  const double tolerance =
      0.01 * height / static_cast<double>(slices.size() - 1) + 0.01 * first.spacing.x;
  SliceLine line{.direction = first.direction.columns[2], .length = height};
  const math::Vec3d whole = last.origin - first.origin;
  if (!IsNear(whole, line.direction * height, tolerance)) {
    line.length = math::Length(whole);
    line.direction = whole * (1 / line.length);
  }
  for (const DicomSlice& slice : slices) {
    const math::Vec3d expected =
        first.origin + line.direction * (line.length * (slice.position - first.position) / height);
    if (!IsNear(slice.origin, expected, tolerance)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: begins %g beside the line from the first to the last slice: expected a straight "
          "stack (a tilted gantry is fine); resample it first",
          slice.path, math::Length(slice.origin - expected)));
    }
  }
  return line;
}

absl::Status UnevenError(const DicomSlice& slice, const DicomSlice& before, double gap, double mean,
                         std::size_t count, bool is_gap) {
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: %g behind %s, where %g is the mean distance of %d slices: expected slices at one "
      "distance (%sthere twice)%s",
      slice.path, gap, before.path, mean, count, is_gap ? "one is missing, or " : "it is ",
      is_gap ? "; --resample interpolates them onto even distances" : ""));
}

// Finds the line, with the distances along it if the slices are not even.
absl::StatusOr<SliceLine> StackOf(const std::vector<DicomSlice>& slices, const GridRules& rules) {
  const auto gaps = static_cast<double>(slices.size() - 1);
  const double mean = (slices.back().position - slices.front().position) / gaps;
  bool is_even = true;
  for (std::size_t i = 1; i < slices.size(); ++i) {
    const double gap = slices[i].position - slices[i - 1].position;
    const bool is_gap = gap > 1e-3 * mean;
    const bool is_usual = std::abs(gap - mean) <= 0.01 * mean && mean > 0;
    if (!is_usual && !(rules.resamples && is_gap)) {
      return UnevenError(slices[i], slices[i - 1], gap, mean, slices.size(), is_gap);
    }
    is_even = is_even && is_usual;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(SliceLine line, LineOf(slices));
  for (std::size_t i = 0; !is_even && i < slices.size(); ++i) {
    line.distances.push_back((slices[i].position - slices.front().position) *
                             (line.length / (mean * gaps)));
  }
  return line;
}

}  // namespace

absl::StatusOr<SliceStack> StackSlices(std::vector<DicomSlice>* slices, const std::string& name,
                                       const GridRules& rules) {
  std::stable_sort(slices->begin(), slices->end(), [](const DicomSlice& a, const DicomSlice& b) {
    return a.position < b.position;
  });
  const DicomSlice& first = slices->front();
  for (const DicomSlice& slice : *slices) {
    ISOSCOPE_RETURN_IF_ERROR(CheckAlike(slice, first));
  }
  if (slices->size() < 2) {
    return absl::InvalidArgumentError(
        absl::StrCat(name, ": a series of one slice (", first.path, "); expected two or more"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(SliceLine line, StackOf(*slices, rules));
  SliceStack stack{.distances = std::move(line.distances)};
  volume::GridGeometry& geometry = stack.geometry;
  geometry.sample_dims = {first.width, first.height, static_cast<std::int64_t>(slices->size())};
  geometry.spacing = {first.spacing.x, first.spacing.y,
                      line.length / static_cast<double>(slices->size() - 1)};
  geometry.origin = first.origin;
  geometry.direction = first.direction;
  geometry.direction.columns[2] = line.direction;
  return stack;
}

}  // namespace isoscope::source
