#include "client-cli/output/level_json.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::cli {
namespace {

store::Manifest TwoLevels() {
  store::Manifest manifest;
  manifest.geometry.sample_dims = {9, 8, 8};
  manifest.geometry.spacing = {0.5, 1, 2};
  manifest.scalar_type = volume::ScalarType::kUint8;
  manifest.levels = {{.dataset_id = std::string(32, 'a')}, {.dataset_id = std::string(32, 'b')}};
  return manifest;
}

TEST(LevelJsonTest, LevelsHaveTheirGridAndTheShardsThatLackThem) {
  const testing::TempDir dir;
  const std::string shard = dir.Sub("shard");
  for (const std::string& folder : {shard, shard + "/level_1"}) {
    ISOSCOPE_ASSERT_OK(io::CreateDirectory(folder));
  }
  ISOSCOPE_ASSERT_OK(io::WriteWholeFile(shard + "/level_1/manifest.json", "{}"));
  const Json levels = LevelsToJson(TwoLevels(), {"", shard});
  EXPECT_EQ(levels, Json::parse(R"([
      {"level":1,"sample_dims":[4,4,4],"spacing":[1.0,2.0,4.0],"sample_type":"uint16",
       "value_scale":256.0,"filter":"mean","sample_bytes":128,"missing_shards":[]},
      {"level":2,"sample_dims":[2,2,2],"spacing":[2.0,4.0,8.0],"sample_type":"uint16",
       "value_scale":256.0,"filter":"mean","sample_bytes":16,"missing_shards":[1]}])"));
  const Json dataset{{"levels", levels}};
  EXPECT_EQ(DescribeLevels(dataset),
            "level 1       4 x 4 x 4 samples of uint16, 0.0 MiB, mean\n"
            "level 2       2 x 2 x 2 samples of uint16, 0.0 MiB, mean, missing in shards 1\n");
  EXPECT_EQ(DescribeLevels(Json::object()), "");
}

TEST(LevelJsonTest, ASeriesCountsTheVolumesThatHaveALevel) {
  store::SeriesManifest series;
  series.geometry.sample_dims = {8, 8, 8};
  series.volumes.resize(3);
  EXPECT_TRUE(LevelsToJson(series).empty());
  series.volumes[0].highest_level = 2;
  series.volumes[2].highest_level = 1;
  const Json levels = LevelsToJson(series);
  EXPECT_EQ(levels, Json::parse(R"([
      {"level":1,"sample_dims":[4,4,4],"spacing":[2.0,2.0,2.0],"volume_count":2},
      {"level":2,"sample_dims":[2,2,2],"spacing":[4.0,4.0,4.0],"volume_count":1}])"));
  EXPECT_EQ(DescribeLevels(Json{{"levels", levels}}),
            "level 1       4 x 4 x 4 samples, of 2 volumes\n"
            "level 2       2 x 2 x 2 samples, of 1 volumes\n");
}

}  // namespace
}  // namespace isoscope::cli
