// isoscope completion bash|zsh|fish

#include <memory>
#include <optional>
#include <ostream>
#include <string>

#include "client-cli/command.h"
#include "client-cli/flags.h"
#include "client-cli/usage.h"
#include "core/cli/shell_completion.h"

namespace isoscope::cli {
namespace {

Action RegisterFlags(CLI::App* app) {
  const auto shell = std::make_shared<std::optional<Shell>>();
  AddFlag(app, "shell", "bash|zsh|fish", shell.get(), ShellFromName,
          "which shell reads the script");
  return [shell](const Context& context) -> absl::Status {
    if (!*shell) {
      return UsageError("which shell: bash, zsh or fish?");
    }
    *context.out << CompletionScript(**shell, DescribeProgram(*context.commands));
    return absl::OkStatus();
  };
}

}  // namespace

Command CompletionCommand() {
  return {.name = "completion",
          .summary = "Prints the script that completes commands, flags and values in a shell",
          .usage = "bash|zsh|fish",
          .examples =
              "  source <(isoscope completion bash)                 in ~/.bashrc\n"
              "  source <(isoscope completion zsh)                  in ~/.zshrc, behind compinit\n"
              "  isoscope completion fish > ~/.config/fish/completions/isoscope.fish\n",
          .register_flags = RegisterFlags};
}

}  // namespace isoscope::cli
