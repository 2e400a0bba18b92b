#include "bench/paper_bench.h"

#include <cmath>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "bench/paper_bench_plots.h"
#include "bench/paper_bench_report.h"
#include "core/cli/interrupt.h"
#include "core/image/png_codec.h"
#include "core/io/file.h"
#include "core/partition/partitioner.h"
#include "core/render/renderer_factory.h"
#include "core/source/volume_source.h"
#include "tests/support/memory_source.h"
#include "tests/support/skips.h"
#include "tests/support/status_matchers.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/temp_dir.h"

namespace isoscope::bench {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr math::Index3 kDims{41, 37, 33};
constexpr math::Index3 kBlockCells{8, 8, 8};
constexpr int kSidePx = 96;

// A gyroid around 128.
std::string GyroidSamples() {
  return testing::SampleField(testing::GyroidField(2), kDims, volume::ScalarType::kUint8, 80, 128);
}

// Partitions volumes in memory, each into a folder of its own.
class Volumes {
 public:
  explicit Volumes(std::string samples) : samples_(std::move(samples)) {}

  absl::StatusOr<std::string> Partition(store::Distribution distribution, int shard_count) {
    volume::GridGeometry geometry;
    geometry.sample_dims = kDims;
    const auto source =
        testing::MakeMemorySource(geometry, volume::ScalarType::kUint8, samples_, "gyroid");
    partition::PartitionOptions options;
    options.output_directory = folder_.Sub(absl::StrCat("dataset-", next_++));
    options.shard_count = shard_count;
    options.distribution = distribution;
    options.block_cells = kBlockCells;
    const absl::Status status =
        partition::Partition(*source, options, base::Cancellation()).status();
    if (!status.ok()) {
      return status;
    }
    return options.output_directory;
  }

