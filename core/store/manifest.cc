// Encoding writes the members in a fixed order, then seals the text. Decoding trusts nothing:
//
//   1. VerifySeal: the CRC-32C of the whole text.
//   2. ParseJsonFile: valid JSON of this format, in a version that this program knows.
//   3. Each member by name: its type and range. JsonFields keeps the first error, so the members
//      are read in a row and the error is checked once. Unknown members are ignored.
//   4. Names become enumerators.
//   5. CheckConsistency: the digests have 32 hex digits, the geometry is valid, the blocks make a
//      layout, and the block counts of the shards add up to its blocks.
//
// Invariant: decoding an encoded manifest gives the same manifest, bit for bit, if its strings are
// UTF-8. Doubles are written with as many digits as that takes; the two infinities, which JSON
// lacks, are the strings "inf" and "-inf".
//
// Example: tests/unit/core/store/manifest_test.cc has the whole text of a small manifest.
// Members: docs/format/dataset.md, "manifest.json".

#include "core/store/manifest.h"

#include <cmath>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include <nlohmann/json.hpp>

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/store/json_fields.h"
#include "core/store/manifest_members.h"
#include "core/store/sealed_json.h"
#include "core/store/shard_format.h"

namespace isoscope::store {
namespace {

constexpr std::int64_t kMaxInt64 = std::numeric_limits<std::int64_t>::max();

absl::Status ReadShards(const Json& json, absl::string_view where,
                        std::vector<ShardSummary>* shards) {
  if (json.empty() || json.size() > static_cast<std::size_t>(kMaxShardCount)) {
    return absl::DataLossError(
        absl::StrFormat("%s: %d shards, expected 1 to %d", where, json.size(), kMaxShardCount));
  }
  shards->reserve(json.size());
  for (const Json& element : json) {
    ShardSummary shard;
    JsonFields fields(element, where);
    fields.Read("block_count", 0, volume::kMaxBlockCount, &shard.block_count);
    fields.Read("block_bytes", 0, kMaxInt64, &shard.block_bytes);
    fields.ReadCrc32c("block_index_crc32c", &shard.block_index_crc32c);
    ISOSCOPE_RETURN_IF_ERROR(fields.status());
    shards->push_back(shard);
  }
  return absl::OkStatus();
}

// Checks what involves several members.
absl::Status CheckConsistency(const Manifest& manifest, absl::string_view where) {
  if (!IsDigest(manifest.dataset_id)) {
    return absl::DataLossError(
        absl::StrCat(where, ": member \"dataset_id\": expected 32 lower-case hex digits"));
  }
  if (!manifest.samples_digest.empty() && !IsDigest(manifest.samples_digest)) {
    return absl::DataLossError(
        absl::StrCat(where, ": member \"samples_digest\": expected 32 lower-case hex digits"));
  }
  if (const double bound = manifest.max_gradient_magnitude.value_or(0);
      !(bound >= 0 && std::isfinite(bound))) {
    return absl::DataLossError(absl::StrCat(where, ": member \"max_gradient_magnitude\" is ", bound,
                                            ": expected a finite number >= 0"));
  }
  if (const absl::Status status = CheckFiniteRange(manifest.value_range, manifest.finite_range);
      !status.ok()) {
    return WithContext(where, status);
  }
  if (const absl::Status status = volume::Validate(manifest.geometry); !status.ok()) {
    return WithContext(where, status);
  }
  const auto layout =
      volume::BlockLayout::Make(manifest.geometry.sample_dims, manifest.block_cells);
  if (!layout.ok()) {
    return WithContext(where, layout.status());
  }
  std::int64_t block_count = 0;
  for (const ShardSummary& shard : manifest.shards) {
    block_count += shard.block_count;
  }
  if (block_count != layout->block_count()) {
    return absl::DataLossError(
        absl::StrFormat("%s: the shards hold %d blocks together, expected %d", where, block_count,
                        layout->block_count()));
  }
  return absl::OkStatus();
}

}  // namespace

absl::string_view NameOf(Distribution distribution) {
  switch (distribution) {
    case Distribution::kRandom:
      return "random";
    case Distribution::kGreedy:
      return "greedy";
  }
  base::CheckFailed(__FILE__, __LINE__, "distribution out of range");
}

absl::StatusOr<Distribution> DistributionFromName(absl::string_view name) {
  for (const Distribution distribution : {Distribution::kRandom, Distribution::kGreedy}) {
    if (name == NameOf(distribution)) {
      return distribution;
    }
  }
  return absl::InvalidArgumentError(
      absl::StrCat("distribution \"", name, "\": expected random or greedy"));
}

std::string EncodeManifest(const Manifest& manifest) {
  const volume::GridGeometry& geometry = manifest.geometry;
  Json shards = Json::array();
  for (const ShardSummary& shard : manifest.shards) {
    shards.push_back(Json{{"block_count", shard.block_count},
                          {"block_bytes", shard.block_bytes},
                          {"block_index_crc32c", JsonFromCrc32c(shard.block_index_crc32c)}});
  }
  Json json;
  json["format"] = std::string(kManifestFormat);
  json["format_version"] = kFormatVersion;
  json["crc32c"] = JsonFromCrc32c(0);
  json["dataset_id"] = manifest.dataset_id;
  if (!manifest.samples_digest.empty()) {
    json["samples_digest"] = manifest.samples_digest;
  }
  json["name"] = manifest.name;
  json["source"] = manifest.source;
  json["sample_dims"] = JsonFromIndex(geometry.sample_dims);
  json["scalar_type"] = std::string(volume::NameOf(manifest.scalar_type));
  json["value_range"] = JsonFromRange(manifest.value_range);
  if (manifest.finite_range.has_value()) {
    json["finite_range"] = JsonFromRange(*manifest.finite_range);
  }
  if (manifest.max_gradient_magnitude.has_value()) {
    json["max_gradient_magnitude"] = JsonFromDouble(*manifest.max_gradient_magnitude);
  }
  json["spacing"] = JsonFromVector(geometry.spacing);
  json["origin"] = JsonFromVector(geometry.origin);
  json["direction"] = JsonFromDirection(geometry.direction);
  if (manifest.patient_frame.has_value()) {
    json["patient_frame"] = manifest.patient_frame->name();
  }
  json["block_cells"] = JsonFromIndex(manifest.block_cells);
  json["distribution"] = std::string(NameOf(manifest.distribution));
  json["seed"] = manifest.seed;
  json["range_table_crc32c"] = JsonFromCrc32c(manifest.range_table_crc32c);
  AddLabels(manifest.labels, &json);
  json["shards"] = std::move(shards);
  return SealJson(DumpJson(json));
}

absl::StatusOr<Manifest> DecodeManifest(absl::string_view bytes, absl::string_view where) {
  ISOSCOPE_RETURN_IF_ERROR(VerifySeal(bytes, where).status());
  ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const Json> json,
                            ParseJsonFile(bytes, where, kManifestFormat, kFormatVersion));

