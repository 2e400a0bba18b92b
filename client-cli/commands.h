// The commands of the command line: which there are, and how they are found and run.

#ifndef ISOSCOPE_CLIENT_CLI_COMMANDS_H_
#define ISOSCOPE_CLIENT_CLI_COMMANDS_H_

#include <string>
#include <vector>

#include "core/cli/command.h"
#include "core/cli/command_description.h"

namespace isoscope::cli {

Command PartitionCommand();
Command InfoCommand();
Command ServeCommand();
Command RenderCommand();
Command PickCommand();
Command ExportCommand();
Command GenerateCommand();
Command CacheListCommand();
Command CacheClearCommand();
Command CompletionCommand();
Command TopCommand();

// All commands of this room, in the order of --help.
std::vector<Command> Commands();

// What completions and man pages are made of.
ProgramDescription DescribeProgram(const std::vector<Command>& commands);

// Runs the command line, given without the program's name, with one of `commands`; --help lists
// them in their order. Returns the exit code.
int RunCommandLine(const std::vector<std::string>& arguments, const std::vector<Command>& commands,
                   const Context& context);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_COMMANDS_H_
