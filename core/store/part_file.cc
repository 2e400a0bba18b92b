// Each file is a JSON object of fixed members, sealed as manifests are. The manifests in them are
// texts of their own, with the seals that they would have as files.

#include "core/store/part_file.h"

#include <memory>

#include "absl/strings/escaping.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include <nlohmann/json.hpp>

#include "core/base/sha256.h"
#include "core/base/status_macros.h"
#include "core/store/block_codec.h"
#include "core/store/json_fields.h"
#include "core/store/manifest_members.h"
#include "core/store/sealed_json.h"
#include "core/store/shard_format.h"

namespace isoscope::store {
namespace {

constexpr absl::string_view kCutFormat = "isoscope-part-cut";
constexpr absl::string_view kPieceFormat = "isoscope-part-piece";
constexpr absl::string_view kProgressFormat = "isoscope-part-progress";
constexpr int kPartFormatVersion = 1;
Json HeadOf(absl::string_view format) {
  Json json;
  json["format"] = std::string(format);
  json["format_version"] = kPartFormatVersion;
  json["crc32c"] = JsonFromCrc32c(0);
  return json;
}

// A sealed text inside of a sealed text would have its seal twice, so it is written as hex digits.
std::string Packed(const std::string& text) { return absl::BytesToHexString(text); }
std::string Unpacked(const std::string& digits) { return absl::HexStringToBytes(digits); }

void AddPart(const PartNumber& part, Json* json) {
  (*json)["part"] = part.index;
  (*json)["part_count"] = part.count;
}

void ReadPart(JsonFields* fields, PartNumber* part) {
  std::int64_t index = 0;
  std::int64_t count = 1;
  fields->Read("part_count", 1, kMaxPartCount, &count);
  fields->Read("part", 0, count - 1, &index);
  *part = {.index = static_cast<int>(index), .count = static_cast<int>(count)};
}

absl::StatusOr<std::shared_ptr<const Json>> Parse(absl::string_view bytes, absl::string_view where,
                                                  absl::string_view format) {
  ISOSCOPE_RETURN_IF_ERROR(VerifySeal(bytes, where).status());
  return ParseJsonFile(bytes, where, format, kPartFormatVersion);
}

absl::Status ReadMembers(const Json& json, absl::string_view where,
                         std::vector<std::pair<std::string, std::string>>* members) {
  for (const Json& element : json) {
    JsonFields fields(element, where);
    auto& [name, value] = members->emplace_back();
    fields.Read("name", &name);
    fields.Read("value", &value);
    ISOSCOPE_RETURN_IF_ERROR(fields.status());
  }
  return absl::OkStatus();
}

absl::Status ReadKeys(const Json& json, absl::string_view where,
                      std::vector<ScalarVolumeKey>* keys) {
  if (json.size() > static_cast<std::size_t>(kMaxScalarVolumes)) {
    return absl::DataLossError(
        absl::StrCat(where, ": ", json.size(), " volumes, expected at most ", kMaxScalarVolumes));
  }
  for (const Json& element : json) {
    JsonFields fields(element, where);
    std::int64_t field = 0;
    std::int64_t component = 0;
    std::int64_t step = 0;
    fields.Read("field", 0, kMaxFields - 1, &field);
    fields.Read("component", 0, kMaxComponents - 1, &component);
    fields.Read("step", 0, kMaxSteps - 1, &step);
    ISOSCOPE_RETURN_IF_ERROR(fields.status());
    keys->push_back({.field = static_cast<int>(field),
                     .component = static_cast<int>(component),
                     .step = static_cast<int>(step)});
  }
  return absl::OkStatus();
}

// A manifest needs a volume and an id before it can be decoded.
SeriesManifest WithPlaceholder(SeriesManifest series) {
  series.dataset_id = std::string(32, '0');
  series.volumes = {
      {.key = {}, .dataset_id = series.dataset_id, .manifest_crc32c = 0, .value_range = {}}};
  return series;
}

absl::StatusOr<SeriesManifest> DecodeSeries(const std::string& text, absl::string_view where) {
  ISOSCOPE_ASSIGN_OR_RETURN(SeriesManifest series, DecodeSeriesManifest(text, where));
  series.dataset_id.clear();
  series.volumes.clear();
  return series;
}

absl::Status ReadShards(const Json& json, absl::string_view where,
                        std::vector<ShardPiece>* shards) {
  if (json.empty() || json.size() > static_cast<std::size_t>(kMaxShardCount)) {
    return absl::DataLossError(
        absl::StrFormat("%s: %d shards, expected 1 to %d", where, json.size(), kMaxShardCount));
  }
  for (const Json& element : json) {
    ShardPiece& shard = shards->emplace_back();
    JsonFields fields(element, where);
    fields.Read("block_count", 0, volume::kMaxBlockCount, &shard.summary.block_count);
    fields.Read("block_bytes", 0, kMaxInt64, &shard.summary.block_bytes);
    fields.ReadCrc32c("block_index_crc32c", &shard.summary.block_index_crc32c);
    fields.ReadCrc32c("spans_crc32c", &shard.spans_crc32c);
    fields.ReadCrc32c("histogram_crc32c", &shard.histogram_crc32c);
    ISOSCOPE_RETURN_IF_ERROR(fields.status());
  }
  return absl::OkStatus();
}

absl::Status ReadSpan(const char* name, absl::string_view where, JsonFields* fields,
                      volume::ScalarSpan* span) {
  const Json* const range = fields->ReadObject(name);
  return range == nullptr ? fields->status() : ReadRange(*range, where, span);
}

Json JsonOf(const PartCut& cut) {
  Json json = HeadOf(kCutFormat);
  json["name"] = cut.name;
  Json members = Json::array();
  for (const auto& [name, value] : cut.members) {
    members.push_back(Json{{"name", name}, {"value", value}});
  }
  json["members"] = std::move(members);
  if (cut.series.has_value()) {
    json["series"] = Packed(EncodeSeriesManifest(WithPlaceholder(*cut.series)));
    Json keys = Json::array();
    for (const ScalarVolumeKey& key : cut.keys) {
      keys.push_back(Json{{"field", key.field}, {"component", key.component}, {"step", key.step}});
    }
    json["volumes"] = std::move(keys);
  }
  return json;
}

}  // namespace

std::optional<PartNumber> PartOfName(absl::string_view name) {
  const absl::string_view::size_type part = name.find("part-");
  constexpr absl::string_view::size_type kDigits = 5;
  const absl::string_view::size_type count_at = 5 + kDigits + 4;
  PartNumber number;
  if (part != 0 || name.size() < count_at + kDigits || name.substr(5 + kDigits, 4) != "-of-" ||
      !absl::SimpleAtoi(name.substr(5, kDigits), &number.index) ||
      !absl::SimpleAtoi(name.substr(count_at, kDigits), &number.count) || number.index < 0 ||
      number.index >= number.count || PartName(number) != name.substr(0, count_at + kDigits)) {
    return std::nullopt;
  }
  return number;
}

std::string PartCut::Digest() const { return base::Sha256Hex(DumpJson(JsonOf(*this))); }

std::string EncodePartCut(const PartCut& cut) {
  Json json = JsonOf(cut);
  AddPart(cut.part, &json);
  return SealJson(DumpJson(json));
}

absl::StatusOr<PartCut> DecodePartCut(absl::string_view bytes, absl::string_view where) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const Json> json,
                            Parse(bytes, where, kCutFormat));
  PartCut cut;
  JsonFields fields(*json, where);
  ReadPart(&fields, &cut.part);
  fields.Read("name", &cut.name);
  const Json* const members = fields.ReadArray("members");
  ISOSCOPE_RETURN_IF_ERROR(fields.status());
  ISOSCOPE_RETURN_IF_ERROR(ReadMembers(*members, where, &cut.members));
  if (fields.Has("series")) {
    std::string series;
    fields.Read("series", &series);
    const Json* const keys = fields.ReadArray("volumes");
    ISOSCOPE_RETURN_IF_ERROR(fields.status());
    ISOSCOPE_ASSIGN_OR_RETURN(cut.series, DecodeSeries(Unpacked(series), where));
    ISOSCOPE_RETURN_IF_ERROR(ReadKeys(*keys, where, &cut.keys));
  }
  return cut;
}

