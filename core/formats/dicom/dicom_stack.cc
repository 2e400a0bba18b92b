// StackSlices turns slices into one grid:
//
// 1. It sorts them by position along their normal.
// 2. CheckParallel: all have one orientation.
// 3. CheckAlike: all have one size, spacing of pixels, unit and frame of reference.
// 4. StackOf: no slice is there twice, and the gaps are even. Otherwise the stack is an error, or
//    its distances go to the resampler.
// 5. LineOf: the first pixels lie on the normal, or on one line that leans (a tilted gantry).
//
// Even gaps are within 1 % of their mean, and no slice is off its place by a tenth of a gap. The
// second rule is needed because small errors add up: if 100 gaps shrink from 1.009 to 0.991, the
// middle slice is 0.2 gaps off. Source: DICOM PS3.3, section C.7.6.2, "Image Plane Module".

#include "core/formats/dicom/dicom_stack.h"

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

// "a.dcm", or "a.dcm, frame 3".
std::string NameOf(const DicomSlice& slice) {
  return slice.frame < 0 ? slice.path : absl::StrFormat("%s, frame %d", slice.path, slice.frame);
}

bool IsParallel(const DicomSlice& a, const DicomSlice& b) {
  constexpr double kTolerance = 1e-3;  // of a direction
  return IsNear(a.direction.columns[0], b.direction.columns[0], kTolerance) &&
         IsNear(a.direction.columns[1], b.direction.columns[1], kTolerance);
}

// Checks that two parallel slices can be of one volume, apart from their positions.
absl::Status CheckAlike(const DicomSlice& slice, const DicomSlice& first) {
  if (slice.width != first.width || slice.height != first.height) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: %d x %d samples, but %s has %d x %d: expected slices of one size", NameOf(slice),
        slice.width, slice.height, NameOf(first), first.width, first.height));
  }
  constexpr double kTolerance = 1e-3;  // of a distance
  if (slice.has_spacing && first.has_spacing &&
      (std::abs(slice.spacing.x - first.spacing.x) > kTolerance * first.spacing.x ||
       std::abs(slice.spacing.y - first.spacing.y) > kTolerance * first.spacing.y)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: pixels of %g x %g, but %s has %g x %g: expected slices of one spacing", NameOf(slice),
        slice.spacing.x, slice.spacing.y, NameOf(first), first.spacing.x, first.spacing.y));
  }
  if (slice.value_unit != first.value_unit) {
    const auto described = [](const DicomSlice& of) {
      return of.value_unit.empty() ? "no unit" : absl::StrCat("values in ", of.value_unit);
    };
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: %s, but %s has %s (units (0054,1001) or rescale type (0028,1054)): expected slices "
        "of one quantity; give a folder with those of one",
        NameOf(slice), described(slice), NameOf(first), described(first)));
  }
  if (slice.frame_of_reference != first.frame_of_reference) {  // UIDs are not quoted
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: %s frame of reference (0020,0052), but %s has %s: their places can't be compared; "
        "give a folder with the slices of one",
        NameOf(slice), slice.frame_of_reference.empty() ? "no" : "another", NameOf(first),
        first.frame_of_reference.empty() ? "none" : "its own"));
  }
  return absl::OkStatus();
}

// The line on which the first pixels of sorted slices lie.
struct SliceLine {
  math::Vec3d direction{};  // of length 1
  double length = 0;        // from the first to the last one
  // The places of the slices along the line, from the first one on; none if they are even.
  std::vector<double> distances{};
};

// The line is the normal of the slices, or leans away from it where all of them do (a tilted
// gantry). REQUIRES: the slices lie at different positions.
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
          "stack (a tilted gantry is fine); resample it by another program first",
          NameOf(slice), math::Length(slice.origin - expected)));
    }
  }
  return line;
}

// Distances differ by this at most, relative to their mean. Positions are rounded texts.
constexpr double kMostOff = 0.01;
// A slice lies at most this beside its place in an even stack, in distances.
constexpr double kMostDrift = 0.1;
// A slice at less than this, in distances, behind another one is the same again.
constexpr double kDouble = 1e-3;

// Tells why slices at these gaps are no even stack. It names the gap that differs most from the
// usual one. `adds_up`: all differ by little, but their sum is too large.
absl::Status UnevenError(const std::vector<DicomSlice>& slices, const std::vector<double>& gaps,
                         double usual, bool adds_up) {
  const auto worst =
      static_cast<std::size_t>(std::max_element(gaps.begin(), gaps.end(),
                                                [usual](double a, double b) {
                                                  return std::abs(a - usual) < std::abs(b - usual);
                                                }) -
                               gaps.begin());
  const DicomSlice& before = slices[worst];
  const DicomSlice& behind = slices[worst + 1];
  const double steps = std::round(gaps[worst] / usual);
  const auto is_multiple = [usual](double gap) {
    const double count = std::round(gap / usual);
    return count >= 1 && std::abs(gap - count * usual) <= 2 * kMostOff * usual * count;
  };
  constexpr std::int64_t kMostMissing = 4;  // more are rather the gap between two stacks
  bool may_resample = true;
  std::string what = "expected slices at one distance";
  if (adds_up) {
    what = "all differ by little, but they add up; " + what;
  } else if (steps > 1 && std::all_of(gaps.begin(), gaps.end(), is_multiple)) {
    const auto missing = static_cast<std::int64_t>(steps) - 1;
    may_resample = missing <= kMostMissing;
    what = absl::StrFormat("%s%d %s missing between them", may_resample ? "" : "two stacks, or ",
                           missing, missing == 1 ? "slice is" : "slices are");
  }
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: %g behind %s, where %g is the usual distance of %d slices: %s; %s",
                      NameOf(behind), gaps[worst], NameOf(before), usual, slices.size(), what,
                      may_resample ? "--resample interpolates them onto even distances"
                                   : "give a folder with the slices of one stack"));
}

