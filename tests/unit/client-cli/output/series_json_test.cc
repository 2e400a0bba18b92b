#include "client-cli/output/series_json.h"

#include <filesystem>
#include <string>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

#include "client-cli/output/dataset_json.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::cli {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

store::ScalarVolume VolumeOf(const store::ScalarVolumeKey& key, double min, double max) {
  return {.key = key,
          .dataset_id = std::string(32, 'a'),
          .manifest_crc32c = 0,
          .value_range = {min, max},
          .max_gradient_magnitude = max - min};
}

// Pressure at steps 0 to 2, velocity at step 0 without its component y; three shards, of which the
// second is not here, and the third lacks the pressure of step 2.
class SeriesJsonTest : public ::testing::Test {
 protected:
  SeriesJsonTest() {
    store::SeriesManifest& series = description_.manifest;
    series.dataset_id = "0123456789abcdef0123456789abcdef";
    series.name = "flow";
    series.source = "flow.pvd";
    series.geometry.sample_dims = {17, 17, 9};
    series.geometry.spacing = {0.5, 0.5, 1};
    series.geometry.origin = {-0.0, 0, 1};
    series.length_unit = "m";
    series.block_cells = {8, 8, 8};
    series.seed = 7;
    series.shard_count = 3;
    series.fields = {
        {.name = "p",
         .long_name = "pressure",
         .unit = "Pa",
         .components = {{.name = "", .scalar_type = volume::ScalarType::kFloat32}}},
        {.name = "u",
         .long_name = "",
         .unit = "",
         .components = {{.name = "x", .scalar_type = volume::ScalarType::kInt16},
                        {.name = "y", .scalar_type = volume::ScalarType::kInt16},
                        {.name = "magnitude", .scalar_type = volume::ScalarType::kFloat32}}}};
    series.times = {0, 0.5, 2};
    series.time_unit = "s";
    series.volumes = {VolumeOf({0, 0, 0}, -1, 3), VolumeOf({1, 0, 0}, 0, 5),
                      VolumeOf({1, 2, 0}, 0, 6), VolumeOf({0, 0, 1}, -2, 1),
                      VolumeOf({0, 0, 2}, 1, 1.5)};
    description_.shard_directories = {dir_.Sub("0"), "", dir_.Sub("2")};
    for (const int shard : {0, 2}) {
      for (const store::ScalarVolume& volume : series.volumes) {
        if (shard == 2 && volume.key.step == 2) {
          continue;
        }
        const std::string path = absl::StrCat(dir_.path(), "/", shard, "/",
                                              store::ScalarVolumeDirectoryName(volume.key));
        std::filesystem::create_directories(path);
        testing::WriteFile(path + "/blocks.bin", std::string(1000, 'x'));
      }
    }
  }

  testing::TempDir dir_;
  store::SeriesDescription description_;
};

TEST_F(SeriesJsonTest, HasFieldsStepsAndWhatIsMissing) {
  const Json json = SeriesDirectoryToJson(description_);
  EXPECT_EQ(json["name"], "flow");
  EXPECT_EQ(json["sample_dims"], Json::parse("[17, 17, 9]"));
  EXPECT_EQ(json["origin"], Json::parse("[0.0, 0.0, 1.0]"));
  EXPECT_EQ(json["length_unit"], "m");
  EXPECT_EQ(json["time_unit"], "s");
  EXPECT_EQ(json["time_steps"], Json::parse(R"([{"number": 0, "value": 0.0},
    {"number": 1, "value": 0.5}, {"number": 2, "value": 2.0}])"));
  EXPECT_EQ(json["fields"], Json::parse(R"([
    {"name": "p", "long_name": "pressure", "unit": "Pa", "components": [
      {"name": "", "sample_type": "float32", "value_range": [-2.0, 3.0],
       "max_gradient_magnitude": 4.0}], "time_steps": [0, 1, 2]},
    {"name": "u", "long_name": null, "unit": null, "components": [
      {"name": "x", "sample_type": "int16", "value_range": [0.0, 5.0],
       "max_gradient_magnitude": 5.0},
      {"name": "y", "sample_type": "int16", "value_range": null, "max_gradient_magnitude": null},
      {"name": "magnitude", "sample_type": "float32", "value_range": [0.0, 6.0],
       "max_gradient_magnitude": 6.0}], "time_steps": []}])"));
  EXPECT_EQ(json["block_count"], 4);
  EXPECT_EQ(json["shard_count"], 3);
  EXPECT_EQ(json["missing_shards"], Json::parse("[1]"));
  EXPECT_EQ(json["shards"], Json::parse(R"([
    {"shard": 0, "volume_count": 5, "file_bytes": 5000},
    {"shard": 2, "volume_count": 4, "file_bytes": 4000}])"));
  const Json& missing = json["missing_volumes"];
  ASSERT_EQ(missing.size(), 1 + 6 + 1);
  EXPECT_EQ(missing[0],
            Json::parse(R"({"field": "u", "component": "y", "step": 0, "shards": [0, 2]})"));
  EXPECT_EQ(missing[4],
            Json::parse(R"({"field": "p", "component": "", "step": 2, "shards": [2]})"));
}

TEST_F(SeriesJsonTest, TextSaysTheSame) {
  const std::string text = DescribeDataset(SeriesDirectoryToJson(description_));
  for (const char* line :
       {"dataset       flow\n", "samples       17 x 17 x 9\n", "spacing       0.5, 0.5, 1.0 m\n",
        "steps         3\n", "times         0.0, 0.5, 2.0 s\n",
        "missing       u y at steps 0, 1, 2 in shards 0, 2\n",
        "missing       p at step 2 in shards 2\n", "shards        3, missing: 1\n",
        "p (pressure)             Pa    float32  -2 to 3                  3\n",
        "u             x                int16    0 to 5                   0\n",
        "              y                int16    none that is finite\n",
        "distribution  random, seed 7\n"}) {
    EXPECT_THAT(text, HasSubstr(line));
  }
  EXPECT_THAT(text, Not(HasSubstr("...")));
  description_.manifest.times.clear();
  for (int i = 0; i < 100; ++i) {
    description_.manifest.times.push_back(i);
  }
  EXPECT_THAT(DescribeDataset(SeriesDirectoryToJson(description_)),
              HasSubstr("times         0.0, 1.0, 2.0, 3.0, ..., 99.0 s\n"));
  description_.manifest.times.clear();
  description_.manifest.volumes.resize(3);
  EXPECT_THAT(DescribeDataset(SeriesDirectoryToJson(description_)),
              HasSubstr("steps         1, without a time\n"));
}

}  // namespace
}  // namespace isoscope::cli
