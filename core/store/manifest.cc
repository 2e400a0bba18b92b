// Encoding writes the members in a fixed order, then seals the text. Decoding trusts nothing:
//
//   1. VerifySeal: the CRC-32C of the whole text.
//   2. ParseJsonFile: valid JSON of this format, in a version that this program knows; version 3
//      also says of which kind it is, and what a reader must know.
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
// A manifest of version 3 holds the seal of the same manifest without levels, as "base_crc32c":
//
//   version 1, seal A     -- levels are added -->   version 3, seal B, base_crc32c A
//
// Shard files and series name A, and stay as they are. That of an index-only dataset is of version 3
// without levels, too.
//
// Example: tests/unit/core/store/manifest_test.cc has the whole text of a small manifest.
// Members: docs/format/dataset.md, "manifest.json".

#include "core/store/manifest.h"

#include <cmath>
#include <utility>

#include "absl/strings/numbers.h"
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

// The position in a sealed text is found as the seal is: in a string the quotes would be escaped.
constexpr absl::string_view kBaseCrc32cPrefix = "\"base_crc32c\": \"";

bool IsExtended(const Manifest& manifest) {
  return !manifest.levels.empty() || manifest.in_source.has_value();
}

void AddLevels(const Manifest& manifest, Json* json) {
  Manifest base = manifest;
  base.levels.clear();
  const absl::StatusOr<std::uint32_t> base_crc32c = ManifestCrc32c(EncodeManifest(base), "base");
  ISOSCOPE_CHECK(base_crc32c.ok());
  (*json)["base_crc32c"] = JsonFromCrc32c(*base_crc32c);
  (*json)["level_filter"] = std::string(volume::NameOf(manifest.level_filter));
  Json levels = Json::array();
  for (const LevelSummary& level : manifest.levels) {
    levels.push_back(
        Json{{"dataset_id", level.dataset_id},
             {"value_scale", volume::LevelValueScale(manifest.scalar_type, manifest.level_filter)},
             {"manifest_crc32c", JsonFromCrc32c(level.manifest_crc32c)}});
  }
  (*json)["levels"] = std::move(levels);
}

void AddSourceSamples(const SourceSamples& in_source, Json* json) {
  Json request = Json::object();
  for (const auto& [name, value] : in_source.request) {
    request[name] = value;
  }
  (*json)["in_source"] = Json{{"request", std::move(request)},
                              {"unit_origin", JsonFromIndex(in_source.unit_origin)},
                              {"unit_dims", JsonFromIndex(in_source.unit_dims)}};
}

// Adds what version 3 says behind its version.
void AddExtension(const Manifest& manifest, Json* json) {
  (*json)["kind"] = std::string(kVolumeKind);
  Json required = Json::array();
  if (!manifest.levels.empty()) {
    required.push_back(std::string(kLevelsFeature));
  }
  if (manifest.in_source.has_value()) {
    required.push_back(std::string(kIndexOnlyFeature));
  }
  (*json)["requires"] = std::move(required);
  if (!manifest.levels.empty()) {
    AddLevels(manifest, json);
  }
  if (manifest.in_source.has_value()) {
    AddSourceSamples(*manifest.in_source, json);
  }
}

absl::Status ReadSourceSamples(absl::string_view where, const Json& json, SourceSamples* samples) {
  JsonFields fields(json, where);
  ReadIndex("unit_origin", -kMaxInt64, 0, &fields, &samples->unit_origin);
  ReadIndex("unit_dims", 1, kMaxUnitBytes, &fields, &samples->unit_dims);
  const Json* const request = fields.ReadObject("request");
  ISOSCOPE_RETURN_IF_ERROR(fields.status());
  if (request->size() > kMaxRequestMembers || !request->contains("path")) {
    return absl::DataLossError(
        absl::StrFormat("%s: member \"request\" has %d members, expected at most %d, with \"path\"",
                        where, request->size(), kMaxRequestMembers));
  }
  JsonFields members(*request, where);
  for (const auto& [name, value] : request->items()) {
    std::string& text = samples->request[name];
    members.Read(name.c_str(), &text);
    if (text.size() > kMaxRequestBytes) {
      return absl::DataLossError(
          absl::StrFormat("%s: a member of \"request\" has %d bytes, expected at most %d", where,
                          text.size(), kMaxRequestBytes));
    }
  }
  return members.status();
}

// DATA_LOSS if the units are none, or too large.
absl::Status CheckSourceSamples(const Manifest& manifest, absl::string_view where) {
  const SourceSamples& samples = *manifest.in_source;
  std::int64_t bytes = static_cast<std::int64_t>(volume::SizeOf(manifest.scalar_type));
  for (int axis = 0; axis < 3; ++axis) {
    const std::int64_t size = samples.unit_dims[axis];
    if (samples.unit_origin[axis] <= -size || size > kMaxUnitBytes / bytes) {
      return absl::DataLossError(absl::StrFormat(
          "%s: units of %d x %d x %d samples from %d, %d, %d on: expected at most %d bytes, and "
          "the first to have the first sample",
          where, samples.unit_dims.x, samples.unit_dims.y, samples.unit_dims.z,
          samples.unit_origin.x, samples.unit_origin.y, samples.unit_origin.z, kMaxUnitBytes));
    }
    bytes *= size;
  }
  return absl::OkStatus();
}

