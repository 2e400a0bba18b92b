// The directories of a series: declared in series_manifest.h, whose text is in series_manifest.cc.
// Files are verified as they are opened (directory_files.h).

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include <nlohmann/json.hpp>

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/io/atomic_file.h"
#include "core/io/file.h"
#include "core/store/directory_files.h"
#include "core/store/json_fields.h"
#include "core/store/sealed_json.h"
#include "core/store/series_manifest.h"
#include "core/store/shard_format.h"
#include "core/store/shard_reader.h"

namespace isoscope::store {
namespace {

constexpr absl::string_view kSeriesShardFormat = "isoscope-series-shard";
constexpr std::int64_t kSeriesShardVersion = 1;
// The first bytes of a manifest that tell its version.
constexpr std::int64_t kVersionHeadBytes = 256;

std::string EncodeSeriesShard(const SeriesManifest& manifest, int shard_index) {
  Json json;
  json["format"] = std::string(kSeriesShardFormat);
  json["format_version"] = kSeriesShardVersion;
  json["crc32c"] = JsonFromCrc32c(0);
  json["dataset_id"] = manifest.dataset_id;
  json["shard_index"] = shard_index;
  json["shard_count"] = manifest.shard_count;
  return SealJson(DumpJson(json));
}

// Returns the index of the shard that `path` describes. DATA_LOSS if it is not of this series.
absl::StatusOr<int> ReadSeriesShard(const std::string& path, const SeriesManifest& manifest) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes,
                            ReadRequiredJson(path, kMaxShardFileBytes, io::OpenRandomAccessFile));
  ISOSCOPE_RETURN_IF_ERROR(VerifySeal(bytes, path).status());
  ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const Json> json,
                            ParseJsonFile(bytes, path, kSeriesShardFormat, kSeriesShardVersion));
  JsonFields fields(*json, path);
  std::string dataset_id;
  std::int64_t shard_count = 0;
  std::int64_t shard_index = 0;
  fields.Read("dataset_id", &dataset_id);
  fields.Read("shard_count", 1, kMaxShardCount, &shard_count);
  fields.Read("shard_index", 0, kMaxShardCount - 1, &shard_index);
  ISOSCOPE_RETURN_IF_ERROR(fields.status());
  if (dataset_id != manifest.dataset_id || shard_count != manifest.shard_count ||
      shard_index >= shard_count) {
    return absl::DataLossError(absl::StrFormat(
        "%s: describes shard %d of %d of dataset %s; the manifest beside it is of dataset %s with "
        "%d shards: files of different datasets are mixed",
        path, shard_index, shard_count, dataset_id, manifest.dataset_id, manifest.shard_count));
  }
  return static_cast<int>(shard_index);
}

}  // namespace

bool IsSeriesDirectory(const std::string& directory) {
  const auto file = io::OpenRandomAccessFile(PathIn(directory, kManifestFileName));
  if (!file.ok()) {
    return false;
  }
  std::string head(
      static_cast<std::size_t>(std::min<std::int64_t>((*file)->size_bytes(), kVersionHeadBytes)),
      '\0');
  // Inside a JSON string the quotes would be escaped.
  const auto has = [&head](const auto&... text) {
    return absl::StrContains(head, absl::StrCat(text...));
  };
  return (*file)->ReadAt(0, head.size(), head.data()).ok() &&
         (has("\"format_version\": ", kSeriesFormatVersion, ",") ||
          (has("\"format_version\": ", kExtendedFormatVersion, ",") &&
           has("\"kind\": \"", kSeriesKind, "\"")));
}

