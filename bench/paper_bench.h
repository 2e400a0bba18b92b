// The measurements behind the paper's figures 1, 6, 7, 8 and 9 (references.bib:
// zhang-random-distribution), on any volume. This file measures; paper_bench_report makes tables,
// and paper_bench_plots makes pictures of the figures.

#ifndef ISOSCOPE_BENCH_PAPER_BENCH_H_
#define ISOSCOPE_BENCH_PAPER_BENCH_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "bench/isolated_cluster.h"
#include "clients/cpp/request/camera_flags.h"
#include "core/base/cancellation.h"
#include "core/frame/culling.h"
#include "core/render/renderer.h"
#include "core/store/manifest.h"

namespace isoscope::bench {

struct PaperBenchPlan {
  // In field units, ascending; empty: `isovalue_count` ones, evenly spread inside the value range.
  std::vector<double> isovalues;
  int isovalue_count = 16;
  // Isovalues of figures 7, 8 and 9; 7 and 9 use the first one. Empty: the middle one of the
  // levels.
  std::vector<double> picture_isovalues;
  std::vector<int> balance_agent_counts{2, 4, 8, 16, 32, 64};               // of figure 1
  std::vector<int> speedup_agent_counts{2, 4, 8, 16};                       // of figure 7
  store::Distribution speedup_distribution = store::Distribution::kRandom;  // of figure 7
  int side_px = 1024;
  // Repetitions of each measurement; the least time counts, because disturbances only add time.
  int run_count = 3;
  client::CameraFlags camera{.azimuth_degrees = 30, .elevation_degrees = 20};
  double side_view_degrees = 90;  // how far figure 9 turns to the side
};

// Figure 1: one agent at one isovalue, nothing culled.
struct BalanceRow {
  store::Distribution distribution = store::Distribution::kRandom;
  int agent_count = 0;
  int agent = 0;
  double isovalue = 0;
  std::int64_t active_block_count = 0;
  std::int64_t triangle_count = 0;
  double busy_ms = 0;
};

// Theorem 2.2 at one isovalue, with the observed values. Work is counted in triangles, as in the
// paper: W in all, w of the largest block.
struct BoundRow {
  store::Distribution distribution = store::Distribution::kRandom;
  int agent_count = 0;
  double isovalue = 0;
  std::int64_t total_triangle_count = 0;      // W
  std::int64_t max_block_triangle_count = 0;  // w
  // The theorem applies if W exceeds alpha * w * P * ln r; with c = 1, r = P.
  double premise_triangle_count = 0;
  bool does_premise_hold = false;
  double bound_triangle_count = 0;  // 2 W / P
  // 1 - P (e/4)^(W / (w P)), from the proof before its simplification; at least 0.
  double probability_bound = 0;
  std::int64_t max_triangle_count = 0;  // of one agent, observed
  double max_over_mean_blocks = 0;
  double max_over_mean_triangles = 0;
  double max_over_mean_busy = 0;
};

// Figure 6: one agent.
struct SweepRow {
  double isovalue = 0;
  frame::Culling culling = frame::Culling::kNone;
  std::int64_t active_block_count = 0;
  std::int64_t drawn_block_count = 0;
  std::int64_t triangle_count = 0;
  double busy_ms = 0;
  double other_ms = 0;
};

// Figure 7: one of several agents, with culling by depth.
struct AgentTimeRow {
  int agent_count = 0;
  int agent = 0;
  std::int64_t triangle_count = 0;
  double busy_ms = 0;
};
struct SpeedupRow {
  int agent_count = 0;
  double max_busy_ms = 0;
  double sum_busy_ms = 0;
  double other_ms = 0;
  double alone_busy_ms = 0;  // of one agent, measured alternately with these
  double agent_speedup = 0;  // alone_busy_ms over the longest of these
  double frame_speedup = 0;  // the same with other_ms on both sides
};

// Figures 8 and 9.
struct PaperPicture {
  std::string name;  // of the file, without its ending
  std::string png;
};
struct StageRow {
  double isovalue = 0;
  // "ray hits", "with neighbours", "final", "whole"; then "own a pixel": the blocks that are
  // necessary for the picture
  std::string stage;
  std::string picture_name;  // empty: same picture as another
  std::int64_t block_count = 0;
  std::int64_t triangle_count = 0;
  double triangle_share = 0;  // of the whole isosurface's
  // Pixels that differ from the whole isosurface's picture.
  std::int64_t differing_pixel_count = 0;
};
struct SideViewRow {
  double isovalue = 0;
  std::int64_t extracted_triangle_count = 0;
  std::int64_t left_out_triangle_count = 0;
  std::int64_t differing_pixel_count = 0;  // (a) against (b)
};

struct PaperBenchResult {
  store::Manifest manifest;  // of the dataset with one shard
  std::vector<double> isovalues;
  double speedup_isovalue = 0;  // of figures 7 and 9
  store::Distribution speedup_distribution = store::Distribution::kRandom;
  std::vector<BalanceRow> balance;   // by distribution, agent count, agent, isovalue
  std::vector<BoundRow> bounds;      // by distribution, agent count, isovalue
  std::vector<SweepRow> sweep;       // by culling, isovalue
  std::vector<AgentTimeRow> agents;  // by agent count, agent
  std::vector<SpeedupRow> speedups;  // by agent count, from 1 on
  std::vector<StageRow> stages;      // by isovalue, five each
  std::vector<SideViewRow> side_views;
  std::vector<PaperPicture> pictures;
  std::vector<std::string> notes;  // omitted measurements, with reasons
};

// Partitions the volume into the given number of shards and returns its folder. That of one shard,
// the first one, stays to the end, any other until the next call.
using PartitionInto = absl::FunctionRef<absl::StatusOr<std::string>(store::Distribution, int)>;
// Called with a description of each measurement before it begins.
using PaperProgress = absl::FunctionRef<void(const std::string&)>;

// Measures everything, one agent at a time (IsolatedCluster). Takes minutes. CANCELLED; errors of
// `partition` and of frames. INVALID_ARGUMENT if no sample is a number, or the camera is invalid.
absl::StatusOr<PaperBenchResult> RunPaperBench(const PaperBenchPlan& plan, PartitionInto partition,
                                               render::Renderer* renderer, PaperProgress progress,
                                               const base::Cancellation& cancellation);

// Returns `count` isovalues inside (min, max), evenly spread.
std::vector<double> EvenIsovalues(const volume::ScalarSpan& range, int count);

// Returns the row of one isovalue. `agents` is one frame without culling; block_triangles has the
// triangles of each block with surface.
BoundRow MakeBoundRow(store::Distribution distribution, double isovalue,
                      const std::vector<IsolatedAgent>& agents,
                      const std::vector<std::int64_t>& block_triangles);

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_PAPER_BENCH_H_