// Finds the line, with the distances along it if the slices are not even.
absl::StatusOr<SliceLine> StackOf(const std::vector<DicomSlice>& slices, const GridRules& rules) {
  std::vector<double> gaps;
  for (std::size_t i = 1; i < slices.size(); ++i) {
    gaps.push_back(slices[i].position - slices[i - 1].position);
  }
  const double height = slices.back().position - slices.front().position;
  const double mean = height / static_cast<double>(gaps.size());
  std::vector<double> sorted = gaps;
  std::sort(sorted.begin(), sorted.end());
  const double usual = sorted[(sorted.size() - 1) / 2];
  bool is_near = true;  // all gaps are
  bool is_even = true;
  for (std::size_t i = 0; i < gaps.size(); ++i) {
    if (!(gaps[i] > kDouble * mean)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s and %s lie at one place: the slice is there twice; remove one of them",
          NameOf(slices[i]), NameOf(slices[i + 1])));
    }
    const double even = slices.front().position + mean * static_cast<double>(i + 1);
    is_near = is_near && std::abs(gaps[i] - mean) <= kMostOff * mean;
    is_even = is_even && is_near && std::abs(slices[i + 1].position - even) <= kMostDrift * mean;
  }
  if (!is_even && !rules.resamples) {
    return UnevenError(slices, gaps, usual, is_near);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(SliceLine line, LineOf(slices));
  for (std::size_t i = 0; !is_even && i < slices.size(); ++i) {
    line.distances.push_back((slices[i].position - slices.front().position) *
                             (line.length / height));
  }
  return line;
}

}  // namespace

absl::Status CheckParallel(const std::vector<DicomSlice>& slices, const std::string& name) {
  struct Orientation {
    const DicomSlice* slice;
    std::size_t count;
  };
  constexpr std::size_t kMostCounted = 64;
  std::vector<Orientation> orientations;
  for (const DicomSlice& slice : slices) {
    if (orientations.size() == kMostCounted) {
      break;
    }
    const auto same = std::find_if(
        orientations.begin(), orientations.end(),
        [&slice](const Orientation& other) { return IsParallel(slice, *other.slice); });
    if (same != orientations.end()) {
      ++same->count;
    } else {
      orientations.push_back({.slice = &slice, .count = 1});
    }
  }
  if (orientations.size() <= 1) {
    return absl::OkStatus();
  }
  constexpr std::size_t kMostListed = 4;
  std::string list;
  for (std::size_t i = 0; i < std::min(orientations.size(), kMostListed); ++i) {
    absl::StrAppend(&list, list.empty() ? "" : "; ", orientations[i].count, " as ",
                    NameOf(*orientations[i].slice));
  }
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: slices of %d orientations%s (%s%s): several stacks, as of a localizer; expected "
      "parallel "
      "slices: give a folder with those of one",
      name, orientations.size(), orientations.size() == kMostCounted ? " or more" : "", list,
      orientations.size() > kMostListed ? "; ..." : ""));
}

absl::StatusOr<SliceStack> StackSlices(std::vector<DicomSlice>* slices, const std::string& name,
                                       const GridRules& rules) {
  // 1. By position.
  std::stable_sort(slices->begin(), slices->end(), [](const DicomSlice& a, const DicomSlice& b) {
    return a.position < b.position;
  });
  // 2. One orientation.
  ISOSCOPE_RETURN_IF_ERROR(CheckParallel(*slices, name));
  // 3. Slices like the first one that tells the spacing of its pixels. The user's spacing can't be
  // right for slices that tell different ones.
  const auto says = std::find_if(slices->begin(), slices->end(),
                                 [](const DicomSlice& slice) { return slice.has_spacing; });
  const DicomSlice& stated = says == slices->end() ? slices->front() : *says;
  for (const DicomSlice& slice : *slices) {
    ISOSCOPE_RETURN_IF_ERROR(CheckAlike(slice, stated));
  }
  const DicomSlice& first = slices->front();
  if (slices->size() < 2) {
    return absl::InvalidArgumentError(
        absl::StrCat(name, ": a series of one slice (", first.path, "); expected two or more"));
  }
  // 4. Even gaps, and 5. one line.
  ISOSCOPE_ASSIGN_OR_RETURN(SliceLine line, StackOf(*slices, rules));
  SliceStack stack{.distances = std::move(line.distances)};
  volume::GridGeometry& geometry = stack.geometry;
  geometry.sample_dims = {first.width, first.height, static_cast<std::int64_t>(slices->size())};
  geometry.spacing = {stated.spacing.x, stated.spacing.y,
                      line.length / static_cast<double>(slices->size() - 1)};
  geometry.origin = first.origin;
  geometry.direction = first.direction;
  geometry.direction.columns[2] = line.direction;
  return stack;
}

}  // namespace isoscope::source
