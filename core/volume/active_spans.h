// Spans as they lie in a range table, or in a page of it: one of them, and which are active.

#ifndef ISOSCOPE_CORE_VOLUME_ACTIVE_SPANS_H_
#define ISOSCOPE_CORE_VOLUME_ACTIVE_SPANS_H_

#include <cstdint>

#include "absl/strings/string_view.h"
#include "absl/types/span.h"

#include "core/volume/inside_rule.h"
#include "core/volume/scalar_span.h"
#include "core/volume/scalar_type.h"

namespace isoscope::volume {

// Returns a span. REQUIRES: `bytes` holds more than `index` of them, as RangeTable::bytes().
ScalarSpan SpanAt(ScalarType type, absl::string_view bytes, std::int64_t index);

// Sets bit i % 64 of words[i / 64] iff span i is active by the rule. O(spans), times the logarithm
// of the labels.
//
// bytes: min and max of each span in turn, as RangeTable::bytes()
// words: one for each 64 spans or rest of them, all 0
void FindActiveSpans(ScalarType type, absl::string_view bytes, const InsideRule& rule,
                     absl::Span<std::uint64_t> words);

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_ACTIVE_SPANS_H_
