// The list of the commands of `isoscope`.

#ifndef ISOSCOPE_CLIENT_CLI_COMMANDS_PROGRAM_H_
#define ISOSCOPE_CLIENT_CLI_COMMANDS_PROGRAM_H_

#include "core/cli/command.h"
#include "core/cli/program.h"

namespace isoscope::cli {

Command PartitionCommand();
Command InfoCommand();
Command VerifyCommand();
Command ServeCommand();
Command RenderCommand();
Command PickCommand();
Command ExportCommand();
Command GenerateCommand();
Command CopyCommand();
Command TopCommand();
Command CacheListCommand();
Command CacheClearCommand();
Command ViewCommand();

Program IsoscopeProgram();

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_COMMANDS_PROGRAM_H_
