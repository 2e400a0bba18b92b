// Two outputs from the same rows:
//
// 1. PaperTables: one CSV file for each table, with every measured row. The plots read them.
// 2. PaperReport: report.md, with a section for each figure. It has the values that readers compare
//    first: median and worst of the ratios, shares in per cent.

#include "bench/paper_bench_report.h"

#include <algorithm>
#include <cstdint>
#include <map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "bench/csv.h"
#include "bench/sample_statistics.h"
#include "core/cli/format.h"

namespace isoscope::bench {
namespace {

std::string Cell(std::int64_t value) { return absl::StrCat(value); }
std::string Cell(double value) { return CsvNumber(value); }
std::string Cell(absl::string_view value) { return std::string(value); }

CsvTable BalanceTable(const PaperBenchResult& result) {
  CsvTable table(
      {"distribution", "agents", "agent", "isovalue", "active_blocks", "triangles", "busy_ms"});
  for (const BalanceRow& row : result.balance) {
    table.AddRow({Cell(store::NameOf(row.distribution)), absl::StrCat(row.agent_count),
                  absl::StrCat(row.agent), Cell(row.isovalue), Cell(row.active_block_count),
                  Cell(row.triangle_count), Cell(row.busy_ms)});
  }
  return table;
}

CsvTable BoundTable(const PaperBenchResult& result) {
  CsvTable table({"distribution", "agents", "isovalue", "total_triangles", "mean_triangles",
                  "max_triangles", "bound_triangles", "max_block_triangles", "premise_triangles",
                  "premise_holds", "probability_bound", "max_over_mean_blocks",
                  "max_over_mean_triangles", "max_over_mean_busy"});
  for (const BoundRow& row : result.bounds) {
    table.AddRow({Cell(store::NameOf(row.distribution)), absl::StrCat(row.agent_count),
                  Cell(row.isovalue), Cell(row.total_triangle_count),
                  Cell(row.bound_triangle_count / 2), Cell(row.max_triangle_count),
                  Cell(row.bound_triangle_count), Cell(row.max_block_triangle_count),
                  Cell(row.premise_triangle_count), row.does_premise_hold ? "1" : "0",
                  Cell(row.probability_bound), Cell(row.max_over_mean_blocks),
                  Cell(row.max_over_mean_triangles), Cell(row.max_over_mean_busy)});
  }
  return table;
}

CsvTable SweepTable(const PaperBenchResult& result) {
  CsvTable table(
      {"culling", "isovalue", "active_blocks", "drawn_blocks", "triangles", "busy_ms", "other_ms"});
  for (const SweepRow& row : result.sweep) {
    table.AddRow({Cell(NameOf(row.culling)), Cell(row.isovalue), Cell(row.active_block_count),
                  Cell(row.drawn_block_count), Cell(row.triangle_count), Cell(row.busy_ms),
                  Cell(row.other_ms)});
  }
  return table;
}

CsvTable AgentTimeTable(const PaperBenchResult& result) {
  CsvTable table({"agents", "agent", "isovalue", "triangles", "busy_ms"});
  for (const AgentTimeRow& row : result.agents) {
    table.AddRow({absl::StrCat(row.agent_count), absl::StrCat(row.agent),
                  Cell(result.speedup_isovalue), Cell(row.triangle_count), Cell(row.busy_ms)});
  }
  return table;
}

CsvTable SpeedupTable(const PaperBenchResult& result) {
  CsvTable table({"agents", "isovalue", "max_busy_ms", "sum_busy_ms", "other_ms", "agent_speedup",
                  "frame_speedup", "alone_busy_ms"});
  for (const SpeedupRow& row : result.speedups) {
    table.AddRow({absl::StrCat(row.agent_count), Cell(result.speedup_isovalue),
                  Cell(row.max_busy_ms), Cell(row.sum_busy_ms), Cell(row.other_ms),
                  Cell(row.agent_speedup), Cell(row.frame_speedup), Cell(row.alone_busy_ms)});
  }
  return table;
}

CsvTable StageTable(const PaperBenchResult& result) {
  CsvTable table({"isovalue", "stage", "blocks", "triangles", "triangle_share", "differing_pixels",
                  "picture"});
  for (const StageRow& row : result.stages) {
    table.AddRow({Cell(row.isovalue), row.stage, Cell(row.block_count), Cell(row.triangle_count),
                  Cell(row.triangle_share), Cell(row.differing_pixel_count),
                  row.picture_name.empty() ? "" : row.picture_name + ".png"});
  }
  return table;
}

CsvTable SideViewTable(const PaperBenchResult& result) {
  CsvTable table({"isovalue", "extracted_triangles", "left_out_triangles", "differing_pixels"});
  for (const SideViewRow& row : result.side_views) {
    table.AddRow({Cell(row.isovalue), Cell(row.extracted_triangle_count),
                  Cell(row.left_out_triangle_count), Cell(row.differing_pixel_count)});
  }
  return table;
}

std::string MarkdownRow(const std::vector<std::string>& cells) {
  return absl::StrCat("| ", absl::StrJoin(cells, " | "), " |\n");
}

std::string MarkdownHeader(const std::vector<std::string>& cells) {
  std::string rule = "|";
  for (std::size_t i = 0; i < cells.size(); ++i) {
    absl::StrAppend(&rule, "---|");
  }
  return absl::StrCat(MarkdownRow(cells), rule, "\n");
}

std::string Ratio(double value) { return absl::StrFormat("%.2f", value); }
std::string IsovalueText(double value) { return absl::StrFormat("%g", value); }

// The imbalances at all isovalues, for one distribution and number of agents.
struct Balances {
  std::vector<double> blocks;
  std::vector<double> triangles;
  std::vector<double> busy;
  std::vector<double> triangles_with_premise;
};

// Returns "1.02, 1.18": the median and the largest; "-" for none.
std::string MiddleAndWorst(const std::vector<double>& values) {
  return values.empty() ? "-"
                        : absl::StrFormat("%.2f, %.2f", Median(values),
                                          *std::max_element(values.begin(), values.end()));
}

std::string BalanceSection(const PaperBenchResult& result) {
  std::map<std::pair<int, absl::string_view>, Balances> balances;
  for (const BoundRow& row : result.bounds) {
    Balances& of = balances[{row.agent_count, store::NameOf(row.distribution)}];
    of.blocks.push_back(row.max_over_mean_blocks);
    of.triangles.push_back(row.max_over_mean_triangles);
    of.busy.push_back(row.max_over_mean_busy);
    if (row.does_premise_hold) {
      of.triangles_with_premise.push_back(row.max_over_mean_triangles);
    }
  }
  std::string text =
      "## Figure 1: balance over the whole range of isovalues\n\n"
      "Nothing culled. The most of one agent over the mean of all: the middle and the worst of the "
      "isovalues.\nTheorem 2.2 (c = 1, r = P) bounds triangles by 2, with probability 1 - 1/P or "
      "more, where its premise\nW > alpha w P ln P holds: the last three columns. It speaks of "
      "`random` alone.\n\n";
  absl::StrAppend(&text,
                  MarkdownHeader({"agents", "distribution", "blocks", "triangles", "busy time",
                                  "isovalues with premise", "triangles there", "bound"}));
  for (const auto& [key, of] : balances) {
    absl::StrAppend(
        &text,
        MarkdownRow(
            {absl::StrCat(key.first), std::string(key.second), MiddleAndWorst(of.blocks),
             MiddleAndWorst(of.triangles), MiddleAndWorst(of.busy),
             absl::StrFormat("%d of %d", of.triangles_with_premise.size(), of.triangles.size()),
             MiddleAndWorst(of.triangles_with_premise), "2"}));
  }
  absl::StrAppend(&text, "\n![theorem 2.2](figure1_bound.svg)\n\n");
  int last = 0;
  for (const auto& [key, of] : balances) {
    if (std::exchange(last, key.first) != key.first) {
      absl::StrAppend(&text, "![figure 1, ", key.first, " agents](figure1_p", key.first,
                      ".svg)\n\n");
    }
  }
  return text;
}

std::string SweepSection(const PaperBenchResult& result) {
  std::map<double, std::map<frame::Culling, const SweepRow*>> by_isovalue;
  for (const SweepRow& row : result.sweep) {
    by_isovalue[row.isovalue][row.culling] = &row;
  }
  std::string text =
      "## Figure 6: with and without culling, one agent on one thread\n\n"
      "Times are the agent's busy time; `rest` is what the frame took besides, with culling by "
      "depth.\n\n";
  absl::StrAppend(&text, MarkdownHeader({"isovalue", "triangles, none", "depth", "mask", "ms, none",
                                         "depth", "mask", "rest ms"}));
  for (const auto& [isovalue, rows] : by_isovalue) {
    const SweepRow& none = *rows.at(frame::Culling::kNone);
    const SweepRow& depth = *rows.at(frame::Culling::kDepth);
    const SweepRow& mask = *rows.at(frame::Culling::kMask);
    absl::StrAppend(
        &text,
        MarkdownRow({IsovalueText(isovalue), cli::FormatCount(none.triangle_count),
                     cli::FormatCount(depth.triangle_count), cli::FormatCount(mask.triangle_count),
                     cli::FormatMilliseconds(none.busy_ms), cli::FormatMilliseconds(depth.busy_ms),
                     cli::FormatMilliseconds(mask.busy_ms),
                     cli::FormatMilliseconds(depth.other_ms)}));
  }
  return absl::StrCat(text, "\n![figure 6](figure6.svg)\n\n");
}

std::string SpeedupSection(const PaperBenchResult& result) {
  std::string text = absl::StrCat(
      "## Figure 7: speed-up at isovalue ", IsovalueText(result.speedup_isovalue), ", ",
      store::NameOf(result.speedup_distribution),
      " distribution, culling by depth\n\n"
      "Speed-up of the agents is the busy time of one agent alone over the longest of P, as in the "
      "paper; that\nof the frame adds on both sides what is not the agents' (decoding pixels, "
      "reduces, the test of blocks),\nall of it on one thread. One alone is measured in turn with "
      "each P.\n\n");
  absl::StrAppend(&text,
                  MarkdownHeader({"agents", "one alone ms", "longest ms", "sum ms", "sum / alone",
                                  "rest ms", "speed-up of the agents", "of the frame"}));
  for (const SpeedupRow& row : result.speedups) {
    absl::StrAppend(
        &text,
        MarkdownRow(
            {absl::StrCat(row.agent_count), cli::FormatMilliseconds(row.alone_busy_ms),
             cli::FormatMilliseconds(row.max_busy_ms), cli::FormatMilliseconds(row.sum_busy_ms),
             Ratio(row.sum_busy_ms / row.alone_busy_ms), cli::FormatMilliseconds(row.other_ms),
             Ratio(row.agent_speedup), Ratio(row.frame_speedup)}));
  }
  return absl::StrCat(text, "\n![figure 7](figure7.svg)\n\n");
}

std::string PictureSections(const PaperBenchResult& result) {
  std::string text = "## Figure 8: from rays to the picture\n\n";
  absl::StrAppend(&text, MarkdownHeader({"isovalue", "stage", "blocks", "triangles", "share",
                                         "pixels that differ from the whole surface's"}));
  for (const StageRow& row : result.stages) {
    absl::StrAppend(
        &text, MarkdownRow({IsovalueText(row.isovalue), row.stage,
                            cli::FormatCount(row.block_count), cli::FormatCount(row.triangle_count),
                            absl::StrFormat("%.1f %%", 100 * row.triangle_share),
                            cli::FormatCount(row.differing_pixel_count)}));
  }
  absl::StrAppend(&text,
                  "\n![figure 8](figure8.svg)\n\n## Figure 9: the culled surface from the "
                  "side\n\n");
  for (const SideViewRow& row : result.side_views) {
    absl::StrAppend(&text, "Isovalue ", IsovalueText(row.isovalue), ": ",
                    cli::FormatCount(row.extracted_triangle_count), " triangles extracted, ",
                    cli::FormatCount(row.left_out_triangle_count),
                    " left out (red in c); pictures a and b differ in ",
                    cli::FormatCount(row.differing_pixel_count), " pixels.\n");
  }
  return absl::StrCat(text, "\n![figure 9](figure9.svg)\n");
}

std::string FactsSection(const PaperBenchResult& result, const PaperReportFacts& facts) {
  const store::Manifest& manifest = result.manifest;
  const math::Index3& dims = manifest.geometry.sample_dims;
  int most_agents = 1;
  for (const BoundRow& row : result.bounds) {
    most_agents = std::max(most_agents, row.agent_count);
  }
  for (const SpeedupRow& row : result.speedups) {
    most_agents = std::max(most_agents, row.agent_count);
  }
  std::string text = absl::StrCat(
      "# The paper's evaluation on ", manifest.source, "\n\n", facts.timestamp, "; ",
      ToString(facts.machine), "; renderer ", facts.renderer, ".\n\n    ", facts.command, "\n\n",
      manifest.source, ": ", dims.x, " x ", dims.y, " x ", dims.z, " samples of ",
      volume::NameOf(manifest.scalar_type), ", values ", IsovalueText(manifest.value_range.min),
      " to ", IsovalueText(manifest.value_range.max), ", blocks of ", manifest.block_cells.x, " x ",
      manifest.block_cells.y, " x ", manifest.block_cells.z, " cells; ", facts.side_px, " x ",
      facts.side_px, " pixels; each time the least of ", facts.run_count,
      facts.run_count == 1 ? " run" : " runs",
      ", nothing cached in the agents, files in the page cache.\n\n");
  absl::StrAppend(
      &text,
      "Measured in isolation: all agents of every figure, one at a time, each alone on one "
      "thread of this\nprocess, so that its time is what it would take on a machine of its "
      "own. ",
      most_agents > facts.machine.core_count
          ? absl::StrCat("This machine has ", facts.machine.core_count,
                         " cores and could not run up to ", most_agents, " agents side by side.")
          : absl::StrCat("(This machine's ", facts.machine.core_count,
                         " cores could have run them side by side.)"),
      " The network is not part of any time.\n\n");
  for (const std::string& note : result.notes) {
    absl::StrAppend(&text, "- ", note, "\n");
  }
  if (!facts.missing_plots.empty()) {
    absl::StrAppend(&text, "- no plots: ", facts.missing_plots,
                    "; every figure is in the CSV files, and the .gp scripts draw them\n");
  }
  if (!result.notes.empty() || !facts.missing_plots.empty()) {
    absl::StrAppend(&text, "\n");
  }
  return text;
}

}  // namespace

std::vector<OutputFile> PaperTables(const PaperBenchResult& result) {
  return {{"figure1_balance.csv", BalanceTable(result).ToString()},
          {"figure1_bound.csv", BoundTable(result).ToString()},
          {"figure6.csv", SweepTable(result).ToString()},
          {"figure7_agents.csv", AgentTimeTable(result).ToString()},
          {"figure7_speedup.csv", SpeedupTable(result).ToString()},
          {"figure8.csv", StageTable(result).ToString()},
          {"figure9.csv", SideViewTable(result).ToString()}};
}

std::string PaperReport(const PaperBenchResult& result, const PaperReportFacts& facts) {
  return absl::StrCat(FactsSection(result, facts), BalanceSection(result), SweepSection(result),
                      SpeedupSection(result), PictureSections(result));
}

absl::string_view NameOf(frame::Culling culling) {
  switch (culling) {
    case frame::Culling::kDepth:
      return "depth";
    case frame::Culling::kMask:
      return "mask";
    case frame::Culling::kNone:
      return "none";
  }
  return "";
}

}  // namespace isoscope::bench