 private:
  TempDir folder_;
  const std::string samples_;
  int next_ = 0;
};

absl::StatusOr<PaperBenchResult> RunSmall(const PaperBenchPlan& plan, const std::string& samples,
                                          const base::Cancellation& cancellation) {
  Volumes volumes(samples);
  auto renderer = render::MakeRenderer({.kind = render::RendererKind::kCpu});
  if (!renderer.ok()) {
    return renderer.status();
  }
  return RunPaperBench(
      plan,
      [&](store::Distribution distribution, int count) {
        return volumes.Partition(distribution, count);
      },
      renderer->get(), [](const std::string&) {}, cancellation);
}

PaperBenchPlan SmallPlan() {
  PaperBenchPlan plan;
  plan.isovalues = {100, 128, 160};
  plan.balance_agent_counts = {2, 5};
  plan.speedup_agent_counts = {2, 3, 1000};
  plan.side_px = kSidePx;
  plan.run_count = 1;
  return plan;
}

// Everything is measured once; the tests look at the parts.
const PaperBenchResult& SmallResult() {
  static const auto* const result = [] {
    absl::StatusOr<PaperBenchResult> run =
        RunSmall(SmallPlan(), GyroidSamples(), base::Cancellation());
    EXPECT_THAT(run, testing::IsOk());
    return new PaperBenchResult(*std::move(run));
  }();
  return *result;
}

// Triangles of the whole isosurface.
std::int64_t WholeTriangles(double isovalue) {
  for (const SweepRow& row : SmallResult().sweep) {
    if (row.isovalue == isovalue && row.culling == frame::Culling::kNone) {
      return row.triangle_count;
    }
  }
  return -1;
}

TEST(BenchPaperTest, AutomaticLevelsLieInsideTheRange) {
  EXPECT_THAT(EvenIsovalues({.min = 0, .max = 255}, 4), ElementsAre(51, 102, 153, 204));
  EXPECT_THAT(EvenIsovalues({.min = -3, .max = 1}, 1), ElementsAre(-1));
}

TEST(BenchPaperTest, TheBoundIsTheoremTwoPointTwo) {
  std::vector<IsolatedAgent> agents(4);
  agents[0] = {.active_block_count = 4, .drawn_block_count = 4, .triangle_count = 40, .busy_ms = 1};
  agents[1] = {.active_block_count = 2, .drawn_block_count = 2, .triangle_count = 20, .busy_ms = 1};
  agents[2] = {.active_block_count = 1, .drawn_block_count = 1, .triangle_count = 10, .busy_ms = 5};
  agents[3] = {.active_block_count = 1, .drawn_block_count = 1, .triangle_count = 10, .busy_ms = 1};
  const BoundRow few = MakeBoundRow(store::Distribution::kRandom, 60, agents, {40, 20, 10, 10});
  EXPECT_EQ(few.total_triangle_count, 80);
  EXPECT_EQ(few.max_block_triangle_count, 40);
  EXPECT_EQ(few.bound_triangle_count, 40);
  EXPECT_EQ(few.max_triangle_count, 40);
  EXPECT_EQ(few.max_over_mean_blocks, 2);
  EXPECT_EQ(few.max_over_mean_triangles, 2);
  EXPECT_EQ(few.max_over_mean_busy, 2.5);
  // alpha = 2 / ln(4/e) = 5.1774, w P ln P = 40 * 4 * 1.3863.
  EXPECT_NEAR(few.premise_triangle_count, 1148.4, 0.1);
  EXPECT_FALSE(few.does_premise_hold);
  EXPECT_EQ(few.probability_bound, 0);

  // At the premise itself the proof's bound is 1 - 1/r^c = 3/4.
  const auto enough = static_cast<std::size_t>(std::ceil(few.premise_triangle_count / 40));
  const BoundRow many =
      MakeBoundRow(store::Distribution::kRandom, 60, agents, std::vector<std::int64_t>(enough, 40));
  EXPECT_TRUE(many.does_premise_hold);
  EXPECT_NEAR(many.probability_bound, 0.75, 0.02);
}

TEST(BenchPaperTest, EveryDistributionDealsOutTheWholeSurface) {
  const PaperBenchResult& result = SmallResult();
  std::map<std::pair<store::Distribution, std::pair<int, double>>, std::int64_t> sums;
  for (const BalanceRow& row : result.balance) {
    sums[{row.distribution, {row.agent_count, row.isovalue}}] += row.triangle_count;
  }
  EXPECT_EQ(sums.size(), 2 * 2 * 3);
  EXPECT_EQ(result.balance.size(), 2 * (2 + 5) * 3);
  for (const auto& [key, sum] : sums) {
    EXPECT_EQ(sum, WholeTriangles(key.second.second)) << key.second.first << " agents";
    EXPECT_GT(sum, 1000);
  }
  ASSERT_EQ(result.bounds.size(), 2 * 2 * 3);
  for (const BoundRow& row : result.bounds) {
    EXPECT_EQ(row.total_triangle_count, WholeTriangles(row.isovalue))
        << "the blocks' triangles do not add up to the frame's";
    EXPECT_GE(row.max_over_mean_triangles, 1);
    EXPECT_LE(row.max_over_mean_triangles, row.agent_count);
    EXPECT_GE(row.max_triangle_count * row.agent_count, row.total_triangle_count);
  }
}

TEST(BenchPaperTest, CullingLeavesTrianglesOutAndNoPixel) {
  const PaperBenchResult& result = SmallResult();
  ASSERT_EQ(result.sweep.size(), 3 * 3);
  for (const SweepRow& row : result.sweep) {
    EXPECT_LE(row.triangle_count, WholeTriangles(row.isovalue));
    EXPECT_LE(row.drawn_block_count, row.active_block_count);
    EXPECT_GT(row.busy_ms, 0);
  }
  ASSERT_EQ(result.stages.size(), 5);
  const std::int64_t whole = WholeTriangles(128);
  EXPECT_EQ(result.stages[3].triangle_count, whole);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(result.stages[i].isovalue, 128) << "the middle level is the default";
    EXPECT_LE(result.stages[i].block_count, result.stages[i + 1].block_count);
    EXPECT_LE(result.stages[i].triangle_count, result.stages[i + 1].triangle_count);
    EXPECT_DOUBLE_EQ(
        result.stages[i].triangle_share,
        static_cast<double>(result.stages[i].triangle_count) / static_cast<double>(whole));
  }
  EXPECT_GT(result.stages[0].triangle_count, 0);
  EXPECT_GT(result.stages[0].differing_pixel_count, 0) << "ray hits alone leave holes";
  EXPECT_EQ(result.stages[2].differing_pixel_count, 0);
  EXPECT_GT(result.stages[4].triangle_count, 0);
  EXPECT_LE(result.stages[4].triangle_count, result.stages[2].triangle_count);
  EXPECT_EQ(result.stages[4].differing_pixel_count, 0) << "other blocks own no pixel";

  ASSERT_EQ(result.side_views.size(), 1);
  EXPECT_EQ(result.side_views[0].differing_pixel_count, 0);
  EXPECT_EQ(
      result.side_views[0].extracted_triangle_count + result.side_views[0].left_out_triangle_count,
      whole);
  EXPECT_EQ(result.side_views[0].extracted_triangle_count, result.stages[2].triangle_count);
}

