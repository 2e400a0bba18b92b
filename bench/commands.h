// `isoscope bench ...`: the commands that measure.

#ifndef ISOSCOPE_BENCH_COMMANDS_H_
#define ISOSCOPE_BENCH_COMMANDS_H_

#include <vector>

#include "core/cli/command.h"

namespace isoscope::bench {

cli::Command FrameBenchCommand();
cli::Command PaperBenchCommand();
cli::Command CancelBenchCommand();
cli::Command DragBenchCommand();
cli::Command SliderBenchCommand();
cli::Command ClientsBenchCommand();

// All of them, in the order of --help.
std::vector<cli::Command> Commands();

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_COMMANDS_H_