absl::Status ReadLevels(absl::string_view where, JsonFields* fields, Manifest* manifest) {
  std::string filter_name;
  fields->Read("level_filter", &filter_name);
  const Json* const levels = fields->ReadArray("levels");
  ISOSCOPE_RETURN_IF_ERROR(fields->status());
  const absl::StatusOr<volume::LevelFilter> filter = volume::LevelFilterFromName(filter_name);
  if (!filter.ok()) {
    return WithContext(where, filter.status());
  }
  manifest->level_filter = *filter;
  if (levels->empty() || levels->size() > static_cast<std::size_t>(volume::kMaxLevel)) {
    return absl::DataLossError(absl::StrFormat("%s: %d levels, expected 1 to %d", where,
                                               levels->size(), volume::kMaxLevel));
  }
  for (const Json& element : *levels) {
    LevelSummary& level = manifest->levels.emplace_back();
    double value_scale = 0;
    JsonFields members(element, where);
    members.Read("dataset_id", &level.dataset_id);
    members.ReadDouble("value_scale", &value_scale);
    members.ReadCrc32c("manifest_crc32c", &level.manifest_crc32c);
    ISOSCOPE_RETURN_IF_ERROR(members.status());
    const double expected = volume::LevelValueScale(manifest->scalar_type, manifest->level_filter);
    if (value_scale != expected) {
      return absl::DataLossError(absl::StrFormat("%s: level %d has value_scale %g, expected %g",
                                                 where, manifest->highest_level(), value_scale,
                                                 expected));
    }
  }
  return absl::OkStatus();
}

absl::Status CheckLevels(const Manifest& manifest, absl::string_view where) {
  if (manifest.highest_level() > volume::HighestLevel(manifest.geometry.sample_dims)) {
    return absl::DataLossError(absl::StrFormat(
        "%s: %d levels, at most %d have 2 samples on each axis", where, manifest.highest_level(),
        volume::HighestLevel(manifest.geometry.sample_dims)));
  }
  if (!volume::CanFilter(manifest.level_filter, manifest.scalar_type)) {
    return absl::DataLossError(absl::StrFormat("%s: levels of majorities of %s samples", where,
                                               volume::NameOf(manifest.scalar_type)));
  }
  for (int level = 1; level <= manifest.highest_level(); ++level) {
    if (!IsDigest(manifest.levels[static_cast<std::size_t>(level - 1)].dataset_id)) {
      return absl::DataLossError(absl::StrFormat(
          "%s: member \"dataset_id\" of level %d: expected 32 lower-case hex digits", where,
          level));
    }
    const auto layout =
        volume::BlockLayout::Make(manifest.Level(level).grid.sample_dims, manifest.block_cells);
    if (!layout.ok()) {
      return WithContext(where, layout.status());
    }
    if (layout->block_count() < static_cast<std::int64_t>(manifest.shards.size())) {
      return absl::DataLossError(absl::StrFormat("%s: level %d has %d blocks for %d shards", where,
                                                 level, layout->block_count(),
                                                 manifest.shards.size()));
    }
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
  return CheckLevels(manifest, where);
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
  json["format_version"] = IsExtended(manifest) ? kExtendedFormatVersion : kFormatVersion;
  json["crc32c"] = JsonFromCrc32c(0);
  if (IsExtended(manifest)) {
    AddExtension(manifest, &json);
  }
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
                            ParseJsonFile(bytes, where, kManifestFormat, kExtendedFormatVersion));
  ISOSCOPE_ASSIGN_OR_RETURN(const int version, ReadVersion(*json, where, kVolumeKind));

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
  if (version == kExtendedFormatVersion && fields.Has("in_source")) {
    const Json* const in_source = fields.ReadObject("in_source");
    ISOSCOPE_RETURN_IF_ERROR(fields.status());
    ISOSCOPE_RETURN_IF_ERROR(ReadSourceSamples(where, *in_source, &manifest.in_source.emplace()));
    ISOSCOPE_RETURN_IF_ERROR(CheckSourceSamples(manifest, where));
  }
  if (version == kExtendedFormatVersion &&
      (fields.Has("levels") || !manifest.in_source.has_value())) {
    ISOSCOPE_RETURN_IF_ERROR(ReadLevels(where, &fields, &manifest));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckConsistency(manifest, where));
  return manifest;
}

absl::StatusOr<std::uint32_t> ManifestCrc32c(absl::string_view bytes, absl::string_view where) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::uint32_t seal, VerifySeal(bytes, where));
  const std::size_t prefix = bytes.find(kBaseCrc32cPrefix);
  if (prefix == absl::string_view::npos) {
    return seal;
  }
  constexpr std::size_t kDigits = 8;
  std::uint32_t base = 0;
  if (!absl::SimpleHexAtoi(bytes.substr(prefix + kBaseCrc32cPrefix.size(), kDigits), &base)) {
    return absl::DataLossError(
        absl::StrCat(where, ": member \"base_crc32c\": expected 8 hex digits"));
  }
  return base;
}

}  // namespace isoscope::store
