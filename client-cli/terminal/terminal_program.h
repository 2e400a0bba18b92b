// The `main` of a program in a terminal.

#ifndef ISOSCOPE_CLIENT_CLI_TERMINAL_TERMINAL_PROGRAM_H_
#define ISOSCOPE_CLIENT_CLI_TERMINAL_TERMINAL_PROGRAM_H_

#include "core/cli/program.h"

namespace isoscope::cli {

// Sets the process up, runs `program` with the streams of the process, and restores the terminal on
// Ctrl-C. Returns the exit code. Call it once, first of all.
int RunOnTerminal(const Program& program, int argc, char** argv);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_TERMINAL_TERMINAL_PROGRAM_H_
