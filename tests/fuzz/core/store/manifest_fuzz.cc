// manifest.json: an accepted manifest is valid, and comes back from its own encoding.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/store/manifest.h"
#include "core/store/shard_format.h"
#include "core/volume/grid_geometry.h"
#include "tests/fuzz/core/store/sealed_bytes.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/unit/core/store/shard_fixture.h"

namespace isoscope::fuzz {
namespace {

void Decode(absl::string_view bytes) {
  const auto manifest = store::DecodeManifest(bytes, "m.json");
  if (!manifest.ok()) {
    RequireError(manifest.status(),
                 {absl::StatusCode::kDataLoss, absl::StatusCode::kFailedPrecondition}, "m.json");
    return;
  }
  Require(volume::Validate(manifest->geometry).ok(), "an accepted manifest has a valid grid");
  Require(volume::BlockLayout::Make(manifest->geometry.sample_dims, manifest->block_cells).ok(),
          "an accepted manifest has blocks that can be laid out");
  Require(!manifest->shards.empty() &&
              manifest->shards.size() <= static_cast<std::size_t>(store::kMaxShardCount),
          "an accepted manifest has as many shards as there may be");
  const auto again = store::DecodeManifest(store::EncodeManifest(*manifest), "again");
  Require(again.ok() && *again == *manifest, "a manifest comes back from its encoding");
}

}  // namespace

std::vector<std::string> Seeds() {
  std::vector<std::string> seeds;
  for (const volume::ScalarType type : {volume::ScalarType::kUint8, volume::ScalarType::kFloat64}) {
    store::TestDataset dataset(type);
    store::Manifest& manifest = dataset.manifest;
    manifest.shards = {{.block_count = dataset.layout.block_count(), .block_bytes = 700}};
    manifest.dataset_id = store::ComputeDatasetId(manifest);
    seeds.push_back(store::EncodeManifest(manifest));
    manifest.samples_digest = "00112233445566778899aabbccddeeff";
    manifest.max_gradient_magnitude = 2.5;
    manifest.patient_frame.emplace();
    manifest.dataset_id = store::ComputeDatasetId(manifest);
    seeds.push_back(store::EncodeManifest(manifest));
    manifest.labels = {{.value = 1, .name = "left", .color = volume::LabelColor{1, 2, 3}},
                       {.value = 2.5}};
    seeds.push_back(store::EncodeManifest(manifest));
    manifest.levels = {
        {.dataset_id = "ffeeddccbbaa99887766554433221100", .manifest_crc32c = 0x89abcdef}};
    seeds.push_back(store::EncodeManifest(manifest));
  }
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const absl::string_view bytes(reinterpret_cast<const char*>(data), size);
  isoscope::fuzz::Decode(bytes);
  isoscope::fuzz::Decode(isoscope::fuzz::SealedText(bytes));
  return 0;
}
