// The text of --help of a command: its flags under headings by task, wrapped to a width. The common
// flags come with --help, all flags with --help-all. All functions are thread-safe.

#ifndef ISOSCOPE_CORE_CLI_HELP_TEXT_H_
#define ISOSCOPE_CORE_CLI_HELP_TEXT_H_

#include <map>
#include <string>
#include <vector>

#include "core/cli/command_description.h"

namespace isoscope::cli {

// Flags are named as KeyOf has them.
struct HelpHeading {
  std::string name = {};
  std::vector<std::string> flags = {};  // those declared without a heading that stand under it
};

// Where flags stand in --help and man pages.
struct HelpLayout {
  // In the order of the text. Flags under other headings follow.
  std::vector<HelpHeading> headings = {};
  // By the name of a command, the flags of its --help. A command that is not here shows all flags.
  std::map<std::string, std::vector<std::string>> common = {};
};

// Words that shells complete as the value of a flag. Behind the colon of a typed "z:" those that
// begin so are offered: "z:viridis".
struct ValueWords {
  std::string flag = {};        // as KeyOf has it
  std::string value_name = {};  // of the flag; empty: whatever it is
  std::vector<std::string> words = {};
};

enum class HelpPart { kCommon, kAll };

// The longest name of a flag, "--output"; of a positional argument the name of its value, "INPUT".
std::string KeyOf(const FlagDescription& flag);

// Sets the headings of flags that have none, and sorts the flags by headings. Positional arguments
// stand under the first one.
void Arrange(const HelpLayout& layout, CommandDescription* command);

// Adds the words to the values of the command's flags.
void AddWords(const std::vector<ValueWords>& words, CommandDescription* command);

// The text for lines of `columns` characters; 0: unknown, 80. Examples keep their lines. `command`:
// arranged.
std::string HelpText(const std::string& program, const CommandDescription& command,
                     const HelpLayout& layout, HelpPart part, int columns);

// A name with its text beside it, in lines of `columns` characters, as entries of lists have it:
// "  render       Renders an isosurface\n". `indent`: where texts begin.
std::string HelpEntry(const std::string& name, const std::string& text, int indent, int columns);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CORE_CLI_HELP_TEXT_H_
