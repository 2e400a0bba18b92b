#include "bench/frame_bench.h"

#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>
#include <sys/stat.h>

#include "bench/frame_bench_report.h"
#include "bench/peer.h"
#include "core/cli/interrupt.h"
#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::bench {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

// One frame of `--stats` whose figures all follow from `wall_ms`.
std::string FrameJson(double wall_ms, int agent_count) {
  std::string agents;
  for (int i = 0; i < agent_count; ++i) {
    absl::StrAppend(&agents, i == 0 ? "" : ",", R"({"shard":)", i, R"(,"busy_ms":)", wall_ms + i,
                    "}");
  }
  return absl::StrCat(R"({"wall_ms":)", wall_ms,
                      R"(,"active_block_count":9,"visible_block_count":8,)", R"("triangle_count":)",
                      10 * wall_ms, R"(,"read_bytes":7,"network_bytes":)", 1000 * agent_count,
                      R"(,"png_bytes":6,"durations_ms":{"occluder_selection":1,)",
                      R"("occluder_rendering":2,"visibility_culling":3,"composite":4,"encode":)",
                      wall_ms / 2, R"(},"agents":[)", agents, "]}");
}

TEST(FramesFromJsonTest, ReadsWhatRenderWrites) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::vector<FrameFigures> frames,
                                FramesFromJson(absl::StrCat(R"({"frames":[)", FrameJson(40, 2), ",",
                                                            FrameJson(20, 2), "]}")));
  ASSERT_EQ(frames.size(), 2);
  EXPECT_EQ(frames[0].wall_ms, 40);
  EXPECT_EQ(frames[0].active_block_count, 9);
  EXPECT_EQ(frames[0].visible_block_count, 8);
  EXPECT_EQ(frames[0].triangle_count, 400);
  EXPECT_EQ(frames[0].read_bytes, 7);
  EXPECT_EQ(frames[0].network_bytes, 2000);
  EXPECT_EQ(frames[0].png_bytes, 6);
  EXPECT_THAT(frames[0].step_ms, ElementsAre(1, 2, 3, 4, 20));
  EXPECT_THAT(frames[0].busy_ms, ElementsAre(40, 41));
  EXPECT_EQ(frames[1].wall_ms, 20);
}

TEST(FramesFromJsonTest, WhatIsMissingIsNamed) {
  for (const char* text : {"", "no json", "[]", "{}", R"({"frames":1})", R"({"frames":)"}) {
    EXPECT_THAT(FramesFromJson(text).status(), StatusIs(absl::StatusCode::kInternal)) << text;
  }
  for (const char* text : {R"({"frames":[1]})", R"({"frames":[{"wall_ms":"1"}]})"}) {
    const absl::Status status = FramesFromJson(text).status();
    EXPECT_THAT(status, StatusIs(absl::StatusCode::kInternal));
    EXPECT_THAT(std::string(status.message()), HasSubstr("wall_ms"));
  }
  std::string frame = FrameJson(1, 1);
  frame.replace(frame.find("busy_ms"), 7, "idle_ms");
  const absl::Status status = FramesFromJson(absl::StrCat(R"({"frames":[)", frame, "]}")).status();
  EXPECT_THAT(std::string(status.message()), HasSubstr("\"busy_ms\""));
}

TEST(MedianOfFramesTest, TakesEachFigureByItself) {
  std::vector<FrameFigures> frames(3);
  frames[0].wall_ms = 1;
  frames[1].wall_ms = 9;
  frames[2].wall_ms = 5;
  frames[0].triangle_count = 30;
  frames[1].triangle_count = 10;
  frames[2].triangle_count = 20;
  frames[0].step_ms = {3, 0, 0, 0, 7};
  frames[1].step_ms = {1, 0, 0, 0, 8};
  frames[2].step_ms = {2, 0, 0, 0, 9};
  frames[0].busy_ms = {1, 6};
  frames[1].busy_ms = {2, 5};
  frames[2].busy_ms = {3, 4};
  const FrameFigures median = MedianOf(frames);
  EXPECT_EQ(median.wall_ms, 5);
  EXPECT_EQ(median.triangle_count, 20);
  EXPECT_THAT(median.step_ms, ElementsAre(2, 0, 0, 0, 8));
  EXPECT_THAT(median.busy_ms, ElementsAre(2, 5));
}

PeerCall SomeCall() {
  PeerCall call;
  call.script = "yard.py";
  call.raw_path = "v.raw";
  call.dims = {4, 5, 6};
  call.type = "uint16";
  call.frame_count = 6;
  call.orbit_degrees = 7;
  call.side_px = 512;
  return call;
}

