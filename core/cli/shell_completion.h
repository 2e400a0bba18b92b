// Completion scripts for shells.

#ifndef ISOSCOPE_CORE_CLI_SHELL_COMPLETION_H_
#define ISOSCOPE_CORE_CLI_SHELL_COMPLETION_H_

#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/cli/command_description.h"

namespace isoscope::cli {

enum class Shell { kBash, kZsh, kFish };

// "bash", "zsh" or "fish". INVALID_ARGUMENT names them.
absl::StatusOr<Shell> ShellFromName(absl::string_view name);

// A script that the shell reads: completes commands, flags, the words that a flag takes, and files
// and folders where it takes those. Needs nothing but the shell (bash 4, zsh 5, fish 3).
std::string CompletionScript(Shell shell, const ProgramDescription& program);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CORE_CLI_SHELL_COMPLETION_H_
