// Where the flags of the commands stand in --help and man pages, and the words that shells complete
// as their values. Flags that declare a heading keep it; this table has the other ones.

#ifndef ISOSCOPE_CLIENT_CLI_COMMANDS_HELP_LAYOUT_H_
#define ISOSCOPE_CLIENT_CLI_COMMANDS_HELP_LAYOUT_H_

#include <vector>

#include "core/cli/help_text.h"

namespace isoscope::cli {

HelpLayout HelpLayoutOfCommands();

// Views, colour maps, sample types and formats, from their own tables.
std::vector<ValueWords> WordsOfCommands();

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_COMMANDS_HELP_LAYOUT_H_
