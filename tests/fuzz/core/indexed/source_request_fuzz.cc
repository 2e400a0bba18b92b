// The index-only part of a manifest: where its samples lie, and the request that opens their source.
// An input is a byte, and either members of a request, a name and its text each; or a manifest.

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"

#include "core/formats/open_request.h"
#include "core/indexed/source_request.h"
#include "core/store/manifest.h"
#include "core/store/shard_format.h"
#include "core/volume/scalar_type.h"
#include "tests/fuzz/core/store/sealed_bytes.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/unit/core/store/shard_fixture.h"

namespace isoscope::fuzz {
namespace {

using Members = std::map<std::string, std::string>;

// As partitioning writes them.
void RequireGoodRequest(const source::OpenRequest& request) {
  Require(request.stride >= 1, "an accepted request has a stride");
  if (request.raw.has_value()) {
    const math::Index3& dims = request.raw->dims;
    Require(dims.x >= 1 && dims.y >= 1 && dims.z >= 1 && request.raw->header_bytes >= 0,
            "accepted raw samples have a size");
  }
  if (request.crop.has_value()) {
    for (int axis = 0; axis < 3; ++axis) {
      Require(request.crop->begin[axis] >= 0 && request.crop->begin[axis] < request.crop->end[axis],
              "an accepted crop has samples");
    }
  }
  if (request.steps.has_value()) {
    Require(request.steps->first >= 0 && request.steps->stride >= 1, "accepted steps are steps");
  }
}

void Decode(const Members& members) {
  const auto request = indexed::DecodeSourceRequest(members, "m.json");
  if (!request.ok()) {
    RequireError(request.status(),
                 {absl::StatusCode::kDataLoss, absl::StatusCode::kFailedPrecondition}, "m.json");
    return;
  }
  RequireGoodRequest(*request);
  // Paths of this machine are resolved where they are encoded: an address stands for them.
  source::OpenRequest at_address = *request;
  at_address.path = "https://host/a";
  const auto encoded = indexed::EncodeSourceRequest(at_address);
  Require(encoded.ok(), "an accepted request can be recorded");
  const auto again = indexed::DecodeSourceRequest(*encoded, "again");
  Require(again.ok() && *indexed::EncodeSourceRequest(*again) == *encoded,
          "a request comes back from its members");
}

void DecodeManifest(absl::string_view bytes) {
  const auto manifest = store::DecodeManifest(bytes, "m.json");
  if (!manifest.ok()) {
    RequireError(manifest.status(),
                 {absl::StatusCode::kDataLoss, absl::StatusCode::kFailedPrecondition}, "m.json");
    return;
  }
  const auto again = store::DecodeManifest(store::EncodeManifest(*manifest), "again");
  Require(again.ok() && *again == *manifest, "a manifest comes back from its encoding");
  if (!manifest->in_source.has_value()) {
    return;
  }
  const store::SourceSamples& samples = *manifest->in_source;
  auto bytes_of_unit = static_cast<double>(volume::SizeOf(manifest->scalar_type));
  for (int axis = 0; axis < 3; ++axis) {
    Require(samples.unit_dims[axis] >= 1 && samples.unit_origin[axis] <= 0 &&
                samples.unit_origin[axis] > -samples.unit_dims[axis],
            "the first unit has the first sample");
    bytes_of_unit *= static_cast<double>(samples.unit_dims[axis]);
  }
  Require(bytes_of_unit <= static_cast<double>(store::kMaxUnitBytes),
          "an accepted unit is bounded");
  Require(samples.request.count("path") == 1, "an accepted manifest names its source");
  Decode(samples.request);
}

std::string SeedOf(const Members& members) {
  std::string seed(1, '\0');
  for (const auto& [name, text] : members) {
    absl::StrAppend(&seed, MakePiece(name), MakePiece(text));
  }
  return seed;
}

}  // namespace

std::vector<std::string> Seeds() {
  const std::vector<Members> requests = {
      {{"path", "/data/run.raw"},
       {"raw", "512,256,128 uint16 big 352"},
       {"crop", "0:64,1:65,2:66"},
       {"stride", "3"},
       {"fill", "-0.10000000000000001"},
       {"steps", "2:2:1"},
       {"fields", "u, v\nw"},
       {"axes", "ZYX"},
       {"ignores_shear", "yes"}},
      {{"path", "https://host/a.zarr/0"}, {"format", "zarr"}, {"resamples", "yes"}},
      {{"path", "s3://bucket/a.h5:t"}, {"fill", "nan"}, {"steps", "0:-1:1"}},
      {{"path", "/data/scan"}, {"dicom_series", "1.2.840.1"}, {"fill", "inf"}, {"stride", "1"}}};
  std::vector<std::string> seeds;
  for (const Members& members : requests) {
    seeds.push_back(SeedOf(members));
    store::TestDataset dataset(volume::ScalarType::kUint16);
    store::Manifest& manifest = dataset.manifest;
    manifest.shards = {{.block_count = dataset.layout.block_count(), .block_bytes = 700}};
    manifest.in_source.emplace() = {
        .request = members, .unit_origin = {0, -3, -1}, .unit_dims = {64, 64, 2}};
    manifest.dataset_id = store::ComputeDatasetId(manifest);
    seeds.push_back(absl::StrCat("\1", store::EncodeManifest(manifest)));
  }
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isoscope::fuzz::Input input(data, size);
  if ((input.Byte() & 1) != 0) {
    const std::string manifest(input.Rest());
    isoscope::fuzz::DecodeManifest(manifest);
    isoscope::fuzz::DecodeManifest(isoscope::fuzz::SealedText(manifest));
    return 0;
  }
  isoscope::fuzz::Members members;
  while (!input.empty() && members.size() < 32) {
    const std::string name(input.Piece());
    members[name] = std::string(input.Piece());
  }
  isoscope::fuzz::Decode(members);
  return 0;
}
