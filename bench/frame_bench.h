// Measures whole frames from a client's view. Each bench run, one repetition of a case (`--runs`),
// is a fresh process, so that its first frame is cold. This file measures; frame_bench_report
// prints.

#ifndef ISOSCOPE_BENCH_FRAME_BENCH_H_
#define ISOSCOPE_BENCH_FRAME_BENCH_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "bench/peer.h"
#include "core/cli/command.h"

namespace isoscope::bench {

// The members of "durations_ms", in the order of a frame.
inline constexpr std::array<const char*, 5> kFrameSteps = {
    "occluder_selection", "occluder_rendering", "visibility_culling", "composite", "encode"};

// Figures of one frame, or medians over several: those of `--stats`, with the same names.
struct FrameFigures {
  double wall_ms = 0;
  double level = 0;  // that was drawn; 0 of programs that know no levels
  double active_block_count = 0;
  double visible_block_count = 0;
  double triangle_count = 0;
  double read_bytes = 0;
  double network_bytes = 0;
  double png_bytes = 0;
  std::array<double, kFrameSteps.size()> step_ms{};
  std::vector<double> busy_ms;  // by agent
};

// Reads the JSON of `render --stats`; INTERNAL names a missing member.
absl::StatusOr<std::vector<FrameFigures>> FramesFromJson(absl::string_view text);

// Returns the median of each figure. REQUIRES: at least one frame; equal numbers of agents.
FrameFigures MedianOf(const std::vector<FrameFigures>& frames);

// A dataset folder on disk.
struct BenchDataset {
  int shard_count = 0;
  std::string directory;
};

struct FrameBenchPlan {
  std::string program;  // the path of `isoscope`
  std::vector<BenchDataset> datasets;
  std::vector<double> isovalues;
  std::vector<std::string> cullings;
  std::vector<std::string> renderers;
  int run_count = 3;
  int frame_count = 6;  // >= 2
  double orbit_degrees = 7;
  double azimuth_degrees = 30;
  double elevation_degrees = 20;
  std::int64_t width_px = 1024;
  std::int64_t height_px = 1024;
  std::optional<std::int64_t> thread_count;
  // The level that is drawn: by number, or by the distance of its samples in pixels. At most one is
  // set; none: level 0.
  std::optional<std::int64_t> level;
  std::optional<double> max_spacing_px;
  std::optional<PeerCall> peer;
};

// The measurements of one combination of isovalue, dataset, culling and renderer.
struct FrameCase {
  double isovalue = 0;
  int shard_count = 0;
  std::string culling;
  std::string renderer;
  FrameFigures first = {};      // medians over bench runs
  FrameFigures following = {};  // of each bench run's median over frames 1, 2, ...
  std::vector<std::vector<double>> wall_ms = {};  // by bench run and frame
};

// The peer at one isovalue.
struct PeerCase {
  double isovalue = 0;
  PeerFigures figures = {};  // medians over bench runs
  std::vector<PeerFigures> runs = {};
};

struct FrameBenchResult {
  std::vector<FrameCase> cases;  // by isovalue, renderer, culling, then as the datasets
  std::vector<PeerCase> peers;   // by isovalue; empty without one

  // Returns null without a peer.
  [[nodiscard]] const PeerCase* PeerAt(double isovalue) const;
};

// Runs all cases `run_count` times, interleaved with each other and with the peer. One frame of
// each comes before and is not counted (it brings the files into the page cache). CANCELLED on an
// interrupt; INTERNAL, with its last line of output, if a process fails.
absl::StatusOr<FrameBenchResult> RunFrameBench(const FrameBenchPlan& plan,
                                               const cli::Context& context);

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_FRAME_BENCH_H_
