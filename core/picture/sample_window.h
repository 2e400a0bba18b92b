// Window and level of an image of samples: a range of values by shares of the samples.

#ifndef ISOSCOPE_CORE_PICTURE_SAMPLE_WINDOW_H_
#define ISOSCOPE_CORE_PICTURE_SAMPLE_WINDOW_H_

#include <optional>

#include "core/frame/appearance.h"
#include "core/frame/frame_spec.h"
#include "core/volume/sample_histogram.h"
#include "core/volume/scalar_span.h"
#include "core/volume/scalar_type.h"

namespace isoscope::picture {

// Returns the least sample that counts for the window of a frame's caps: the lowest isovalue of its
// opaque surfaces. None, if there is no such surface, or one that has labels: all samples count.
std::optional<double> LeastSampleOf(const frame::FrameSpec& spec);

// Returns the values at two percentiles of the finite samples; none if there are no such samples. A
// bin of one integer counts as that value. In other bins samples count as evenly spread. It is a
// fixed sequence of IEEE operations on the counts, so neither shards nor blocks can show. O(bins).
//
// least: only samples of at least this count; not set, or no sample is that large: all do
std::optional<volume::ScalarSpan> SpanOfPercentiles(volume::ScalarType type,
                                                    const volume::SampleHistogram& samples,
                                                    const frame::Percentiles& percentiles,
                                                    std::optional<double> least);

}  // namespace isoscope::picture

#endif  // ISOSCOPE_CORE_PICTURE_SAMPLE_WINDOW_H_
