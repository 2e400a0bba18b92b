#include "core/formats/dicom/segment_places.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "absl/strings/str_format.h"

#include "core/formats/dicom/dicom_child.h"
#include "core/math/vec.h"

namespace isoscope::source {
namespace {

// Returns true if two frames of one plane cover the same pixels. Positions are rounded texts.
bool AreAlike(const DicomSlice& a, const DicomSlice& b, double tolerance) {
  return math::Length(a.origin - b.origin) <= tolerance &&
         math::Length(a.direction.columns[0] - b.direction.columns[0]) <= 1e-3 &&
         math::Length(a.direction.columns[1] - b.direction.columns[1]) <= 1e-3;
}

}  // namespace

absl::StatusOr<SegmentPlaces> PlacesOfFrames(std::vector<DicomSlice> frames) {
  std::stable_sort(frames.begin(), frames.end(), [](const DicomSlice& a, const DicomSlice& b) {
    return a.position < b.position;
  });
  SegmentPlaces places;
  for (const DicomSlice& frame : frames) {
    const double pixel = std::min(frame.spacing.x, frame.spacing.y);
    if (places.slices.empty() ||
        !(frame.position - places.slices.back().position <= 1e-3 * pixel)) {
      places.slices.push_back(frame);
      places.slices.back().frame = static_cast<std::int64_t>(places.frames.size());
      places.frames.emplace_back();
    } else if (!AreAlike(frame, places.slices.back(), 1e-2 * pixel)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: frames %d and %d lie in one plane, but begin %g apart or are turned: tiles, no "
          "slices of a volume",
          frame.path, places.frames.back().front(), frame.frame,
          math::Length(frame.origin - places.slices.back().origin)));
    }
    places.frames.back().push_back(static_cast<std::size_t>(frame.frame));
  }
  return places;
}

absl::StatusOr<std::vector<DicomSlice>> WithEmptyPlaces(const std::vector<DicomSlice>& places,
                                                        double named_distance) {
  double distance = std::numeric_limits<double>::infinity();
  for (std::size_t i = 1; i < places.size(); ++i) {
    distance = std::min(distance, places[i].position - places[i - 1].position);
  }
  if (named_distance > 0 && named_distance <= 1.01 * distance) {
    distance = named_distance;
  }
  std::vector<DicomSlice> slices;
  for (const DicomSlice& place : places) {
    if (slices.empty()) {
      slices.push_back(place);
      continue;
    }
    const DicomSlice before = slices.back();
    const double gap = place.position - before.position;
    const double steps = std::round(gap / distance);
    if (!(steps >= 1 && std::abs(gap - steps * distance) <= 0.01 * gap)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: planes lie %g apart, which is no multiple of their distance %g: expected even "
          "distances, because numbers of segments can't be interpolated",
          place.path, gap, distance));
    }
    if (static_cast<double>(slices.size()) + steps > double{kMaxDicomFrames}) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: planes lie %g apart, which at a distance of %g makes more than %d planes",
          place.path, gap, distance, kMaxDicomFrames));
    }
    for (double step = 1; step < steps; ++step) {
      DicomSlice empty = before;
      empty.frame = -1;
      empty.origin = before.origin + (place.origin - before.origin) * (step / steps);
      empty.position = before.position + gap * (step / steps);
      slices.push_back(empty);
    }
    slices.push_back(place);
  }
  return slices;
}

}  // namespace isoscope::source
