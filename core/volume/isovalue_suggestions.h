// Suggests isovalues from a histogram alone.

#ifndef ISOSCOPE_CORE_VOLUME_ISOVALUE_SUGGESTIONS_H_
#define ISOSCOPE_CORE_VOLUME_ISOVALUE_SUGGESTIONS_H_

#include <cstdint>
#include <vector>

#include "core/volume/sample_histogram.h"
#include "core/volume/scalar_type.h"

namespace isoscope::volume {

enum class SuggestionMethod {
  // Between the two classes of samples whose means differ most for their sizes.
  // Source: Otsu 1979, "A threshold selection method from gray-level histograms".
  kBetweenClasses,
  // The level that encloses 1 % of the samples.
  kOnePercent,
};

struct IsovalueSuggestion {
  SuggestionMethod method = SuggestionMethod::kBetweenClasses;
  double isovalue = 0;         // active somewhere: above the smallest sample, at most the largest
  double inside_fraction = 0;  // of the finite samples counted, those inside: in (0, 1)
};

// Returns the suggestions, at most one of each method, in their order, for the samples in bins
// [begin, end). None if they all lie in one bin. Exact for integers with a bin for each value.
//
// kBetweenClasses: the middle of the gap between the last sample of the lower class and the first
// of the upper one; of classes that are equally good, the middle of all their gaps. kOnePercent:
// the largest edge of a bin with at least 1 % of the samples above it; if that is the smallest
// sample, the next larger one, which encloses less. Integers: 1/2 below, which encloses the same
// samples and does not pass through any.
std::vector<IsovalueSuggestion> SuggestIsovalues(ScalarType type, const SampleHistogram& histogram,
                                                 std::int64_t begin, std::int64_t end);

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_ISOVALUE_SUGGESTIONS_H_
