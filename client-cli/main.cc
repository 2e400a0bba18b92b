// The command line of Isoscope: the commands of client-cli, of web-gateway and of bench in one
// program.

#include <unistd.h>

#include <iostream>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "bench/commands.h"
#include "client-cli/command.h"
#include "client-cli/interrupt.h"
#include "client-cli/raw_terminal.h"
#include "client-cli/terminal.h"
#include "core/base/process_setup.h"
#include "web-gateway/view_command.h"

#ifdef __SANITIZE_ADDRESS__
// Fontconfig keeps what it has found until the process ends.
// NOLINTNEXTLINE(bugprone-reserved-identifier, readability-identifier-naming): LeakSanitizer's name
extern "C" const char* __lsan_default_suppressions() { return "leak:libfontconfig"; }
#endif

int main(int argc, char** argv) {
  isoscope::base::SetUpProcess();
  // Never destroyed: its thread waits until the process ends.
  auto* const interrupt = new isoscope::cli::Interrupt();
  interrupt->InstallForProcess(&isoscope::cli::RestoreTerminal);
  const std::optional<isoscope::cli::TerminalSize> terminal =
      isoscope::cli::SizeOfTerminal(STDOUT_FILENO);
  const isoscope::cli::Context context{.out = &std::cout,
                                       .err = &std::cerr,
                                       .err_is_terminal = isatty(STDERR_FILENO) == 1,
                                       .interrupt = interrupt,
                                       .out_columns = terminal ? terminal->columns : 0};
  std::vector<isoscope::cli::Command> commands = isoscope::cli::Commands();
  commands.push_back(isoscope::gateway::ViewCommand());
  for (isoscope::cli::Command& command : isoscope::bench::Commands()) {
    commands.push_back(std::move(command));
  }
  return isoscope::cli::RunCommandLine(std::vector<std::string>(argv + 1, argv + argc), commands,
                                       context);
}
