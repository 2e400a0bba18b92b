// Manual pages (man(7)), made from the descriptions behind --help.

#ifndef ISOSCOPE_CORE_CLI_MAN_PAGE_H_
#define ISOSCOPE_CORE_CLI_MAN_PAGE_H_

#include <string>

#include "core/cli/command_description.h"

namespace isoscope::cli {

// The name of a page without its section: "isoscope-cache-list", or the program's for "".
std::string ManPageName(const ProgramDescription& program, const std::string& command);

// The page of one command; of the program itself if the name of the command is empty. The same
// program gives the same bytes.
std::string CommandManPage(const ProgramDescription& program, const CommandDescription& command);

// The page of a program with commands: a list of them with the names of their pages. `notes`: lines
// as --help has them.
std::string ProgramManPage(const ProgramDescription& program, const std::string& notes);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CORE_CLI_MAN_PAGE_H_
