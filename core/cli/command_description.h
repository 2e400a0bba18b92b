// A command and its flags as plain data, which FlagSet::Describe reads from the declarations of
// --help. Shell completions and man pages are made from it. All functions are thread-safe.

#ifndef ISOSCOPE_CORE_CLI_COMMAND_DESCRIPTION_H_
#define ISOSCOPE_CORE_CLI_COMMAND_DESCRIPTION_H_

#include <string>
#include <vector>

#include "absl/strings/string_view.h"

namespace isoscope::cli {

struct FlagDescription {
  // "--output", "-h"; empty for a positional argument.
  std::vector<std::string> names = {};
  std::string value_name = {};  // as --help has it: "FILE.png"; empty for a switch
  bool has_optional_value = false;
  bool is_repeatable = false;
  std::string help = {};
  std::string group = {};  // the heading of --help above it
  std::string environment = {};
  std::string default_value = {};
  // What the name of the value tells: fixed words, files, folders.
  std::vector<std::string> choices = {};
  bool takes_files = false;
  bool takes_folders = false;
};

struct CommandDescription {
  std::string name = {};      // "render", "cache list"; empty if the program is its only command
  std::string summary = {};   // one line
  std::string usage = {};     // what follows the program and the name
  std::string examples = {};  // lines
  std::vector<FlagDescription> flags = {};
};

struct ProgramDescription {
  std::string name = {};     // "isoscope"
  std::string summary = {};  // one line
  std::string version = {};
  std::vector<CommandDescription> commands = {};
};

// Sets the name of the flag's value, and all that it tells: words, files, folders.
void SetValueName(const std::string& value_name, FlagDescription* flag);

// The words of a value's name that mean themselves: of "depth|mask|none" all three, of "FILE|-"
// none, of "{a,b}" both.
std::vector<std::string> ChoicesOf(absl::string_view value_name);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CORE_CLI_COMMAND_DESCRIPTION_H_
