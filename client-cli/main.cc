// The program `isoscope`.

#include "client-cli/commands/program.h"
#include "client-cli/terminal/terminal_program.h"

#ifdef __SANITIZE_ADDRESS__
// Fontconfig keeps its results until the process ends.
// NOLINTNEXTLINE(bugprone-reserved-identifier, readability-identifier-naming): LeakSanitizer's name
extern "C" const char* __lsan_default_suppressions() { return "leak:libfontconfig"; }
#endif

int main(int argc, char** argv) {
  return isoscope::cli::RunOnTerminal(isoscope::cli::IsoscopeProgram(), argc, argv);
}
