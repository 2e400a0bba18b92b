#include "bench/paper_bench_plots.h"

#include <algorithm>
#include <set>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "bench/child_process.h"
#include "core/base/status_macros.h"

namespace isoscope::bench {
namespace {

// `body` once as SVG and once as PNG: one multiplot of `rows` x `columns`, under a title or "".
OutputFile Script(const std::string& name, int width_px, int height_px, int rows, int columns,
                  absl::string_view title, absl::string_view body) {
  return {
      absl::StrCat(name, ".gp"),
      absl::StrFormat("# gnuplot %s.gp, in this folder, writes %s.svg and %s.png\n"
                      "set datafile separator comma\n"
                      "do for [format in 'svg png'] {\n"
                      "if (format eq 'svg') {\n"
                      "  set terminal svg size %d,%d background 'white'\n"
                      "} else {\n"
                      "  set terminal pngcairo size %d,%d\n"
                      "}\n"
                      "set output '%s.'.format\n"
                      "set multiplot layout %d,%d%s\n"
                      "%s"
                      "unset multiplot\n"
                      "unset output\n"
                      "}\n",
                      name, name, name, width_px, height_px, width_px, height_px, name, rows,
                      columns, title.empty() ? "" : absl::StrCat(" title \"", title, "\""), body)};
}

// The numbers of agents of figure 1.
std::set<int> BalanceAgentCounts(const PaperBenchResult& result) {
  std::set<int> counts;
  for (const BoundRow& row : result.bounds) {
    counts.insert(row.agent_count);
  }
  return counts;
}

// Columns of figure1_balance.csv by place: 5 blocks, 6 triangles, 7 ms.
OutputFile BalanceScript(int agent_count) {
  std::string body = "set key off\nset xlabel 'isovalue'\nset yrange [0:*]\n";
  for (const char* distribution : {"greedy", "random"}) {
    const struct {
      const char* title;
      int column;
    } panels[] = {{"active blocks", 5}, {"triangles", 6}, {"busy time of the agent, ms", 7}};
    for (const auto& panel : panels) {
      absl::StrAppendFormat(&body,
                            "set title '%s: %s'\n"
                            "plot for [agent=0:%d] 'figure1_balance.csv' skip 1 using "
                            "(strcol(1) eq '%s' && $2 == %d && $3 == agent ? $4 : NaN):%d "
                            "with lines\n",
                            distribution, panel.title, agent_count - 1, distribution, agent_count,
                            panel.column);
    }
  }
  return Script(absl::StrCat("figure1_p", agent_count), 1260, 720, 2, 3,
                absl::StrCat("Figure 1: one curve for each of ", agent_count, " agents"), body);
}

// Columns of figure1_bound.csv by place: 3 isovalue, 5 mean, 6 max, 7 bound, 10 premise.
OutputFile BoundScript(const PaperBenchResult& result) {
  const std::set<int> counts = BalanceAgentCounts(result);
  std::string body = "set xlabel 'isovalue'\nset yrange [0:*]\nset key top right\n";
  for (const int count : counts) {
    const std::string file = "'figure1_bound.csv' skip 1 using ";
    const auto line = [&](const char* distribution, const char* condition, int column,
                          const char* style) {
      return absl::StrCat(file, "(strcol(1) eq '", distribution, "' && $2 == ", count, condition,
                          " ? $3 : NaN):", column, " ", style);
    };
    absl::StrAppend(
        &body, "set title '", count, " agents: triangles'\nplot ",
        absl::StrJoin(
            {line("random", "", 7, "with lines dashtype 2 linecolor 'grey50' title '2 W / P'"),
             line("random", " && $10 == 1", 7,
                  "with points pointtype 7 linecolor 'grey50' title 'premise holds'"),
             line("random", "", 5, "with lines linecolor 'black' title 'mean'"),
             line("random", "", 6, "with linespoints linecolor 1 title 'most, random'"),
             line("greedy", "", 6, "with linespoints linecolor 2 title 'most, greedy'")},
            ", \\\n  "),
        "\n");
  }
  const int columns = std::min(3, std::max(1, static_cast<int>(counts.size())));
  const int rows = std::max(1, (static_cast<int>(counts.size()) + columns - 1) / columns);
  return Script("figure1_bound", 420 * columns, 360 * rows, rows, columns,
                "Theorem 2.2: the bound and the agent with the most triangles", body);
}

// Columns of figure6.csv by place: 2 isovalue, 5 triangles, 6 ms.
OutputFile SweepScript() {
  std::string body = "set xlabel 'isovalue'\nset yrange [0:*]\nset key top right\n";
  const struct {
    const char* title;
    int column;
  } panels[] = {{"(a) triangles extracted", 5}, {"(b) busy time of the agent, ms", 6}};
  for (const auto& panel : panels) {
    absl::StrAppendFormat(&body,
                          "set title '%s'\n"
                          "plot for [culling in 'none depth mask'] 'figure6.csv' skip 1 using "
                          "(strcol(1) eq culling ? $2 : NaN):%d with linespoints "
                          "title 'culling '.culling\n",
                          panel.title, panel.column);
  }
  return Script("figure6", 1100, 440, 1, 2,
                "Figure 6: with and without culling, one agent on one thread", body);
}

// Columns of figure7_agents.csv by place: 1 agents, 2 agent, 5 ms; of figure7_speedup.csv: 1
// agents, 6 and 7 speed-ups.
OutputFile SpeedupScript(const PaperBenchResult& result) {
  std::vector<int> counts;
  for (const SpeedupRow& row : result.speedups) {
    if (row.agent_count > 1) {
      counts.push_back(row.agent_count);
    }
  }
  const int most = result.speedups.empty() ? 1 : result.speedups.back().agent_count;
  std::string body;
  if (!counts.empty()) {
    absl::StrAppendFormat(&body,
                          "set key top right\nset yrange [0:*]\nset xrange [0:%d]\n"
                          "set xlabel 'agent'\nset title '(a) busy time of each agent, ms'\n"
                          "plot for [count in '%s'] 'figure7_agents.csv' skip 1 using "
                          "($1 == count + 0 ? $2 + 1 : NaN):5 with linespoints "
                          "title count.' agents'\n",
                          most + 1, absl::StrJoin(counts, " "));
  }
  absl::StrAppendFormat(&body,
                        "set key top left\nset yrange [0:%d]\nset xrange [0:%d]\n"
                        "set xlabel 'agents'\nset title '(b) speed-up'\n"
                        "plot x with lines dashtype 2 linecolor 'grey50' title 'ideal', \\\n"
                        "  'figure7_speedup.csv' skip 1 using 1:6 with linespoints "
                        "title 'agents', \\\n"
                        "  'figure7_speedup.csv' skip 1 using 1:7 with linespoints "
                        "title 'whole frame'\n",
                        most + 1, most + 1);
  return Script("figure7", 1100, 440, 1, counts.empty() ? 1 : 2,
                absl::StrFormat("Figure 7: isovalue %g, agents measured one at a time",
                                result.speedup_isovalue),
                body);
}

constexpr char kPictureSettings[] =
    "unset border\nunset tics\nunset key\nset size ratio -1\nset margins 0,0,0,2\n";

std::string PlotPicture(const std::string& title, const std::string& file_name) {
  return absl::StrCat("set title \"", title, "\"\nplot '", file_name,
                      "' binary filetype=png with rgbimage\n");
}

OutputFile StageScript(const PaperBenchResult& result) {
  std::string body = kPictureSettings;
  int rows = 0;
  for (const StageRow& row : result.stages) {
    if (row.stage == "whole") {
      ++rows;
      continue;  // looks as the final one
    }
    if (row.picture_name.empty()) {
      continue;
    }
    absl::StrAppend(
        &body, PlotPicture(absl::StrFormat("isovalue %g, %s: %.1f %% of triangles", row.isovalue,
                                           row.stage, 100 * row.triangle_share),
                           row.picture_name + ".png"));
  }
  return Script("figure8", 1260, 460 * std::max(1, rows), std::max(1, rows), 3, "", body);
}

OutputFile SideViewScript(const PaperBenchResult& result) {
  const SideViewRow& row = result.side_views.front();
  const std::int64_t all = row.extracted_triangle_count + row.left_out_triangle_count;
  const double share =
      all > 0 ? 100.0 * static_cast<double>(row.extracted_triangle_count) / static_cast<double>(all)
              : 0.0;
  return Script(
      "figure9", 1260, 460, 1, 3, "",
      absl::StrCat(kPictureSettings,
                   PlotPicture(absl::StrFormat("(a) isovalue %g, whole", row.isovalue),
                               "figure9_a_whole.png"),
                   PlotPicture(absl::StrFormat("(b) culled: %.1f %% of triangles", share),
                               "figure9_b_culled.png"),
                   PlotPicture("(c) b from the side; red: not extracted", "figure9_c_side.png")));
}

}  // namespace

std::vector<OutputFile> PaperPlotScripts(const PaperBenchResult& result) {
  std::vector<OutputFile> scripts;
  for (const int agent_count : BalanceAgentCounts(result)) {
    scripts.push_back(BalanceScript(agent_count));
  }
  scripts.push_back(BoundScript(result));
  scripts.push_back(SweepScript());
  scripts.push_back(SpeedupScript(result));
  scripts.push_back(StageScript(result));
  scripts.push_back(SideViewScript(result));
  return scripts;
}

absl::Status DrawPlots(const std::string& folder, const std::vector<OutputFile>& scripts,
                       cli::Interrupt* interrupt) {
  for (const OutputFile& script : scripts) {
    absl::StatusOr<ChildResult> child = RunChild({"gnuplot", script.name}, folder, interrupt);
    if (absl::IsNotFound(child.status())) {
      return absl::NotFoundError("gnuplot is not installed; install the package gnuplot-nox");
    }
    ISOSCOPE_RETURN_IF_ERROR(child.status());
    if (child->exit_code != 0) {
      return absl::InternalError(absl::StrCat("gnuplot ", script.name, " ended with exit code ",
                                              child->exit_code, ": ", LastLine(child->err)));
    }
  }
  return absl::OkStatus();
}

}  // namespace isoscope::bench
