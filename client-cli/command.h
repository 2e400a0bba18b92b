// The commands of the command line: how they are described, found and run.

#ifndef ISOSCOPE_CLIENT_CLI_COMMAND_H_
#define ISOSCOPE_CLIENT_CLI_COMMAND_H_

#include <functional>
#include <iosfwd>
#include <string>
#include <vector>

#include "absl/status/status.h"

#include "client-cli/interrupt.h"
#include "core/cli/command_description.h"
#include "core/cli/flag_set.h"

namespace isoscope::cli {

struct Command;

// The surroundings of a command. Nothing is owned.
struct Context {
  std::ostream* out = nullptr;  // standard output
  std::ostream* err = nullptr;  // standard error: progress, and text beside `--stats -`
  bool err_is_terminal = false;
  Interrupt* interrupt = nullptr;
  // Characters of a line of standard output if that is a terminal, else 0.
  int out_columns = 0;
  // Those that the program has; set by RunCommandLine.
  const std::vector<Command>* commands = nullptr;
};

// The work of a command, once its flags are read. A UsageError ends the process with 2, any other
// error with 1.
using Action = std::function<absl::Status(const Context&)>;

struct Command {
  std::string name;      // one word, or two: "bench frame"
  std::string summary;   // one line
  std::string usage;     // what follows "isoscope NAME" in the first line of --help
  std::string examples;  // the last lines of --help
  // Adds the flags to `set`. The action owns the variables that they are read into.
  Action (*register_flags)(FlagSet* set);
};

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

#endif  // ISOSCOPE_CLIENT_CLI_COMMAND_H_
