// The file histogram.bin of a shard (docs/format/histogram.md).

#ifndef ISOSCOPE_CORE_STORE_HISTOGRAM_FILE_H_
#define ISOSCOPE_CORE_STORE_HISTOGRAM_FILE_H_

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/store/shard_format.h"
#include "core/volume/sample_histogram.h"
#include "core/volume/scalar_type.h"

namespace isoscope::store {

// Numbers of 8 bytes in front of the counts: exponent, first bin, NaN, -inf, +inf.
inline constexpr std::int64_t kHistogramPreambleEntries = 5;
inline constexpr std::int64_t kMaxHistogramFileBytes =
    static_cast<std::int64_t>(kBinaryHeaderBytes) +
    8 * (kHistogramPreambleEntries + volume::kMaxHistogramBins);

// Returns the bytes of histogram.bin.
std::string EncodeHistogram(volume::ScalarType type, const volume::SampleHistogram& histogram);
// Decodes a histogram.bin of samples of `type`. `where` names the file in messages. DATA_LOSS if it
// is damaged or contradicts itself, FAILED_PRECONDITION if it has a newer version.
absl::StatusOr<volume::SampleHistogram> DecodeHistogram(absl::string_view bytes,
                                                        volume::ScalarType type,
                                                        absl::string_view where);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_HISTOGRAM_FILE_H_
