// `isoscope-bench`: the commands for measurements.

#ifndef ISOSCOPE_BENCH_PROGRAM_H_
#define ISOSCOPE_BENCH_PROGRAM_H_

#include "core/cli/command.h"
#include "core/cli/program.h"

namespace isoscope::bench {

cli::Command FrameBenchCommand();
cli::Command OwnerBenchCommand();
cli::Command PaperBenchCommand();

cli::Program BenchProgram();

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_PROGRAM_H_
