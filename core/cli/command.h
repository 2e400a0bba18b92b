// A command of a program, and its surroundings.

#ifndef ISOSCOPE_CORE_CLI_COMMAND_H_
#define ISOSCOPE_CORE_CLI_COMMAND_H_

#include <functional>
#include <iosfwd>
#include <string>

#include "absl/status/status.h"

#include "core/cli/flag_set.h"
#include "core/cli/interrupt.h"

namespace isoscope::cli {

struct Program;

// The surroundings of a command. Nothing is owned.
struct Context {
  std::ostream* out = nullptr;  // standard output
  std::ostream* err = nullptr;  // standard error: progress, and text beside `--stats -`
  bool err_is_terminal = false;
  Interrupt* interrupt = nullptr;
  // Characters of a line of standard output if that is a terminal, else 0.
  int out_columns = 0;
  const Program* program = nullptr;  // set by RunProgram
};

// The work of a command, once its flags are read. A UsageError ends the process with 2, CANCELLED
// after Ctrl-C with 130, any other error with 1.
using Action = std::function<absl::Status(const Context&)>;

struct Command {
  std::string name;      // one word, or two: "cache list"
  std::string summary;   // one line
  std::string usage;     // --help, first line: the text behind the names
  std::string examples;  // the last lines of --help
  // Adds the flags to `set`. The action owns the variables that they are read into.
  Action (*register_flags)(FlagSet* set);
};

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CORE_CLI_COMMAND_H_
