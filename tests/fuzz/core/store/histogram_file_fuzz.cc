// histogram.bin: an accepted histogram has counts that can be, and comes back from its encoding.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/store/histogram_file.h"
#include "tests/fuzz/core/store/sealed_bytes.h"
#include "tests/fuzz/fuzz_input.h"

namespace isoscope::fuzz {
namespace {

void Decode(absl::string_view bytes, volume::ScalarType type) {
  const auto histogram = store::DecodeHistogram(bytes, type, "h.bin");
  if (!histogram.ok()) {
    RequireError(histogram.status(),
                 {absl::StatusCode::kDataLoss, absl::StatusCode::kFailedPrecondition}, "h.bin");
    return;
  }
  Require(static_cast<std::size_t>(histogram->bins.count) == histogram->counts.size() &&
              histogram->bins.count <= volume::kMaxHistogramBins,
          "a histogram has a count for each bin");
  for (const std::int64_t count : histogram->counts) {
    Require(count >= 0, "no count is negative");
  }
  Require(histogram->TotalCount() >= 0, "the sum of the counts is a number of samples");
  const auto again =
      store::DecodeHistogram(store::EncodeHistogram(type, *histogram), type, "again");
  Require(again.ok() && *again == *histogram, "a histogram comes back from its encoding");
}

}  // namespace

std::vector<std::string> Seeds() {
  std::vector<std::string> seeds;
  for (int type = 1; type <= 8; ++type) {
    const auto scalar = static_cast<volume::ScalarType>(type);
    volume::SampleHistogram histogram;
    histogram.bins = volume::BinsOf(scalar, {0, 60});
    if (histogram.bins.count > 100) {  // floats: thousands of bins, which mutate slowly
      histogram.bins = {.exponent = 3, .first = 0, .count = 8};
    }
    histogram.counts.assign(static_cast<std::size_t>(histogram.bins.count), 7);
    seeds.push_back(std::string(1, static_cast<char>(type - 1)) +
                    store::EncodeHistogram(scalar, histogram));
    histogram.nan_count = 3;
    seeds.push_back(std::string(1, static_cast<char>(type - 1)) +
                    store::EncodeHistogram(scalar, histogram));
  }
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isoscope::fuzz::Input input(data, size);
  const auto type = static_cast<isoscope::volume::ScalarType>(1 + input.Byte() % 8);
  const absl::string_view bytes = input.Rest();
  isoscope::fuzz::Decode(bytes, type);
  isoscope::fuzz::Decode(isoscope::fuzz::SealedBinary(isoscope::store::kHistogramMagic, bytes),
                         type);
  return 0;
}