TEST(PeerTest, IsCalledAsItsContractSays) {
  PeerCall call = SomeCall();
  EXPECT_THAT(PeerArguments(call, -1.5),
              ElementsAre("xvfb-run", "-a", "-s", "-screen 0 1280x1024x24", "/usr/bin/python3",
                          "yard.py", "v.raw", "--dims", "4,5,6", "--type", "uint16", "--isovalue",
                          "-1.5", "--frames", "6", "--orbit", "7", "--size", "512"));
  call.spacing = {1, 1, 2.5};
  call.more = {"--azimuth", "40"};
  const std::vector<std::string> arguments = PeerArguments(call, 60);
  EXPECT_THAT(std::vector<std::string>(arguments.end() - 4, arguments.end()),
              ElementsAre("--spacing", "1,1,2.5", "--azimuth", "40"));
}

TEST(PeerTest, FiguresComeFromItsJson) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const PeerFigures figures,
      PeerFiguresFromJson(R"({"triangles": 12, "cold_total": 500.5, "next_total": 250})"));
  EXPECT_EQ(figures.triangle_count, 12);
  EXPECT_EQ(figures.cold_ms, 500.5);
  EXPECT_EQ(figures.following_ms, 250);
  for (const char* text :
       {"", "{", "[]", R"({"cold_total": 1})", R"({"cold_total": "1", "next_total": 2})"}) {
    EXPECT_THAT(PeerFiguresFromJson(text).status(), StatusIs(absl::StatusCode::kInternal)) << text;
  }
}

// Stands in for this program: writes down how it is called and tells of frames, each run slower by
// 10 ms than the one before.
class FakeRenderer {
 public:
  FakeRenderer() {
    std::ofstream script(path());
    script << R"(#!/bin/sh
cd ')" << folder_.path()
           << R"('
echo "$*" >> calls
runs=$(wc -l < calls)
frames=1
agents=1
while [ $# -gt 0 ]; do
  case "$1" in
    --repeat) frames=$2 ;;
    */shards-*) agents=${1##*-} ;;
  esac
  shift
done
busy=''
i=0
while [ $i -lt $agents ]; do
  busy="$busy${busy:+,}{\"busy_ms\":$((i + 1))}"
  i=$((i + 1))
done
printf '{"frames":['
i=0
while [ $i -lt $frames ]; do
  [ $i -gt 0 ] && printf ','
  printf '{"wall_ms":%d,"active_block_count":1,"visible_block_count":1,"triangle_count":5,' \
    $((runs * 10 + i))
  printf '"read_bytes":1,"network_bytes":%d,"png_bytes":1,' $((agents * 100))
  printf '"durations_ms":{"occluder_selection":1,"occluder_rendering":2,"visibility_culling":3,'
  printf '"composite":4,"encode":5},"agents":[%s]}' "$busy"
  i=$((i + 1))
done
printf ']}'
)";
    script.close();
    chmod(path().c_str(), S_IRWXU);
  }

  [[nodiscard]] std::string path() const { return folder_.Sub("program"); }
  [[nodiscard]] std::vector<std::string> Calls() const {
    const absl::StatusOr<std::string> text = io::ReadWholeFile(folder_.Sub("calls"), 1 << 20);
    return absl::StrSplit(text.value_or(""), '\n', absl::SkipEmpty());
  }

 private:
  TempDir folder_;
};

FrameBenchPlan SomePlan(const FakeRenderer& program) {
  FrameBenchPlan plan;
  plan.program = program.path();
  plan.datasets = {{1, "/d/shards-1"}, {4, "/d/shards-4"}};
  plan.isovalues = {60};
  plan.cullings = {"depth"};
  plan.renderers = {"cpu"};
  plan.run_count = 3;
  plan.frame_count = 4;
  return plan;
}

absl::StatusOr<FrameBenchResult> RunPlan(const FrameBenchPlan& plan) {
  cli::Interrupt interrupt;
  std::ostringstream out;
  std::ostringstream err;
  return RunFrameBench(plan, {.out = &out, .err = &err, .interrupt = &interrupt});
}

TEST(RunFrameBenchTest, RunsTakeTurnsAfterOneFrameThatDoesNotCount) {
  const FakeRenderer program;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FrameBenchResult result, RunPlan(SomePlan(program)));
  const std::vector<std::string> calls = program.Calls();
  ASSERT_EQ(calls.size(), 2 + 3 * 2);
  for (std::size_t i = 0; i < calls.size(); ++i) {
    EXPECT_THAT(calls[i], HasSubstr(i % 2 == 0 ? "shards-1 " : "shards-4 "));
    EXPECT_EQ(calls[i].find("--repeat 4 --orbit 7") != std::string::npos, i >= 2) << calls[i];
    EXPECT_THAT(calls[i], HasSubstr("--culling depth --renderer cpu --output /dev/null"));
  }
  // The counted runs of one agent are calls 3, 5, 7; of four agents 4, 6, 8.
  ASSERT_EQ(result.cases.size(), 2);
  EXPECT_EQ(result.cases[0].first.wall_ms, 50);
  EXPECT_EQ(result.cases[0].following.wall_ms, 52);
  EXPECT_EQ(result.cases[1].first.wall_ms, 60);
  EXPECT_THAT(result.cases[0].wall_ms,
              ElementsAre(ElementsAre(30, 31, 32, 33), ElementsAre(50, 51, 52, 53),
                          ElementsAre(70, 71, 72, 73)));
  EXPECT_THAT(result.cases[1].first.busy_ms, ElementsAre(1, 2, 3, 4));
}

