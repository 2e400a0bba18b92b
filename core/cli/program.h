// A program of several commands, from its arguments to its exit code.

#ifndef ISOSCOPE_CORE_CLI_PROGRAM_H_
#define ISOSCOPE_CORE_CLI_PROGRAM_H_

#include <map>
#include <string>
#include <vector>

#include "core/cli/command.h"
#include "core/cli/command_description.h"
#include "core/cli/help_text.h"

namespace isoscope::cli {

struct Program {
  std::string name = {};               // "isoscope"
  std::string summary = {};            // one line
  std::string example = {};            // the last lines of --help
  std::vector<Command> commands = {};  // in the order of --help
  // Commands that the program once had, and the end of the sentence that says so: "it is a program
  // of its own: isoscope-bench".
  std::map<std::string, std::string> moved = {};
  HelpLayout help = {};                // of --help of the commands
  std::vector<ValueWords> words = {};  // for shells, beside those that names of values have
};

// Prints the script that completes `program` in a shell.
Command CompletionCommand(const std::string& program);

// Completions and man pages are made of it.
ProgramDescription DescribeProgram(const Program& program);

// Runs the command that `arguments` name, those behind the program's name. Returns the exit code.
int RunProgram(const Program& program, const std::vector<std::string>& arguments,
               const Context& context);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CORE_CLI_PROGRAM_H_
