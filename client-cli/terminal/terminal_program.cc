#include "client-cli/terminal/terminal_program.h"

#include <unistd.h>

#include <iostream>
#include <optional>
#include <string>
#include <vector>

#include "client-cli/terminal/raw_terminal.h"
#include "client-cli/terminal/terminal.h"
#include "core/base/process_setup.h"
#include "core/cli/interrupt.h"

namespace isoscope::cli {

int RunOnTerminal(const Program& program, int argc, char** argv) {
  base::SetUpProcess();
  // Never destroyed: its thread waits until the process ends.
  auto* const interrupt = new Interrupt();
  interrupt->InstallForProcess(&RestoreTerminal);
  const std::optional<TerminalSize> terminal = SizeOfTerminal(STDOUT_FILENO);
  return RunProgram(program, std::vector<std::string>(argv + 1, argv + argc),
                    {.out = &std::cout,
                     .err = &std::cerr,
                     .err_is_terminal = isatty(STDERR_FILENO) == 1,
                     .interrupt = interrupt,
                     .out_columns = terminal ? terminal->columns : 0});
}

}  // namespace isoscope::cli
