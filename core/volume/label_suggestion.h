// Whether the samples of a volume are labels, and which to show first. docs/labels.md, "What opens as
// labels", tells the rule to people.

#ifndef ISOSCOPE_CORE_VOLUME_LABEL_SUGGESTION_H_
#define ISOSCOPE_CORE_VOLUME_LABEL_SUGGESTION_H_

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/volume/label.h"
#include "core/volume/sample_histogram.h"
#include "core/volume/scalar_type.h"

namespace isoscope::volume {

// The most labels that are suggested: as many as a frame has surfaces.
inline constexpr std::size_t kMaxSuggestedLabels = 128;
// Samples below this number tell too little: 32^3.
inline constexpr std::int64_t kMinLabelSamples = 32768;
// Up to this number of different values, any integers but a ramp are labels. Of more values, counts
// must jump up and down from one value to the next; those of images go along smooth curves.
inline constexpr std::size_t kFewLabelValues = 16;

// Returns the labels to begin with: ascending, none is 0, at most kMaxSuggestedLabels; of more, those
// with the most samples. Empty: the samples are no labels, or too few to tell.
//
// - If the dataset names labels, and at least half of the bins that have samples hold a named value
//   or 0: the named ones that samples have.
// - Else, of integers in exact bins, whose counts pass the rule above: all values but 0.
//
// samples: of the whole volume
// named:   ascending by value
std::vector<double> SuggestLabels(ScalarType type, const SampleHistogram& samples,
                                  const std::vector<Label>& named);

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_LABEL_SUGGESTION_H_
