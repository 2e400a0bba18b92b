#include "client-cli/output/dataset_json.h"

#include <algorithm>
#include <string>
#include <vector>

#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

namespace isoscope::cli {
namespace {

namespace v1 = isoscope::v1;

using ::testing::HasSubstr;

store::DatasetDescription SampleDescription() {
  store::DatasetDescription description;
  store::Manifest& manifest = description.manifest;
  manifest.dataset_id = "0123456789abcdef0123456789abcdef";
  manifest.name = "head";
  manifest.source = "head.nii.gz";
  manifest.geometry.sample_dims = {181, 217, 181};
  manifest.geometry.spacing = {1, 1, 1.5};
  manifest.geometry.origin = {-90, 0.5, 3};
  manifest.scalar_type = volume::ScalarType::kInt16;
  manifest.value_range = {.min = -5, .max = 255};
  manifest.block_cells = {16, 16, 16};
  manifest.distribution = store::Distribution::kGreedy;
  manifest.seed = 18446744073709551615U;
  manifest.shards = {{.block_count = 1000, .block_bytes = 1 << 20},
                     {.block_count = 1016, .block_bytes = 3 << 20}};
  description.shard_directories = {"head/shard-0", ""};
  return description;
}

TEST(DatasetJsonTest, DirectoryHasGeometryShardsAndWhatIsMissing) {
  const Json json = DatasetDirectoryToJson(SampleDescription());
  EXPECT_EQ(json["name"], "head");
  EXPECT_EQ(json["dataset_id"], "0123456789abcdef0123456789abcdef");
  EXPECT_EQ(json["source"], "head.nii.gz");
  EXPECT_EQ(json["sample_dims"], Json::parse("[181, 217, 181]"));
  EXPECT_EQ(json["spacing"], Json::parse("[1.0, 1.0, 1.5]"));
  EXPECT_EQ(json["origin"], Json::parse("[-90.0, 0.5, 3.0]"));
  EXPECT_EQ(json["direction"], Json::parse("[[1.0,0.0,0.0],[0.0,1.0,0.0],[0.0,0.0,1.0]]"));
  EXPECT_EQ(json["sample_type"], "int16");
  EXPECT_EQ(json["value_range"], Json::parse("[-5.0, 255.0]"));
  EXPECT_EQ(json["block_cells"], Json::parse("[16, 16, 16]"));
  EXPECT_EQ(json["block_count"], 12 * 14 * 12);
  EXPECT_EQ(json["shard_count"], 2);
  EXPECT_EQ(json["missing_shards"], Json::parse("[1]"));
  EXPECT_EQ(json["distribution"], "greedy");
  EXPECT_EQ(json["seed"], 18446744073709551615U);
  EXPECT_EQ(json["shards"], Json::parse(R"([
    {"shard": 0, "block_count": 1000, "block_bytes": 1048576},
    {"shard": 1, "block_count": 1016, "block_bytes": 3145728}])"));
}

TEST(DatasetJsonTest, ASeriesHasFieldsStepsAndUnitsUnderTheNamesOfAFolder) {
  v1::Dataset dataset;
  EXPECT_FALSE(DatasetToJson(dataset).contains("fields"));
  dataset.set_time_unit("s");
  for (const int number : {0, 2}) {
    v1::TimeStep* const step = dataset.add_time_steps();
    step->set_number(number);
    step->set_value(0.5 * number);
  }
  v1::Field* const field = dataset.add_fields();
  field->set_name("u");
  field->set_unit("m/s");
  v1::FieldComponent* const component = field->add_components();
  component->set_name("x");
  component->set_sample_type(v1::SAMPLE_TYPE_FLOAT32);
  component->mutable_value_range()->set_min(-1);
  component->mutable_value_range()->set_max(3);
  field->add_time_steps(1);  // an index: the step of number 2
  const Json json = DatasetToJson(dataset);
  EXPECT_EQ(json["time_unit"], "s");
  EXPECT_TRUE(json["length_unit"].is_null());
  EXPECT_EQ(json["time_steps"],
            Json::parse(R"([{"number":0,"value":0.0},{"number":2,"value":1.0}])"));
  EXPECT_EQ(json["fields"], Json::parse(R"([{"name":"u","long_name":null,"unit":"m/s","components":
      [{"name":"x","sample_type":"float32","value_range":[-1.0,3.0],"max_gradient_magnitude":null}],
      "time_steps":[2]}])"));
}

TEST(DatasetJsonTest, VolumeOfNothingButNanHasNoRange) {
  v1::Dataset dataset;
  EXPECT_TRUE(DatasetToJson(dataset)["value_range"].is_null());
}

TEST(DatasetJsonTest, TextSaysTheSame) {
  const std::string text = DescribeDataset(DatasetDirectoryToJson(SampleDescription()));
  EXPECT_THAT(text, HasSubstr("samples       181 x 217 x 181 of int16\n"));
  EXPECT_THAT(text, HasSubstr("values        -5.0 to 255.0\n"));
  EXPECT_THAT(text, HasSubstr("blocks        2,016 of 16 x 16 x 16 cells\n"));
  EXPECT_THAT(text, HasSubstr("shards        2, missing: 1\n"));
  EXPECT_THAT(text, HasSubstr("1       1,016  3.0 MiB\n"));
}

TEST(DatasetJsonTest, AgentsShowStateAndShards) {
  v1::AgentStatus agent;
  agent.set_address("10.0.0.1:50052");
  agent.set_state(v1::AgentStatus::STATE_UNREACHABLE);
  agent.set_message("connection refused");
  agent.set_version("0.1.0");
  agent.set_renderer("cpu");
  agent.set_picture_revision("2 cpu");
  v1::ServedShard& shard = *agent.add_shards();
  shard.set_dataset("head");
  shard.set_shard_index(3);
  shard.set_block_count(504);
  const Json json = AgentToJson(agent);
  EXPECT_EQ(json, Json::parse(R"({"address": "10.0.0.1:50052", "state": "unreachable",
    "message": "connection refused", "version": "0.1.0", "renderer": "cpu", "picture_revision": "2 cpu",
    "shards": [{"dataset": "head", "shard": 3, "block_count": 504}]})"));
  EXPECT_THAT(DescribeAgents(Json::array({json})), HasSubstr("unreachable"));
  EXPECT_THAT(DescribeAgents(Json::array({json})), HasSubstr("head/3"));
  agent.set_state(v1::AgentStatus::STATE_REACHABLE);
  EXPECT_EQ(AgentToJson(agent)["state"], "reachable");
  agent.set_state(v1::AgentStatus::STATE_UNSPECIFIED);
  EXPECT_EQ(AgentToJson(agent)["state"], "unknown");
}

// One agent that can't be reached, and why.
Json UnreachableAgent(const std::string& address, const std::string& message) {
  v1::AgentStatus agent;
  agent.set_address(address);
  agent.set_state(v1::AgentStatus::STATE_UNREACHABLE);
  agent.set_message(message);
  agent.add_shards()->set_dataset("head");
  return AgentToJson(agent);
}

TEST(DescribeAgentsTest, AMessageOfSeveralAgentsStandsOnceAndLinesKeepToTheWidth) {
  const std::string message =
      "failed to connect to all addresses; last error: UNKNOWN: ipv4:10.0.0.1:50052: connection "
      "attempt timed out before receiving SETTINGS frame, and so on for a long time";
  const Json agents = Json::array({UnreachableAgent("10.0.0.1:50052", message),
                                   UnreachableAgent("10.0.0.2:50052", message),
                                   UnreachableAgent("10.0.0.3:50052", "another reason")});
  const std::string text = DescribeAgents(agents, 80);
  EXPECT_THAT(text, HasSubstr("[1] failed to connect"));
  EXPECT_EQ(text.find("failed to connect"), text.rfind("failed to connect"));
  EXPECT_THAT(text, HasSubstr("another reason"));
  for (const absl::string_view line : absl::StrSplit(text, '\n')) {
    EXPECT_LE(line.size(), 80) << line;
  }
  // Into files every row has its message, in one line.
  const std::string full = DescribeAgents(agents);
  EXPECT_NE(full.find(message), full.rfind(message));
  EXPECT_EQ(std::count(full.begin(), full.end(), '\n'), 4);
}

TEST(DatasetJsonTest, LevelsOfAServerAreListed) {
  v1::Dataset dataset;
  dataset.set_name("head");
  EXPECT_FALSE(DatasetToJson(dataset).contains("levels"));
  v1::DatasetLevel* const level = dataset.add_levels();
  level->set_level(2);
  level->mutable_geometry()->mutable_sample_dims()->set_x(16);
  level->mutable_geometry()->mutable_sample_dims()->set_y(15);
  level->mutable_geometry()->mutable_sample_dims()->set_z(14);
  level->mutable_geometry()->mutable_spacing()->set_x(4);
  level->set_block_count(1234);
  level->set_filter(v1::DatasetLevel::FILTER_MEAN);
  const Json json = DatasetToJson(dataset);
  EXPECT_EQ(json.at("levels").dump(),
            R"([{"level":2,"sample_dims":[16,15,14],"spacing":[4.0,0.0,0.0],)"
            R"("block_count":1234,"filter":"mean"}])");
  EXPECT_THAT(DescribeDataset(json, 0),
              ::testing::HasSubstr("level 2       16 x 15 x 14 samples, 1,234 blocks, mean\n"));
}

}  // namespace
}  // namespace isoscope::cli
