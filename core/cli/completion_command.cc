// The command `completion bash|zsh|fish` of a program.

#include <cstdlib>
#include <memory>
#include <optional>
#include <ostream>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"

#include "core/cli/flags.h"
#include "core/cli/program.h"
#include "core/cli/shell_completion.h"
#include "core/cli/usage.h"

namespace isoscope::cli {
namespace {

absl::Status Run(const std::optional<Shell>& given, const Context& context) {
  std::optional<Shell> shell = given;
  if (!shell) {
    const char* const variable = std::getenv("SHELL");
    const std::string path = variable == nullptr ? "" : variable;
    const absl::StatusOr<Shell> own = ShellFromName(path.substr(path.rfind('/') + 1));
    if (!own.ok()) {
      return UsageError(absl::StrCat("which shell: bash, zsh or fish? $SHELL is '", path, "'"));
    }
    shell = *own;
  }
  *context.out << CompletionScript(*shell, DescribeProgram(*context.program));
  return absl::OkStatus();
}

Action RegisterFlags(FlagSet* set) {
  const auto shell = std::make_shared<std::optional<Shell>>();
  AddFlag(set, "shell", "bash|zsh|fish", shell.get(), ShellFromName,
          "which shell reads the script (default: that of $SHELL)");
  return [shell](const Context& context) { return Run(*shell, context); };
}

}  // namespace

Command CompletionCommand(const std::string& program) {
  return {
      .name = "completion",
      .summary = "Prints the script that completes commands, flags and values in a shell",
      .usage = "bash|zsh|fish",
      .examples = absl::StrCat(
          "  ", program, " completion fish > ~/.config/fish/completions/", program, ".fish\n",
          "  source <(", program, " completion bash)                 in ~/.bashrc\n", "  source <(",
          program, " completion zsh)                  in ~/.zshrc, behind compinit\n"),
      .register_flags = RegisterFlags};
}

}  // namespace isoscope::cli
