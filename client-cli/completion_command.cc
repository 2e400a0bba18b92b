// isoscope completion bash|zsh|fish

#include <memory>
#include <optional>
#include <ostream>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"

#include "client-cli/commands.h"
#include "client-cli/terminal.h"
#include "core/cli/flags.h"
#include "core/cli/shell_completion.h"
#include "core/cli/usage.h"

namespace isoscope::cli {
namespace {

absl::Status Run(const std::optional<Shell>& given, const Context& context) {
  std::optional<Shell> shell = given;
  if (!shell) {
    const std::string path = ProcessEnvironment("SHELL");
    const absl::StatusOr<Shell> own = ShellFromName(path.substr(path.rfind('/') + 1));
    if (!own.ok()) {
      return UsageError(absl::StrCat("which shell: bash, zsh or fish? $SHELL is '", path, "'"));
    }
    shell = *own;
  }
  *context.out << CompletionScript(*shell, DescribeProgram(*context.commands));
  return absl::OkStatus();
}

Action RegisterFlags(FlagSet* set) {
  const auto shell = std::make_shared<std::optional<Shell>>();
  AddFlag(set, "shell", "bash|zsh|fish", shell.get(), ShellFromName,
          "which shell reads the script (default: that of $SHELL)");
  return [shell](const Context& context) { return Run(*shell, context); };
}

}  // namespace

Command CompletionCommand() {
  return {.name = "completion",
          .summary = "Prints the script that completes commands, flags and values in a shell",
          .usage = "bash|zsh|fish",
          .examples =
              "  isoscope completion fish > ~/.config/fish/completions/isoscope.fish\n"
              "  source <(isoscope completion bash)                 in ~/.bashrc\n"
              "  source <(isoscope completion zsh)                  in ~/.zshrc, behind compinit\n",
          .register_flags = RegisterFlags};
}

}  // namespace isoscope::cli
