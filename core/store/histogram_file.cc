#include "core/store/histogram_file.h"

#include <cstddef>

#include "absl/strings/str_format.h"

#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "core/base/status_macros.h"

namespace isoscope::store {
namespace {

// The most samples of a volume (volume::Validate): sums of counts up to it can't overflow.
constexpr std::int64_t kMaxSamples = std::int64_t{1} << 62;
constexpr std::int64_t kMaxFirst = std::int64_t{1} << 53;

bool IsValid(volume::ScalarType type, std::int64_t exponent, const volume::HistogramBins& bins) {
  const bool is_float =
      type == volume::ScalarType::kFloat32 || type == volume::ScalarType::kFloat64;
  return exponent >= (is_float ? volume::kMinHistogramExponent : 0) &&
         exponent <= volume::kMaxHistogramExponent && bins.first >= -kMaxFirst &&
         bins.first <= kMaxFirst && bins.count <= volume::kMaxHistogramBins;
}

}  // namespace

std::string EncodeHistogram(volume::ScalarType type, const volume::SampleHistogram& histogram) {
  std::string entries;
  for (const std::int64_t entry :
       {std::int64_t{histogram.bins.exponent}, histogram.bins.first, histogram.nan_count,
        histogram.negative_infinity_count, histogram.positive_infinity_count}) {
    base::AppendLittleEndian(entry, &entries);
  }
  for (const std::int64_t count : histogram.counts) {
    base::AppendLittleEndian(count, &entries);
  }
  return EncodeBinaryHeader(kHistogramMagic,
                            {.scalar_type = static_cast<std::uint32_t>(type),
                             .entry_size = sizeof(std::int64_t),
                             .count = static_cast<std::int64_t>(entries.size() / 8),
                             .payload_crc32c = base::Crc32c(entries)}) +
         entries;
}

absl::StatusOr<volume::SampleHistogram> DecodeHistogram(absl::string_view bytes,
                                                        volume::ScalarType type,
                                                        absl::string_view where) {
  ISOSCOPE_ASSIGN_OR_RETURN(const BinaryHeader header,
                            DecodeBinaryFile(kHistogramMagic, bytes, where));
  if (header.scalar_type != static_cast<std::uint32_t>(type) ||
      header.entry_size != sizeof(std::int64_t) || header.count < kHistogramPreambleEntries) {
    return absl::DataLossError(absl::StrFormat(
        "%s: header states %d entries of %d bytes, sample type %d; expected at least %d of 8, "
        "sample type %d",
        where, header.count, header.entry_size, header.scalar_type, kHistogramPreambleEntries,
        static_cast<int>(type)));
  }
  const auto entry = [&](std::int64_t i) {
    return base::LoadLittleEndian<std::int64_t>(bytes.data() + kBinaryHeaderBytes + 8 * i);
  };
  volume::SampleHistogram histogram;
  const std::int64_t exponent = entry(0);
  histogram.bins.first = entry(1);
  histogram.bins.count = header.count - kHistogramPreambleEntries;
  if (!IsValid(type, exponent, histogram.bins)) {
    return absl::DataLossError(absl::StrFormat(
        "%s: %d bins of 2^%d from %d on: at most %d, exponents of the sample type", where,
        histogram.bins.count, exponent, histogram.bins.first, volume::kMaxHistogramBins));
  }
  histogram.bins.exponent = static_cast<int>(exponent);
  std::int64_t total = 0;
  for (std::int64_t i = 2; i < header.count; ++i) {
    const std::int64_t count = entry(i);
    if (count < 0 || count > kMaxSamples - total) {
      return absl::DataLossError(absl::StrFormat(
          "%s: offset %d: a count of %d samples after %d; expected 0 or more, at most 2^62 in all",
          where, static_cast<std::int64_t>(kBinaryHeaderBytes) + 8 * i, count, total));
    }
    total += count;
    if (i >= kHistogramPreambleEntries) {
      histogram.counts.push_back(count);
    }
  }
  histogram.nan_count = entry(2);
  histogram.negative_infinity_count = entry(3);
  histogram.positive_infinity_count = entry(4);
  return histogram;
}

}  // namespace isoscope::store