absl::StatusOr<SeriesShard> OpenSeriesShard(const std::string& directory) {
  const std::string path = PathIn(directory, kManifestFileName);
  const std::string shard_path = PathIn(directory, kSeriesShardFileName);
  const bool has_manifest = io::PathExists(path);
  if (!has_manifest && io::PathExists(shard_path)) {
    return absl::FailedPreconditionError(
        absl::StrCat(directory, ": a shard without ", kManifestFileName,
                     ": its partitioning or copying did not finish; do it again"));
  }
  if (!has_manifest || !io::PathExists(shard_path)) {
    return absl::NotFoundError(
        absl::StrCat(directory, ": no ", has_manifest ? kSeriesShardFileName : kManifestFileName,
                     " in it, expected a shard directory of a dataset with fields or steps"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes, ReadRequiredJson(path, kMaxSeriesManifestBytes,
                                                                      io::OpenRandomAccessFile));
  SeriesShard shard;
  ISOSCOPE_ASSIGN_OR_RETURN(shard.manifest_crc32c, VerifySeal(bytes, path));
  ISOSCOPE_ASSIGN_OR_RETURN(shard.manifest, DecodeSeriesManifest(bytes, path));
  ISOSCOPE_ASSIGN_OR_RETURN(shard.shard_index, ReadSeriesShard(shard_path, shard.manifest));
  return shard;
}

absl::StatusOr<SeriesDescription> OpenSeries(const std::string& directory) {
  const std::string path = PathIn(directory, kManifestFileName);
  if (!io::PathExists(path)) {
    return absl::NotFoundError(absl::StrCat(
        directory, ": no ", kManifestFileName,
        " in it: no dataset, or one whose partitioning did not finish; run `isoscope partition`"));
  }
  if (IsShardDirectory(directory)) {
    return absl::FailedPreconditionError(absl::StrCat(
        directory, ": is one shard of a dataset, expected the dataset directory that holds it"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes, ReadRequiredJson(path, kMaxSeriesManifestBytes,
                                                                      io::OpenRandomAccessFile));
  SeriesDescription series;
  ISOSCOPE_ASSIGN_OR_RETURN(series.manifest, DecodeSeriesManifest(bytes, path));
  for (int shard = 0; shard < series.manifest.shard_count; ++shard) {
    std::string shard_path =
        PathIn(directory, ShardDirectoryName(shard, series.manifest.shard_count));
    series.shard_directories.push_back(io::IsDirectory(shard_path) ? std::move(shard_path) : "");
  }
  return series;
}

std::vector<MissingVolume> MissingVolumes(const SeriesDescription& series) {
  std::vector<MissingVolume> missing;
  for (const ScalarVolume& volume : series.manifest.volumes) {
    std::vector<int> shards;
    for (std::size_t shard = 0; shard < series.shard_directories.size(); ++shard) {
      const std::string& directory = series.shard_directories[shard];
      if (!directory.empty() &&
          !io::PathExists(absl::StrCat(directory, "/", ScalarVolumeDirectoryName(volume.key), "/",
                                       kManifestFileName))) {
        shards.push_back(static_cast<int>(shard));
      }
    }
    if (!shards.empty()) {
      missing.push_back({.key = volume.key, .shards = std::move(shards)});
    }
  }
  return missing;
}

std::string DescribeMissing(const std::vector<MissingVolume>& missing,
                            const SeriesManifest& manifest) {
  const ScalarVolumeKey& key = missing.front().key;
  const Field& field = manifest.fields[static_cast<std::size_t>(key.field)];
  const std::string& component = field.components[static_cast<std::size_t>(key.component)].name;
  const std::vector<int>& shards = missing.front().shards;
  std::string text = absl::StrCat("field \"", field.name, "\"", component.empty() ? "" : ", ",
                                  component, ", step ", key.step, ", in shard",
                                  shards.size() > 1 ? "s " : " ", absl::StrJoin(shards, ", "));
  if (missing.size() > 1) {
    absl::StrAppend(&text, "; and ", missing.size() - 1, " more volume",
                    missing.size() > 2 ? "s" : "");
  }
  return text;
}

absl::Status CheckComplete(const SeriesDescription& series) {
  for (std::size_t shard = 0; shard < series.shard_directories.size(); ++shard) {
    if (series.shard_directories[shard].empty()) {
      return absl::NotFoundError(absl::StrFormat("dataset \"%s\": shard %d of %d is not there",
                                                 series.manifest.name, shard,
                                                 series.shard_directories.size()));
    }
  }
  const std::vector<MissingVolume> missing = MissingVolumes(series);
  return missing.empty()
             ? absl::OkStatus()
             : absl::NotFoundError(absl::StrCat("dataset \"", series.manifest.name,
                                                "\" lacks volumes that its manifest names: ",
                                                DescribeMissing(missing, series.manifest)));
}

absl::StatusOr<std::vector<std::string>> ShardDirectoriesOf(const std::string& directory) {
  if (IsSeriesDirectory(directory)) {
    ISOSCOPE_ASSIGN_OR_RETURN(SeriesDescription series, OpenSeries(directory));
    return std::move(series.shard_directories);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(DatasetDescription dataset, OpenDataset(directory));
  return std::move(dataset.shard_directories);
}

absl::Status WriteSeriesManifest(const std::string& directory, const SeriesManifest& manifest,
                                 int shard_index) {
  const std::string path = PathIn(directory, kManifestFileName);
  const std::string bytes = EncodeSeriesManifest(manifest);
  if (const auto decoded = DecodeSeriesManifest(bytes, path); !decoded.ok()) {
    return absl::InvalidArgumentError(decoded.status().message());
  }
  if (static_cast<std::int64_t>(bytes.size()) > kMaxSeriesManifestBytes) {
    return absl::InvalidArgumentError(absl::StrFormat("%s: %d bytes, expected at most %d", path,
                                                      bytes.size(), kMaxSeriesManifestBytes));
  }
  if (shard_index >= 0) {
    ISOSCOPE_CHECK_LT(shard_index, manifest.shard_count);
    ISOSCOPE_RETURN_IF_ERROR(io::WriteFileAtomically(PathIn(directory, kSeriesShardFileName),
                                                     EncodeSeriesShard(manifest, shard_index)));
  }
  ISOSCOPE_RETURN_IF_ERROR(io::WriteFileAtomically(path, bytes));
  return io::SyncDirectory(directory);
}

}  // namespace isoscope::store
