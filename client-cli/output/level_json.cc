#include "client-cli/output/level_json.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "absl/strings/str_cat.h"
#include <nlohmann/json.hpp>

#include "core/cli/format.h"
#include "core/store/shard_levels.h"
#include "core/volume/volume_level.h"

namespace isoscope::cli {
namespace {

Json GridOf(const volume::VolumeLevel& level) {
  const math::Index3& dims = level.grid.sample_dims;
  const math::Vec3d& spacing = level.grid.spacing;
  return {{"level", level.index},
          {"sample_dims", Json::array({dims.x, dims.y, dims.z})},
          {"spacing", Json::array({spacing.x, spacing.y, spacing.z})}};
}

}  // namespace

Json LevelsToJson(const store::Manifest& manifest,
                  const std::vector<std::string>& shard_directories) {
  Json levels = Json::array();
  for (int number = 1; number <= manifest.highest_level(); ++number) {
    const volume::VolumeLevel level = manifest.Level(number);
    Json json = GridOf(level);
    json["sample_type"] = std::string(volume::NameOf(level.type));
    json["value_scale"] = level.value_scale;
    json["filter"] = std::string(volume::NameOf(manifest.level_filter));
    json["sample_bytes"] = math::Volume(level.grid.sample_dims) *
                           static_cast<std::int64_t>(volume::SizeOf(level.type));
    json["missing_shards"] = Json::array();
    for (std::size_t shard = 0; shard < shard_directories.size(); ++shard) {
      if (shard_directories[shard].empty()) {
        continue;
      }
      const std::vector<int> missing = store::MissingLevels(shard_directories[shard], manifest);
      if (std::find(missing.begin(), missing.end(), number) != missing.end()) {
        json["missing_shards"].push_back(shard);
      }
    }
    levels.push_back(std::move(json));
  }
  return levels;
}

Json LevelsToJson(const store::SeriesManifest& series) {
  Json levels = Json::array();
  for (int number = 1; number <= series.highest_level(); ++number) {
    Json json = GridOf(volume::LevelOf(series.geometry, volume::ScalarType::kUint8,
                                       volume::LevelFilter::kMean, number));
    json["volume_count"] =
        std::count_if(series.volumes.begin(), series.volumes.end(),
                      [&](const auto& volume) { return volume.highest_level >= number; });
    levels.push_back(std::move(json));
  }
  return levels;
}

std::string DescribeLevels(const Json& dataset) {
  std::string text;
  if (!dataset.contains("levels")) {
    return text;
  }
  for (const Json& level : dataset.at("levels")) {
    std::string value = absl::StrCat(Joined(level.at("sample_dims"), " x "), " samples");
    if (level.contains("sample_type")) {
      absl::StrAppend(&value, " of ", TextOf(level, "sample_type"), ", ",
                      FormatMebibytes(level.at("sample_bytes").get<std::int64_t>()), ", ",
                      TextOf(level, "filter"));
      if (const Json& missing = level.at("missing_shards"); !missing.empty()) {
        absl::StrAppend(&value, ", missing in shards ", Joined(missing, ", "));
      }
    } else {
      absl::StrAppend(&value, ", of ", level.at("volume_count").dump(), " volumes");
    }
    AddLine(absl::StrCat("level ", level.at("level").dump()), value, &text);
  }
  return text;
}

}  // namespace isoscope::cli