std::string EncodePieceRecord(const PieceRecord& record) {
  Json json = HeadOf(kPieceFormat);
  AddPart(record.part, &json);
  json["cut_digest"] = record.cut_digest;
  json["manifest"] = Packed(EncodeManifest(record.manifest));
  json["highest_level"] = record.highest_level;
  json["level_filter"] = std::string(volume::NameOf(record.level_filter));
  json["compression"] = std::string(NameOf(record.compression));
  for (std::size_t i = 0; i < record.digest_sum.size(); ++i) {
    json[absl::StrCat("digest_sum_", i)] = record.digest_sum[i];
  }
  json["value_range"] = JsonFromRange(record.value_range);
  json["finite_range"] = JsonFromRange(record.finite_range);
  json["max_gradient_magnitude"] = JsonFromDouble(record.max_gradient_magnitude);
  json["ranges_bytes"] = record.ranges_bytes;
  json["ranges_crc32c"] = JsonFromCrc32c(record.ranges_crc32c);
  json["level1_bytes"] = record.level1_bytes;
  json["level1_crc32c"] = JsonFromCrc32c(record.level1_crc32c);
  Json shards = Json::array();
  for (const ShardPiece& shard : record.shards) {
    shards.push_back(Json{{"block_count", shard.summary.block_count},
                          {"block_bytes", shard.summary.block_bytes},
                          {"block_index_crc32c", JsonFromCrc32c(shard.summary.block_index_crc32c)},
                          {"spans_crc32c", JsonFromCrc32c(shard.spans_crc32c)},
                          {"histogram_crc32c", JsonFromCrc32c(shard.histogram_crc32c)}});
  }
  json["shards"] = std::move(shards);
  return SealJson(DumpJson(json));
}

