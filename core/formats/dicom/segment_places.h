// Where the frames of a segmentation lie: several at one place, and none at some.

#ifndef ISOSCOPE_CORE_FORMATS_DICOM_SEGMENT_PLACES_H_
#define ISOSCOPE_CORE_FORMATS_DICOM_SEGMENT_PLACES_H_

#include <cstddef>
#include <vector>

#include "absl/status/statusor.h"

#include "core/formats/dicom/dicom_steps.h"

namespace isoscope::source {

struct SegmentPlaces {
  std::vector<DicomSlice> slices;                // one a place, by position; `frame` is the place
  std::vector<std::vector<std::size_t>> frames;  // of each place, in the order of the file
};

// Divides frames, one at least, by their places. INVALID_ARGUMENT: frames in one plane that begin
// at different points or are turned, as tiles are.
absl::StatusOr<SegmentPlaces> PlacesOfFrames(std::vector<DicomSlice> frames);

// Returns the places, with slices of frame -1 between them where places are left out. They lie at
// multiples of `named_distance`, or of the smallest distance if that is smaller or `named_distance`
// is 0.
// INVALID_ARGUMENT: a gap that is no multiple of it (within 1 %), or more than kMaxDicomFrames.
absl::StatusOr<std::vector<DicomSlice>> WithEmptyPlaces(const std::vector<DicomSlice>& places,
                                                        double named_distance);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_DICOM_SEGMENT_PLACES_H_
