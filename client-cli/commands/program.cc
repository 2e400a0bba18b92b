#include "client-cli/commands/program.h"

#include "client-cli/commands/help_layout.h"

namespace isoscope::cli {

Program IsoscopeProgram() {
  return {.name = "isoscope",
          .summary = "isosurfaces of volumes too large for one machine",
          .example = "  isoscope render head.nii.gz --isovalue 60 --output head.png\n",
          .commands = {PartitionCommand(), InfoCommand(), VerifyCommand(), ServeCommand(),
                       RenderCommand(), PickCommand(), ExportCommand(), GenerateCommand(),
                       CopyCommand(), TopCommand(), CacheListCommand(), CacheClearCommand(),
                       CompletionCommand("isoscope"), ViewCommand()},
          .moved = {{"bench", "it is a program of its own: isoscope-bench"}},
          .help = HelpLayoutOfCommands(),
          .words = WordsOfCommands()};
}

}  // namespace isoscope::cli
