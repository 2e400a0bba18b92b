#include "client-cli/output/frame_statistics.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

namespace isoscope::cli {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using Json = nlohmann::ordered_json;

FrameRecord SampleFrame() {
  FrameRecord frame;
  frame.wall_ms = 41.2345678;
  auto& statistics = frame.statistics;
  statistics.set_active_block_count(1);
  statistics.set_ray_hit_block_count(2);
  statistics.set_occluding_block_count(3);
  statistics.set_visible_block_count(4);
  statistics.set_culled_block_count(5);
  statistics.set_triangle_count(6'000'000'000);
  statistics.set_unique_vertex_count(7);
  statistics.set_read_bytes(8);
  statistics.set_network_bytes(9);
  statistics.set_png_bytes(10);
  auto& durations = *statistics.mutable_durations();
  durations.mutable_occluder_selection_duration()->set_nanos(1'500'000);
  durations.mutable_occluder_rendering_duration()->set_seconds(2);
  durations.mutable_visibility_culling_duration()->set_nanos(3'000'000);
  durations.mutable_composite_duration()->set_nanos(4'000'000);
  durations.mutable_encode_duration()->set_nanos(5'000'400);
  auto& agent = *statistics.add_agents();
  agent.set_agent_address("host:1");
  agent.add_shard_indices(2);
  agent.add_shard_indices(5);
  agent.set_active_block_count(11);
  agent.set_triangle_count(12);
  agent.set_read_bytes(13);
  agent.mutable_extract_duration()->set_nanos(14'000'000);
  agent.mutable_render_duration()->set_nanos(15'000'000);
  agent.mutable_busy_duration()->set_nanos(16'000'000);
  return frame;
}

std::vector<std::string> Names(const Json& object) {
  std::vector<std::string> names;
  for (const auto& [name, value] : object.items()) {
    names.push_back(name);
  }
  return names;
}

// Scripts outside of the repository read these names.
TEST(FrameStatisticsTest, JsonHasExactlyTheMembersOfTheContract) {
  const Json json = Json::parse(StatisticsJson({SampleFrame(), SampleFrame()}));
  EXPECT_THAT(Names(json), ElementsAre("frames"));
  ASSERT_EQ(json["frames"].size(), 2U);
  const Json& frame = json["frames"][1];
  EXPECT_THAT(Names(frame),
              ElementsAre("wall_ms", "active_block_count", "ray_hit_block_count",
                          "occluding_block_count", "visible_block_count", "culled_block_count",
                          "triangle_count", "unique_vertex_count", "read_bytes", "network_bytes",
                          "png_bytes", "durations_ms", "agents"));
  EXPECT_THAT(Names(frame["durations_ms"]),
              ElementsAre("occluder_selection", "occluder_rendering", "visibility_culling",
                          "composite", "encode"));
  EXPECT_THAT(Names(frame["agents"][0]),
              ElementsAre("shard", "active_block_count", "triangle_count", "read_bytes",
                          "extract_ms", "render_ms", "busy_ms", "shards", "address"));
}

TEST(FrameStatisticsTest, JsonHasEveryValueInItsPlace) {
  const Json frame = Json::parse(StatisticsJson({SampleFrame()}))["frames"][0];
  EXPECT_EQ(frame, Json::parse(R"({
    "wall_ms": 41.235, "active_block_count": 1, "ray_hit_block_count": 2,
    "occluding_block_count": 3, "visible_block_count": 4, "culled_block_count": 5,
    "triangle_count": 6000000000, "unique_vertex_count": 7, "read_bytes": 8, "network_bytes": 9,
    "png_bytes": 10,
    "durations_ms": {"occluder_selection": 1.5, "occluder_rendering": 2000.0,
                     "visibility_culling": 3.0, "composite": 4.0, "encode": 5.0},
    "agents": [{"shard": 2, "active_block_count": 11, "triangle_count": 12, "read_bytes": 13,
                "extract_ms": 14.0, "render_ms": 15.0, "busy_ms": 16.0, "shards": [2, 5],
                "address": "host:1"}]})"));
}

TEST(FrameStatisticsTest, SeveralSurfacesAreListed) {
  FrameRecord frame = SampleFrame();
  for (int i = 1; i <= 2; ++i) {
    isoscope::v1::SurfaceStatistics* const surface = frame.statistics.add_surfaces();
    surface->set_triangle_count(100 * i);
    surface->set_unique_vertex_count(10 * i);
  }
  EXPECT_EQ(Json::parse(StatisticsJson({frame}))["frames"][0]["surfaces"],
            Json::parse(R"([{"triangle_count": 100, "unique_vertex_count": 10},
                            {"triangle_count": 200, "unique_vertex_count": 20}])"));
}

TEST(FrameStatisticsTest, MeasuresOfSurfacesAreThereIfTheyWereMeasured) {
  FrameRecord frame = SampleFrame();
  frame.measures = FrameMeasures{.length_unit = "mm", .surfaces = {MeasuredSurface()}};
  frame.measures->surfaces[0].measures = {.area = 2.5, .volume = -0.5, .triangle_count = 4};
  const Json json = Json::parse(StatisticsJson({frame}))["frames"][0];
  EXPECT_EQ(json["measures"]["length_unit"], "mm");
  EXPECT_EQ(json["measures"]["surfaces"][0]["area"], 2.5);
  EXPECT_EQ(json["measures"]["surfaces"][0]["volume"], -0.5);
  EXPECT_THAT(DescribeStatistics({SampleFrame(), frame}),
              AllOf(HasSubstr("Surfaces of the last frame:\n"), HasSubstr("volume mm^3")));
  EXPECT_THAT(DescribeStatistics({SampleFrame()}), Not(HasSubstr("volume")));
}

TEST(FrameStatisticsTest, PixelsWithTooManyLayersAreCountedWhereThereAreAny) {
  FrameRecord record;
  EXPECT_FALSE(
      Json::parse(StatisticsJson({record}))["frames"][0].contains("truncated_pixel_count"));
  EXPECT_FALSE(
      Json::parse(StatisticsJson({record}))["frames"][0].contains("unresolved_block_count"));
  record.statistics.set_unresolved_block_count(0);
  EXPECT_EQ(Json::parse(StatisticsJson({record}))["frames"][0]["unresolved_block_count"], 0);
  record.statistics.set_truncated_pixel_count(7);
  EXPECT_EQ(Json::parse(StatisticsJson({record}))["frames"][0]["truncated_pixel_count"], 7);
}

TEST(FrameStatisticsTest, BandsAreToldWhereThereAreSeveral) {
  FrameRecord at_once = SampleFrame();
  at_once.statistics.set_band_count(1);
  EXPECT_FALSE(Json::parse(StatisticsJson({at_once}))["frames"][0].contains("band_count"));
  EXPECT_EQ(DescribeBands({at_once, SampleFrame()}), "");
  FrameRecord in_bands = SampleFrame();
  in_bands.statistics.set_band_count(12);
  EXPECT_EQ(Json::parse(StatisticsJson({in_bands}))["frames"][0]["band_count"], 12);
  EXPECT_THAT(DescribeStatistics({in_bands}), HasSubstr("The frame was drawn in 12 bands"));
  EXPECT_THAT(DescribeBands({at_once, in_bands}), HasSubstr("One frame was drawn in 12 bands"));
  FrameRecord in_more = SampleFrame();
  in_more.statistics.set_band_count(20);
  EXPECT_THAT(DescribeBands({in_more, in_bands}),
              HasSubstr("2 frames were drawn in 12 to 20 bands"));
}

TEST(FrameStatisticsTest, NoAgentsIsAnEmptyList) {
  EXPECT_EQ(Json::parse(StatisticsJson({FrameRecord{}}))["frames"][0]["agents"], Json::array());
}

TEST(FrameStatisticsTest, TablesShowEveryFrameAndTheLastFramesAgents) {
  const std::string one = DescribeStatistics({SampleFrame()});
  EXPECT_THAT(one, HasSubstr("6,000,000,000"));
  EXPECT_THAT(one, HasSubstr("host:1     2,5"));
  const std::string two = DescribeStatistics({SampleFrame(), SampleFrame()});
  EXPECT_THAT(two, HasSubstr("\n1         41.2"));
  EXPECT_THAT(two, HasSubstr("Agents of the last frame:"));
}

TEST(FrameStatisticsTest, ALevelIsToldIfItWasChosen) {
  FrameRecord frame = SampleFrame();
  EXPECT_EQ(DescribeLevels({frame}), "");
  frame.drawn_level.emplace();
  frame.drawn_level->set_level(2);
  frame.drawn_level->set_max_spacing_px(0.75);
  frame.drawn_level->mutable_spacing()->set_x(4);
  const Json json = Json::parse(StatisticsJson({frame}))["frames"][0];
  EXPECT_EQ(json["level"], 2);
  EXPECT_EQ(json["max_spacing_px"], 0.75);
  EXPECT_EQ(json["spacing"], Json::parse("[4.0, 0.0, 0.0]"));
  EXPECT_EQ(DescribeLevels({frame}), "\nDrawn from level 2, 1 sample = 0.75 px\n");
  FrameRecord finer = frame;
  finer.drawn_level->set_level(1);
  EXPECT_EQ(DescribeLevels({frame, finer, frame}),
            "\nDrawn from level 1 (1 frames), level 2 (2 frames)\n");
  frame.statistics.set_unresolved_block_count(1200);
  EXPECT_EQ(DescribeLevels({frame}),
            "\nDrawn from level 2, 1 sample = 0.75 px; active blocks of level 0 that it does not "
            "resolve: 1,200\n");
}

}  // namespace
}  // namespace isoscope::cli
