// Measures how far exact frames are from the least that they could cost: a frame that is handed
// exactly the blocks that own a pixel of it, and has nothing to choose.
//
//   whole frame   active blocks, rays, occluding blocks, culling, visible blocks, PNG
//   owners' frame the blocks that own a pixel of the whole frame, PNG; the same bytes
//
// One agent in this process serves all shards. Index, rays and culling of the owners' frame do not
// count; reading, extraction, drawing and encoding do.

#ifndef ISOSCOPE_BENCH_OWNER_BENCH_H_
#define ISOSCOPE_BENCH_OWNER_BENCH_H_

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/cli/command.h"
#include "core/view/camera.h"

namespace isoscope::bench {

struct OwnerBenchPlan {
  std::string directory;  // of a dataset
  double isovalue = 0;
  int run_count = 3;
  int frame_count = 6;  // >= 2
  double orbit_degrees = 7;
  double azimuth_degrees = 30;
  double elevation_degrees = 20;
  view::Viewport viewport = view::kCommonViewport;
  int thread_count = 0;                                   // 0: one for each core
  std::size_t memory_limit_bytes = std::size_t{1} << 30;  // of the agent; half of it is its cache
};

// Figures of one frame, or medians.
struct OwnerFigures {
  double ms = 0;
  double block_count = 0;  // that were drawn
  double triangle_count = 0;
};

struct OwnerBenchResult {
  OwnerFigures whole;   // following frames: medians over runs of each run's median
  OwnerFigures owners;  // the same
  double active_block_count = 0;
  std::vector<std::vector<double>> whole_ms;  // by run and frame, the first one included
  std::vector<std::vector<double>> owners_ms;

  [[nodiscard]] double ratio() const { return owners.ms > 0 ? whole.ms / owners.ms : 0; }
};

// Finds the owners of each frame, then draws the frames both ways in turn, `run_count` times, each
// time with empty caches. INTERNAL if a picture of the owners differs from that of the whole frame.
// CANCELLED on an interrupt. Errors as store::OpenDataset and agent::OpenShard.
absl::StatusOr<OwnerBenchResult> RunOwnerBench(const OwnerBenchPlan& plan,
                                               const cli::Context& context);

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_OWNER_BENCH_H_
