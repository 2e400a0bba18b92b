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
  // The kinds of values, as the name of the value says: fixed words, files, folders.
  std::vector<std::string> choices = {};
  bool takes_files = false;
  bool takes_folders = false;
};

struct CommandDescription {
  std::string name = {};      // "render", "cache list"; empty if the program is its only command
  std::string summary = {};   // one line
  std::string usage = {};     // the text behind program and name
  std::string examples = {};  // lines
  std::vector<FlagDescription> flags = {};
};

struct ProgramDescription {
  std::string name = {};     // "isoscope"
  std::string summary = {};  // one line
  std::string version = {};
  std::vector<CommandDescription> commands = {};
};

// Sets the name of the flag's value, and the kinds of values that follow from it.
void SetValueName(const std::string& value_name, FlagDescription* flag);

// Returns the literal words in a value's name: all three of "depth|mask|none", none of "FILE|-",
// both of "{a,b}".
std::vector<std::string> ChoicesOf(absl::string_view value_name);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CORE_CLI_COMMAND_DESCRIPTION_H_