  Manifest manifest;
  JsonFields fields(*json, where);
  fields.Read("dataset_id", &manifest.dataset_id);
  if (json->contains("samples_digest")) {
    fields.Read("samples_digest", &manifest.samples_digest);
  }
  fields.Read("name", &manifest.name);
  fields.Read("source", &manifest.source);
  ReadIndex("sample_dims", 2, kMaxInt64, &fields, &manifest.geometry.sample_dims);
  std::string scalar_type;
  fields.Read("scalar_type", &scalar_type);
  if (const Json* range = fields.ReadObject("value_range")) {
    fields.Fail(ReadRange(*range, where, &manifest.value_range));
  }
  ReadFiniteRange(where, &fields, &manifest.finite_range);
  if (fields.Has("max_gradient_magnitude")) {
    fields.ReadDouble("max_gradient_magnitude", &manifest.max_gradient_magnitude.emplace());
  }
  ReadVector("spacing", &fields, &manifest.geometry.spacing);
  ReadVector("origin", &fields, &manifest.geometry.origin);
  if (const Json* direction = fields.ReadObject("direction")) {
    fields.Fail(ReadDirection(*direction, where, &manifest.geometry.direction));
  }
  ReadPatientFrame(where, &fields, &manifest.patient_frame);
  ReadIndex("block_cells", 1, volume::BlockLayout::kMaxBlockCells, &fields, &manifest.block_cells);
  std::string distribution;
  fields.Read("distribution", &distribution);
  fields.Read("seed", &manifest.seed);
  fields.ReadCrc32c("range_table_crc32c", &manifest.range_table_crc32c);
  ReadLabels(where, &fields, &manifest.labels);
  if (const Json* shards = fields.ReadArray("shards")) {
    fields.Fail(ReadShards(*shards, where, &manifest.shards));
  }
  ISOSCOPE_RETURN_IF_ERROR(fields.status());

  const auto type = volume::ScalarTypeFromName(scalar_type);
  if (!type.ok()) {
    return WithContext(where, type.status());
  }
  manifest.scalar_type = *type;
  const auto known_distribution = DistributionFromName(distribution);
  if (!known_distribution.ok()) {
    return WithContext(where, known_distribution.status());
  }
  manifest.distribution = *known_distribution;
  ISOSCOPE_RETURN_IF_ERROR(CheckConsistency(manifest, where));
  return manifest;
}

}  // namespace isoscope::store
