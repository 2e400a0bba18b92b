// ranges.bin: an accepted table answers as a scan of its own entries, and comes back from its
// encoding.

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/store/shard_writer.h"
#include "tests/fuzz/core/store/sealed_bytes.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/unit/core/store/shard_fixture.h"

namespace isoscope::fuzz {
namespace {

void CheckActiveBlocks(const volume::RangeTable& ranges, double isovalue) {
  const volume::BlockSet active = ranges.ActiveBlocks(isovalue);
  for (std::int64_t i = 0; i < ranges.block_count(); ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    Require(active.Contains(id) == volume::IsActive(ranges.Get(id), isovalue),
            "a block is active if its span says so");
  }
}

void Decode(absl::string_view bytes) {
  const auto ranges = store::DecodeRangeTable(bytes, "r.bin");
  if (!ranges.ok()) {
    RequireError(ranges.status(),
                 {absl::StatusCode::kDataLoss, absl::StatusCode::kFailedPrecondition}, "r.bin");
    return;
  }
  Require(ranges->bytes().size() == bytes.size() - store::kBinaryHeaderBytes,
          "a table holds all entries of its file");
  for (const double isovalue : {0.0, -1.5, 1e300}) {
    CheckActiveBlocks(*ranges, isovalue);
  }
  if (ranges->block_count() > 0) {
    const volume::ScalarSpan first = ranges->Get(0);
    for (const double isovalue : {first.min, first.max}) {
      if (std::isfinite(isovalue)) {
        CheckActiveBlocks(*ranges, isovalue);
      }
    }
  }
  const auto again = store::DecodeRangeTable(store::EncodeRangeTable(*ranges), "again");
  Require(again.ok() && again->bytes() == ranges->bytes() && again->type() == ranges->type(),
          "a table comes back from its encoding");
}

}  // namespace

std::vector<std::string> Seeds() {
  std::vector<std::string> seeds;
  for (int type = 1; type <= 8; ++type) {
    const store::TestDataset dataset(static_cast<volume::ScalarType>(type));
    seeds.push_back(store::EncodeRangeTable(dataset.ranges));
  }
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const absl::string_view bytes(reinterpret_cast<const char*>(data), size);
  isoscope::fuzz::Decode(bytes);
  isoscope::fuzz::Decode(isoscope::fuzz::SealedBinary(isoscope::store::kRangeTableMagic, bytes));
  return 0;
}