TEST(RunFrameBenchTest, TheLevelIsAskedForOnlyIfItIsGiven) {
  const auto calls_of = [](const std::optional<std::int64_t>& level,
                           const std::optional<double>& max_spacing_px) {
    const FakeRenderer program;
    FrameBenchPlan plan = SomePlan(program);
    plan.level = level;
    plan.max_spacing_px = max_spacing_px;
    EXPECT_THAT(RunPlan(plan), testing::IsOk());
    return program.Calls();
  };
  for (const std::string& call : calls_of(std::nullopt, std::nullopt)) {
    EXPECT_EQ(call.find("--level"), std::string::npos) << call;
    EXPECT_EQ(call.find("--max-spacing"), std::string::npos) << call;
  }
  for (const std::string& call : calls_of(2, std::nullopt)) {
    EXPECT_THAT(call, HasSubstr("--level 2"));
  }
  for (const std::string& call : calls_of(std::nullopt, 1.125)) {
    EXPECT_THAT(call, HasSubstr("--max-spacing 1.125"));
  }
}

TEST(FramesFromJsonTest, TheLevelIsThatOfTheFrameOrZero) {
  std::string of_level = FrameJson(40, 1);
  of_level.insert(1, R"("level":2,)");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::vector<FrameFigures> frames,
      FramesFromJson(absl::StrCat(R"({"frames":[)", of_level, ",", FrameJson(20, 1), "]}")));
  EXPECT_EQ(frames[0].level, 2);
  EXPECT_EQ(frames[1].level, 0);
}

TEST(FrameBenchReportTest, LevelsHaveAColumnOnlyIfOneIsDrawn) {
  const FakeRenderer program;
  FrameBenchPlan plan = SomePlan(program);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(FrameBenchResult result, RunPlan(plan));
  EXPECT_EQ(DescribeFrameBench("head", result).find("level"), std::string::npos);
  plan.level = 3;
  result.cases[0].following.level = 3;
  EXPECT_THAT(DescribeFrameBench("head", result), HasSubstr("level"));
  const auto json = nlohmann::json::parse(FrameBenchJson({}, plan, result));
  EXPECT_EQ(json["level"], 3);
  EXPECT_EQ(json["cases"][0]["following"]["level"], 3.0);
}

TEST(RunFrameBenchTest, AProcessThatFailsIsQuoted) {
  const TempDir folder;
  std::ofstream(folder.Sub("program")) << "#!/bin/sh\necho 'no such dataset' >&2\nexit 1\n";
  chmod(folder.Sub("program").c_str(), S_IRWXU);
  FrameBenchPlan plan;
  plan.program = folder.Sub("program");
  plan.datasets = {{1, "/d"}};
  plan.isovalues = {60};
  plan.cullings = {"none"};
  plan.renderers = {"auto"};
  const absl::Status status = RunPlan(plan).status();
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kInternal));
  EXPECT_THAT(std::string(status.message()), HasSubstr("exit code 1: no such dataset"));
}

TEST(FrameBenchReportTest, RatiosAndGrowthAreOfTheRightRows) {
  const FakeRenderer program;
  const FrameBenchPlan plan = SomePlan(program);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(FrameBenchResult result, RunPlan(plan));
  const std::string alone = DescribeFrameBench("head", result);
  EXPECT_EQ(alone.find("peer"), std::string::npos) << "without a peer its columns are left out";

  PeerCase peer;
  peer.isovalue = 60;
  peer.figures = {.cold_ms = 500, .following_ms = 104, .triangle_count = 5};
  peer.runs = {peer.figures};
  result.peers = {peer};
  const std::string text = DescribeFrameBench("head", result);
  const std::vector<std::string> lines = absl::StrSplit(text, '\n');
  EXPECT_THAT(lines[0], HasSubstr("cold x"));
  EXPECT_THAT(lines[1], HasSubstr("10.00    2.00")) << "500 / 50 and 104 / 52";
  EXPECT_THAT(lines[2], HasSubstr("4.00")) << "400 bytes over 100";

  const auto json = nlohmann::json::parse(
      FrameBenchJson({.date = "2026-11-20 19:49 UTC", .volume = "head"}, plan, result));
  EXPECT_EQ(json["cases"][0]["network_growth"], 1.0);
  EXPECT_EQ(json["cases"][1]["network_growth"], 4.0);
  EXPECT_EQ(json["cases"][1]["first"]["busy_sum_ms"], 10.0);
  EXPECT_EQ(json["cases"][1]["first"]["busy_max_over_mean"], 1.6);
  EXPECT_EQ(json["cases"][0]["wall_ms"].size(), 3);
  EXPECT_EQ(json["peers"][0]["cold_ms"], 500.0);
  EXPECT_EQ(json["date"], "2026-11-20 19:49 UTC");
}

}  // namespace
}  // namespace isoscope::bench
