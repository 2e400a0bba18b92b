#include "bench/program.h"

namespace isoscope::bench {

cli::Program BenchProgram() {
  return {.name = "isoscope-bench",
          .summary = "measures Isoscope: frames, its algorithm",
          .example = "  isoscope-bench frame head.nii.gz --isovalue 60 --runs 5\n",
          .commands = {FrameBenchCommand(), OwnerBenchCommand(), PaperBenchCommand(),
                       cli::CompletionCommand("isoscope-bench")}};
}

}  // namespace isoscope::bench