absl::StatusOr<PieceRecord> DecodePieceRecord(absl::string_view bytes, absl::string_view where) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const Json> json,
                            Parse(bytes, where, kPieceFormat));
  PieceRecord record;
  JsonFields fields(*json, where);
  ReadPart(&fields, &record.part);
  fields.Read("cut_digest", &record.cut_digest);
  std::string manifest;
  fields.Read("manifest", &manifest);
  std::int64_t highest_level = 0;
  fields.Read("highest_level", 0, volume::kMaxLevel, &highest_level);
  std::string filter;
  fields.Read("level_filter", &filter);
  std::string compression;
  fields.Read("compression", &compression);
  for (std::size_t i = 0; i < record.digest_sum.size(); ++i) {
    fields.Read(absl::StrCat("digest_sum_", i).c_str(), &record.digest_sum[i]);
  }
  fields.ReadDouble("max_gradient_magnitude", &record.max_gradient_magnitude);
  fields.Read("ranges_bytes", 0, kMaxInt64, &record.ranges_bytes);
  fields.ReadCrc32c("ranges_crc32c", &record.ranges_crc32c);
  fields.Read("level1_bytes", 0, kMaxInt64, &record.level1_bytes);
  fields.ReadCrc32c("level1_crc32c", &record.level1_crc32c);
  const Json* const shards = fields.ReadArray("shards");
  ISOSCOPE_RETURN_IF_ERROR(fields.status());
  ISOSCOPE_RETURN_IF_ERROR(ReadSpan("value_range", where, &fields, &record.value_range));
  ISOSCOPE_RETURN_IF_ERROR(ReadSpan("finite_range", where, &fields, &record.finite_range));
  ISOSCOPE_RETURN_IF_ERROR(ReadShards(*shards, where, &record.shards));
  ISOSCOPE_ASSIGN_OR_RETURN(record.manifest, DecodeManifest(Unpacked(manifest), where));
  ISOSCOPE_ASSIGN_OR_RETURN(record.level_filter, volume::LevelFilterFromName(filter));
  ISOSCOPE_ASSIGN_OR_RETURN(record.compression, ParseBlockEncoding(compression));
  record.highest_level = static_cast<int>(highest_level);
  return record;
}

std::string EncodePartProgress(const PartProgress& progress) {
  Json json = HeadOf(kProgressFormat);
  json["phase"] = progress.phase;
  json["done_bytes"] = progress.done_bytes;
  json["total_bytes"] = progress.total_bytes;
  json["host"] = progress.host;
  json["process_id"] = progress.process_id;
  json["updated_unix_seconds"] = progress.updated_unix_seconds;
  return SealJson(DumpJson(json));
}

absl::StatusOr<PartProgress> DecodePartProgress(absl::string_view bytes, absl::string_view where) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const Json> json,
                            Parse(bytes, where, kProgressFormat));
  PartProgress progress;
  JsonFields fields(*json, where);
  fields.Read("phase", &progress.phase);
  fields.Read("done_bytes", 0, kMaxInt64, &progress.done_bytes);
  fields.Read("total_bytes", 0, kMaxInt64, &progress.total_bytes);
  fields.Read("host", &progress.host);
  fields.Read("process_id", 0, kMaxInt64, &progress.process_id);
  fields.Read("updated_unix_seconds", 0, kMaxInt64, &progress.updated_unix_seconds);
  ISOSCOPE_RETURN_IF_ERROR(fields.status());
  return progress;
}

}  // namespace isoscope::store