TEST(BenchPaperTest, SpeedupStartsFromOneAgentAndKeepsTheTriangles) {
  const PaperBenchResult& result = SmallResult();
  ASSERT_EQ(result.speedups.size(), 3) << "1, 2 and 3 agents: 1000 are more than there are blocks";
  EXPECT_EQ(result.speedups[0].agent_count, 1);
  EXPECT_EQ(result.speedups[0].agent_speedup, 1);
  EXPECT_EQ(result.speedups[0].frame_speedup, 1);
  ASSERT_EQ(result.notes.size(), 1);
  EXPECT_THAT(result.notes[0], HasSubstr("1000 agents were left out: the volume has 100 blocks"));
  std::map<int, std::int64_t> triangles;
  std::map<int, double> busy_ms;
  for (const AgentTimeRow& row : result.agents) {
    triangles[row.agent_count] += row.triangle_count;
    busy_ms[row.agent_count] += row.busy_ms;
  }
  for (const SpeedupRow& row : result.speedups) {
    EXPECT_EQ(triangles[row.agent_count], triangles[1]) << "culling depends on the agents";
    EXPECT_DOUBLE_EQ(row.sum_busy_ms, busy_ms[row.agent_count]);
    EXPECT_LE(row.max_busy_ms, row.sum_busy_ms);
    EXPECT_GT(row.alone_busy_ms, 0);
    EXPECT_DOUBLE_EQ(row.agent_speedup, row.alone_busy_ms / row.max_busy_ms);
  }
}

TEST(BenchPaperTest, PicturesAreWholePngsAndShowWhatTheirNamesSay) {
  std::map<std::string, image::RgbaImage> pictures;
  for (const PaperPicture& picture : SmallResult().pictures) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(pictures[picture.name], image::DecodePng(picture.png));
    EXPECT_EQ(pictures[picture.name].width, kSidePx);
    EXPECT_EQ(pictures[picture.name].height, kSidePx);
  }
  EXPECT_EQ(pictures.size(), 4 + 3);
  EXPECT_EQ(pictures["figure8_128_3_final"], pictures["figure8_128_4_whole"]);
  EXPECT_EQ(pictures["figure9_a_whole"], pictures["figure9_b_culled"]);
  const auto red_count = [&](const char* name) {
    int count = 0;
    for (const image::Rgba8& pixel : pictures[name].pixels) {
      count += pixel.r > 2 * pixel.g + 20 ? 1 : 0;
    }
    return count;
  };
  EXPECT_GT(red_count("figure9_c_side"), 0) << "what is not extracted does not show";
  EXPECT_EQ(red_count("figure9_b_culled"), 0);
}

TEST(BenchPaperTest, AVolumeWithoutASurfaceIsMeasuredToo) {
  PaperBenchPlan plan = SmallPlan();
  plan.isovalues = {250};
  plan.balance_agent_counts = {2};
  plan.speedup_agent_counts = {2};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const PaperBenchResult result,
                                RunSmall(plan, GyroidSamples(), base::Cancellation()));
  EXPECT_EQ(result.sweep[0].triangle_count, 0);
  EXPECT_EQ(result.bounds[0].max_over_mean_triangles, 0);
  EXPECT_FALSE(result.bounds[0].does_premise_hold);
  EXPECT_EQ(result.stages[0].triangle_share, 0);
  EXPECT_EQ(PaperTables(result).size(), 7);
}

TEST(BenchPaperTest, SpeedupTakesTheDistributionThatIsAskedFor) {
  PaperBenchPlan plan = SmallPlan();
  plan.isovalues = {128};
  plan.balance_agent_counts = {};
  plan.speedup_agent_counts = {3};
  plan.speedup_distribution = store::Distribution::kGreedy;
  Volumes volumes(GyroidSamples());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto renderer,
                                render::MakeRenderer({.kind = render::RendererKind::kCpu}));
  std::vector<std::pair<store::Distribution, int>> asked_for;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const PaperBenchResult result,
      RunPaperBench(
          plan,
          [&](store::Distribution distribution, int count) {
            asked_for.emplace_back(distribution, count);
            return volumes.Partition(distribution, count);
          },
          renderer.get(), [](const std::string&) {}, base::Cancellation()));
  EXPECT_THAT(asked_for, ElementsAre(std::pair(store::Distribution::kRandom, 1),
                                     std::pair(store::Distribution::kGreedy, 3)));
  EXPECT_THAT(PaperReport(result, {}), HasSubstr("greedy distribution, culling by depth"));
}

TEST(BenchPaperTest, CancellationEndsIt) {
  base::Cancellation cancellation;
  cancellation.Cancel();
  EXPECT_THAT(RunSmall(SmallPlan(), GyroidSamples(), cancellation).status(),
              StatusIs(absl::StatusCode::kCancelled));
}

