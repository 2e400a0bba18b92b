#include "bench/commands.h"

namespace isoscope::bench {

std::vector<cli::Command> Commands() {
  return {FrameBenchCommand(), PaperBenchCommand(),  CancelBenchCommand(),
          DragBenchCommand(),  SliderBenchCommand(), ClientsBenchCommand()};
}

}  // namespace isoscope::bench