TEST(BenchPaperReportTest, TablesHaveARowForEachMeasurement) {
  const std::map<std::string, std::size_t> rows = {
      {"figure1_balance.csv", 42}, {"figure1_bound.csv", 12},  {"figure6.csv", 9},
      {"figure7_agents.csv", 6},   {"figure7_speedup.csv", 3}, {"figure8.csv", 5},
      {"figure9.csv", 1}};
  const std::vector<OutputFile> tables = PaperTables(SmallResult());
  ASSERT_EQ(tables.size(), rows.size());
  for (const OutputFile& table : tables) {
    const std::vector<std::string> lines = absl::StrSplit(table.bytes, '\n', absl::SkipEmpty());
    ASSERT_EQ(rows.count(table.name), 1) << table.name;
    EXPECT_EQ(lines.size(), 1 + rows.at(table.name)) << table.name;
    const auto columns = std::vector<std::string>(absl::StrSplit(lines[0], ',')).size();
    for (const std::string& line : lines) {
      EXPECT_EQ(std::vector<std::string>(absl::StrSplit(line, ',')).size(), columns) << line;
    }
  }
}

TEST(BenchPaperReportTest, ThePageSaysHowItWasMeasured) {
  PaperReportFacts facts;
  facts.machine = {.processor = "Some CPU", .core_count = 2, .memory_gib = 8, .system = "Linux"};
  facts.timestamp = "2026-11-20 19:49 UTC";
  facts.command = "isoscope bench paper v.nrrd --output o";
  facts.renderer = "cpu";
  facts.run_count = 1;
  facts.side_px = kSidePx;
  std::string page = PaperReport(SmallResult(), facts);
  for (const char* text :
       {"Some CPU, 2 cores", "2026-11-20 19:49 UTC", "    isoscope bench paper v.nrrd --output o\n",
        "Measured in isolation: all agents of every figure, one at a time",
        "2 cores and could not run up to 5 agents", "1000 agents were left out", "## Figure 1",
        "## Figure 6", "## Figure 7", "## Figure 8", "## Figure 9", "(figure1_p5.svg)"}) {
    EXPECT_THAT(page, HasSubstr(text));
  }
  EXPECT_EQ(page.find("no plots"), std::string::npos);
  facts.machine.core_count = 64;
  facts.missing_plots = "gnuplot is not installed";
  page = PaperReport(SmallResult(), facts);
  EXPECT_THAT(page, HasSubstr("no plots: gnuplot is not installed"));
  EXPECT_EQ(page.find("could not run"), std::string::npos);
}

TEST(BenchPaperPlotsTest, GnuplotTakesEveryScript) {
  const TempDir folder;
  const std::vector<OutputFile> scripts = PaperPlotScripts();
  ASSERT_EQ(scripts.size(), 6) << "figures 1, the bound, 6, 7, 8 and 9";
  for (const std::vector<OutputFile>& files : {scripts, PaperTables(SmallResult())}) {
    for (const OutputFile& file : files) {
      ASSERT_THAT(io::WriteWholeFile(folder.Sub(file.name), file.bytes), testing::IsOk());
    }
  }
  for (const PaperPicture& picture : SmallResult().pictures) {
    ASSERT_THAT(io::WriteWholeFile(folder.Sub(picture.name + ".png"), picture.png),
                testing::IsOk());
  }
  cli::Interrupt interrupt;
  const absl::Status status = DrawPlots(folder.path(), scripts, &interrupt);
  if (absl::IsNotFound(status)) {
    ISOSCOPE_SKIP("gnuplot", std::string(status.message()));
  }
  ASSERT_THAT(status, testing::IsOk());
  // SmallResult has two numbers of agents.
  for (const std::string stem :
       {"figure1_p2", "figure1_p5", "figure1_bound", "figure6", "figure7", "figure8", "figure9"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string png,
                                  io::ReadWholeFile(folder.Sub(stem + ".png"), 1 << 24));
    EXPECT_THAT(image::DecodePng(png), testing::IsOk()) << stem;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string svg,
                                  io::ReadWholeFile(folder.Sub(stem + ".svg"), 1 << 24));
    EXPECT_THAT(svg, HasSubstr("</svg>")) << stem;
  }
}

TEST(BenchPaperPlotsTest, AScriptThatGnuplotRefusesIsNamed) {
  const TempDir folder;
  ASSERT_THAT(io::WriteWholeFile(folder.Sub("bad.gp"), "plot 'absent.csv' using\n"),
              testing::IsOk());
  cli::Interrupt interrupt;
  const absl::Status status = DrawPlots(folder.path(), {{"bad.gp", ""}}, &interrupt);
  if (absl::IsNotFound(status)) {
    ISOSCOPE_SKIP("gnuplot", std::string(status.message()));
  }
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kInternal));
  EXPECT_THAT(std::string(status.message()), HasSubstr("bad.gp"));
}

}  // namespace
}  // namespace isoscope::bench
